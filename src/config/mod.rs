//! The daemon's configuration: TOML in, a checked [`Config`] out, or every issue at once with its place.
//!
//! [`Config::open`] reads a file and the vehicle files it names; the command line then adds to it or overrides it.
//! Unknown keys are errors that name the nearest known one. What is allowed but doubtful becomes a warning.
//! Paths in a config are relative to the file that holds them, so that a config works from any directory.
//!
//! `config/example.toml` shows every key with its default.
//! Imports `document`, `vehicle`, `observers`, `faults`, `pipeline`, `outputs`, `record`, `routing` and `wire`.

mod link_url;
mod output;
mod read;
mod record;
mod rules;
mod signing;

pub use link_url::{Flow, LinkUrl, LinkUrlError, Pace};
pub use signing::Signing;

use crate::document::{Document, Issue, Issues};
use crate::faults::FaultSettings;
use crate::outputs::OutputSettings;
use crate::pipeline::{FleetSettings, ObserverSetting};
use crate::record::session::Policy;
use crate::routing::Rules;
use crate::vehicle::Vehicle;
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Everything that a run is told.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    pub links: Vec<Link>,
    pub vehicles: Vehicles,
    /// The observers that run on every vehicle.
    pub observers: Vec<ObserverSetting>,
    pub faults: FaultSettings,
    /// What leaves on a link that says nothing else.
    pub output: OutputSettings,
    /// Where parameters that ground stations set are kept; `None` for nowhere.
    pub parameters: Option<PathBuf>,
    /// Where received frames are recorded; `None` for not at all.
    pub record: Option<Recording>,
    pub requests: Requests,
    /// How long a frame is known, to remove it when it comes again by another link; zero for not at all.
    pub duplicates: Duration,
    /// Where Prometheus may ask for numbers; `None` for nowhere.
    pub metrics: Option<SocketAddr>,
    /// Filter of log lines, such as `info` or `mavobserver=debug`.
    pub log: String,
}

/// Where recordings go, and how they are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    pub directory: PathBuf,
    pub policy: Policy,
}

/// One link and what leaves on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// How messages and statistics call it.
    pub name: String,
    pub url: LinkUrl,
    pub output: OutputSettings,
    pub rules: Rules,
    /// `None`: nothing is signed, and signatures are not looked at.
    pub signing: Option<Signing>,
}

impl Link {
    /// A link named by its URL, that takes and is sent everything.
    pub fn new(url: LinkUrl, output: OutputSettings) -> Self {
        Self { name: url.to_string(), url, output, rules: Rules::default(), signing: None }
    }
}

/// Which model belongs to which MAVLink system.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Vehicles {
    /// For every system without a model of its own.
    pub default: Option<Arc<Vehicle>>,
    pub by_system: BTreeMap<u8, Arc<Vehicle>>,
}

impl Vehicles {
    /// The model of a system.
    pub fn of(&self, system: u8) -> Option<&Arc<Vehicle>> {
        self.by_system.get(&system).or(self.default.as_ref())
    }
}

/// What is asked of the vehicles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Requests {
    /// Ask for the streams that the observers need.
    pub streams: bool,
    /// Wanted rate of IMU, attitude, velocity and actuators, Hz.
    pub rate_hz: f64,
}

impl Default for Requests {
    fn default() -> Self {
        Self { streams: true, rate_hz: 50.0 }
    }
}

impl Default for Config {
    /// What an empty file says.
    fn default() -> Self {
        Self {
            links: Vec::new(),
            vehicles: Vehicles::default(),
            observers: ObserverSetting::standard(),
            faults: FaultSettings::default(),
            output: OutputSettings::default(),
            parameters: None,
            record: None,
            requests: Requests::default(),
            duplicates: Duration::from_millis(500),
            metrics: None,
            log: "info".to_owned(),
        }
    }
}

/// Why a config could not be had.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    #[error("cannot read the config {}: {source}", path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("config {}: {issues}", path.display())]
    Invalid { path: PathBuf, issues: Issues },
}

impl Config {
    /// Reads a config file, and the vehicle files that it names.
    pub fn open(path: &Path) -> Result<(Self, Vec<Issue>), ConfigError> {
        let document =
            Document::open(path).map_err(|source| ConfigError::Unreadable { path: path.to_owned(), source })?;
        let base = path.parent().unwrap_or(Path::new(""));
        Self::read(&document, base).map_err(|issues| ConfigError::Invalid { path: path.to_owned(), issues })
    }

    /// Reads a config whose relative paths begin at `base`; gives it with its warnings, or every issue.
    pub fn read(document: &Document, base: &Path) -> Result<(Self, Vec<Issue>), Issues> {
        document.read(|table| read::config(table, base))
    }

    /// What the fleet of vehicles is made of; `None` without a model for every system.
    pub fn fleet(&self) -> Option<FleetSettings> {
        Some(FleetSettings {
            vehicle: self.vehicles.default.clone()?,
            by_system: self.vehicles.by_system.clone(),
            observers: self.observers.clone(),
            faults: self.faults,
        })
    }

    /// Adds a link that leaves what `[output]` says, named by its URL.
    pub fn add_link(&mut self, url: LinkUrl) {
        self.links.push(Link::new(url, self.output));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::{OptionValue, Options};

    fn read(source: &str) -> Result<(Config, Vec<Issue>), Issues> {
        Config::read(&Document::new("c.toml", source), Path::new("dir"))
    }

    fn problems(source: &str) -> Vec<String> {
        read(source).unwrap_err().iter().map(|i| format!("{} ({})", i.problem, i.advice)).collect()
    }

    #[test]
    fn an_empty_file_gives_the_defaults() {
        assert_eq!(read("").unwrap(), (Config::default(), Vec::new()));
    }

    #[test]
    fn the_example_shows_every_default() {
        let example = include_str!("../../config/example.toml");
        let (config, warnings) = read(example).unwrap_or_else(|e| panic!("{e}"));
        assert!(warnings.is_empty());
        // what the example adds to the defaults, to be of use as it is
        assert_eq!(config.links.len(), 1);
        assert!(config.vehicles.default.is_some());
        let rest = Config { links: Vec::new(), vehicles: Vehicles::default(), ..config };
        assert_eq!(rest, Config::default());
    }

    #[test]
    fn links_take_the_output_settings_of_the_file_and_change_them() {
        let (config, _) = read(
            "[output]\ncomponent = 192\nrate_hz.wind_cov = 2\n\
             [[link]]\nurl = 'udpin:0.0.0.0:14550'\n\
             [[link]]\nurl = 'tlog:a.tlog'\nname = 'log'\noutput.rate_hz.wind_cov = 0\n",
        )
        .unwrap();
        assert_eq!(config.links[0].output, config.output);
        assert_eq!(config.links[0].name, "udpin:0.0.0.0:14550");
        assert_eq!(config.links[1].output.component, 192);
        assert_ne!(config.links[1].output.rates.wind_cov, config.output.rates.wind_cov);
        assert_eq!(config.links[1].url.to_string(), "tlog:dir/a.tlog", "relative to the config");
    }

    #[test]
    fn systems_have_models_of_their_own() {
        let (config, _) = read("[vehicle]\npreset = 'px4-sih'\n[vehicle.7]\npreset = 'px4-x500'").unwrap();
        assert_eq!(config.vehicles.of(1).unwrap().name, "PX4 SIH quad X");
        assert_eq!(config.vehicles.of(7).unwrap().name, "PX4 Gazebo x500");
        assert!(read("").unwrap().0.vehicles.of(1).is_none());
    }

    #[test]
    fn observers_carry_their_options() {
        let (config, _) = read(
            "[[observer]]\nname = 'quadratic_bounded'\nalpha_force = 3\n\
             [[observer]]\nname = 'quadratic_bounded'\nenabled = false\n",
        )
        .unwrap();
        let mut options = Options::default();
        options.insert("alpha_force", OptionValue::Number(3.0));
        assert_eq!(config.observers, [ObserverSetting { options, ..ObserverSetting::named("quadratic_bounded") }]);
        assert!(problems("[[observer]]\nname = 'quadratic_bonded'\nalpha_force = 3")[0].contains("did you mean"));
    }

    #[test]
    fn every_issue_is_told_with_what_to_do() {
        let found = problems(
            "[[link]]\nurl = 'udpim:0.0.0.0:14550'\n\
             [[link]]\nurl = 'udpin:0.0.0.0:14550'\n\
             [[link]]\nurl = 'udpin:127.0.0.1:14550'\n\
             [vehicle]\npreset = 'px4-shi'\n\
             [vehicle.3]\n\
             [vehicle.300]\npreset = 'px4-sih'\n\
             [[observer]]\nname = 'quadratic_bounded'\nalpha = 3\nalpha_force = [1]\n\
             [output]\nhartbeat_hz = 1\n\
             [log]\nfilter = 'a=b=c'\n",
        );
        let expected = [
            "did you mean `udpin`?",
            "second link on UDP port 14550",
            "did you mean \"px4-sih\"?",
            "system 3 has no model",
            "unknown key `300`",
            "did you mean `alpha_force`?",
            "`observer[1].alpha_force` must be",
            "did you mean `heartbeat_hz`?",
            "no log filter",
        ];
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for (f, e) in found.iter().zip(expected) {
            assert!(f.contains(e), "{f} / {e}");
        }
    }

    #[test]
    fn issues_of_a_vehicle_file_come_with_those_of_the_config() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("v.toml"), "name = 'x'\nmass_kg = -1\n").unwrap();
        let document = Document::new("c.toml", "[vehicle]\nfile = 'v.toml'\n[recrd]\n");
        let issues = Config::read(&document, dir.path()).unwrap_err();
        let files: Vec<_> = issues.iter().map(|i| i.file.rsplit('/').next().unwrap().to_owned()).collect();
        assert_eq!(files.first().unwrap(), "c.toml");
        assert!(files.iter().filter(|f| *f == "v.toml").count() >= 3, "{issues}");
    }

    #[test]
    fn a_setting_without_effect_is_a_warning() {
        let (_, warnings) = read("[requests]\nstreams = false\nrate_hz = 20").unwrap();
        assert_eq!(warnings.len(), 1);
    }
}
