use super::options::{OptionError, Options};
use super::{Observer, cascade_gnss_ins, fuzzy_polynomial, quadratic_bounded, unknown_input, zonotopic_ekf};
use crate::signal::Channel;
use crate::vehicle::Vehicle;

/// One observer that can be built for a vehicle.
pub struct Registration {
    /// Name in configs, messages and reports.
    pub name: &'static str,
    /// Id in STATE_BOUNDS and OBSERVER_STATUS. Where several observers give the same quantity, the lowest speaks.
    pub id: u8,
    pub paper: &'static str,
    /// What it tells.
    pub estimates: &'static str,
    /// The channels without which it is starved.
    pub needs: &'static [Channel],
    /// The keys of its config table.
    pub options: &'static [&'static str],
    /// What our own parameters of it begin with: at most four letters.
    pub prefix: &'static str,
    /// The options that a ground station may turn in flight.
    pub dials: &'static [Dial],
    /// Runs when a config names no observers: it is quick to build and cheap to step.
    pub standard: bool,
    pub builder: Builder,
}

/// An option that can be turned while the observer runs, as one of our own parameters. At 0 the config decides.
pub struct Dial {
    /// The parameter's name is the observer's prefix, `_` and this.
    pub suffix: &'static str,
    /// The number among the observer's options.
    pub option: &'static str,
    pub least: f64,
    pub most: f64,
    pub meaning: &'static str,
}

/// Makes an observer for a vehicle from its config table.
pub type Builder = fn(&Vehicle, &mut Options) -> Result<Box<dyn Observer>, BuildError>;

/// Every observer, one line each.
pub const REGISTRY: &[Registration] = &[
    quadratic_bounded::REGISTRATION,
    zonotopic_ekf::REGISTRATION,
    cascade_gnss_ins::REGISTRATION,
    unknown_input::REGISTRATION,
    fuzzy_polynomial::REGISTRATION,
];

/// Why an observer could not be built.
#[derive(Debug, thiserror::Error)]
pub enum BuildError {
    #[error("there is no observer `{name}`; there are: {known}")]
    Unknown { name: String, known: String },
    #[error("observer {observer}: {source}")]
    Option { observer: &'static str, source: OptionError },
    #[error("observer {observer} has no option `{key}`; it has: {known}")]
    UnknownOption { observer: &'static str, key: String, known: String },
    #[error("observer {observer}, {part}: {source}")]
    Design { observer: &'static str, part: String, source: Box<dyn std::error::Error + Send + Sync> },
    /// The vehicle's file lacks what the observer lives on, such as the rotors' inertia.
    #[error("observer {observer} cannot serve this vehicle: {reason}")]
    Unsuited { observer: &'static str, reason: String },
}

/// The registration of this name.
pub fn find(name: &str) -> Result<&'static Registration, BuildError> {
    REGISTRY.iter().find(|r| r.name == name).ok_or_else(|| BuildError::Unknown {
        name: name.to_owned(),
        known: REGISTRY.iter().map(|r| r.name).collect::<Vec<_>>().join(", "),
    })
}

/// Builds an observer for a vehicle. Designs its gains, which may take a moment, unless they are cached.
pub fn build(name: &str, vehicle: &Vehicle, mut options: Options) -> Result<Box<dyn Observer>, BuildError> {
    let r = find(name)?;
    if let Some(key) = options.keys().find(|k| !r.options.contains(k)) {
        return Err(BuildError::UnknownOption { observer: r.name, key: key.to_owned(), known: r.options.join(", ") });
    }
    (r.builder)(vehicle, &mut options)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_ids_are_unique() {
        for (i, a) in REGISTRY.iter().enumerate() {
            assert!(a.name.len() <= 20, "{} does not fit OBSERVER_STATUS", a.name);
            let differs = |b: &Registration| b.name != a.name && b.id != a.id && b.prefix != a.prefix;
            assert!(REGISTRY[..i].iter().all(differs), "{}", a.name);
            assert!(a.dials.iter().all(|d| a.options.contains(&d.option) && d.least > 0.0), "{}", a.name);
        }
    }
}
