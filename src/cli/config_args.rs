use super::{Failure, logging};
use crate::config::{Config, ConfigError, Vehicles};
use crate::document::Issue;
use crate::vehicle::{VehicleError, resolve};
use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// The arguments of every command that needs a config.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ConfigArgs {
    /// Config file
    #[arg(short, long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Vehicle model: a preset or a TOML file, for every system or (SYSID=…) for one; repeatable
    #[arg(long = "vehicle", value_name = "[SYSID=]PRESET|FILE")]
    pub vehicles: Vec<VehicleArg>,
}

/// `PRESET|FILE`, or `SYSID=PRESET|FILE` for one system.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VehicleArg {
    pub system: Option<u8>,
    pub model: String,
}

impl FromStr for VehicleArg {
    type Err = Infallible;

    fn from_str(s: &str) -> Result<Self, Infallible> {
        // only a system id makes the `=` a separator: file names may hold one too
        let split =
            s.split_once('=').and_then(|(id, model)| Some((id.parse::<u8>().ok().filter(|id| *id > 0)?, model)));
        Ok(match split {
            Some((system, model)) => Self { system: Some(system), model: model.to_owned() },
            None => Self { system: None, model: s.to_owned() },
        })
    }
}

/// Why no config could be made of the arguments: everything that is wrong, not only the first.
#[derive(Debug, Default)]
pub struct LoadErrors {
    pub config: Option<ConfigError>,
    pub vehicles: Vec<VehicleError>,
}

impl ConfigArgs {
    /// The config that the arguments describe, with its warnings. From here on its log filter holds.
    pub fn load(&self) -> Result<(Config, Vec<Issue>), LoadErrors> {
        let mut errors = LoadErrors::default();
        let (mut config, warnings) = match self.config.as_deref().map(Config::open) {
            Some(Ok(read)) => read,
            Some(Err(e)) => {
                errors.config = Some(e);
                Default::default()
            }
            None => Default::default(),
        };
        // a model for every system replaces all that the file says; one for a system adds to it
        if self.vehicles.iter().any(|v| v.system.is_none()) {
            config.vehicles = Vehicles::default();
        }
        for arg in &self.vehicles {
            match (resolve(&arg.model).map(Arc::new), arg.system) {
                (Ok(vehicle), Some(system)) => _ = config.vehicles.by_system.insert(system, vehicle),
                (Ok(vehicle), None) => config.vehicles.default = Some(vehicle),
                (Err(e), _) => errors.vehicles.push(e),
            }
        }
        if errors.config.is_some() || !errors.vehicles.is_empty() {
            return Err(errors);
        }
        logging::adopt(&config.log);
        Ok((config, warnings))
    }
}

impl From<LoadErrors> for Failure {
    fn from(errors: LoadErrors) -> Self {
        let config = errors.config.iter().map(ToString::to_string);
        let all: Vec<_> = config.chain(errors.vehicles.iter().map(ToString::to_string)).collect();
        Self::Usage(all.join("\n\n"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_id_may_stand_before_the_model() {
        let arg = |s: &str| s.parse::<VehicleArg>().unwrap();
        assert_eq!(arg("2=px4-sih"), VehicleArg { system: Some(2), model: "px4-sih".into() });
        assert_eq!(arg("px4-sih"), VehicleArg { system: None, model: "px4-sih".into() });
        assert_eq!(arg("a=b.toml").system, None);
    }

    #[test]
    fn a_model_for_all_replaces_what_the_file_says() {
        let args =
            ConfigArgs { config: None, vehicles: vec!["3=px4-x500".parse().unwrap(), "px4-sih".parse().unwrap()] };
        let (config, _) = args.load().unwrap();
        assert_eq!(config.vehicles.of(1).unwrap().name, "PX4 SIH quad X");
        assert_eq!(config.vehicles.of(3).unwrap().name, "PX4 Gazebo x500");
    }
}
