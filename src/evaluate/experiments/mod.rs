//! The papers' own experiments, flown again: one file each, one line each in [`EXPERIMENTS`].
//!
//! An experiment takes no input: it is the same numbers every time. What it finds are [`Figure`]s, some of them with a
//! limit that they must keep, and [`Trace`]s to be drawn. Imports what [`evaluate`](crate::evaluate) does.

mod cayero;
mod findings;
mod grip;
mod pham;
mod pitarch;
mod wang;

pub use findings::{Figure, Findings, Limit, Trace};

/// One experiment of a paper.
pub struct Experiment {
    pub name: &'static str,
    /// The paper, and where in it.
    pub paper: &'static str,
    pub about: &'static str,
    pub run: fn() -> Result<Findings, ExperimentError>,
}

/// All of them, one line each.
pub const EXPERIMENTS: &[Experiment] =
    &[cayero::EXPERIMENT, wang::EXPERIMENT, grip::EXPERIMENT, pitarch::EXPERIMENT, pham::EXPERIMENT];

/// Why an experiment gave no findings.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    #[error("there is no experiment `{name}`; there are: {known}")]
    Unknown { name: String, known: String },
    #[error("experiment {name}, {part}: {source}")]
    Failed { name: &'static str, part: String, source: Box<dyn std::error::Error + Send + Sync> },
}

impl ExperimentError {
    /// For `map_err`: this part of this experiment did not work.
    pub fn in_part<E: std::error::Error + Send + Sync + 'static>(
        name: &'static str,
        part: impl Into<String>,
    ) -> impl FnOnce(E) -> Self {
        let part = part.into();
        move |source| Self::Failed { name, part, source: Box::new(source) }
    }
}

/// The experiment of this name.
pub fn find(name: &str) -> Result<&'static Experiment, ExperimentError> {
    EXPERIMENTS.iter().find(|e| e.name == name).ok_or_else(|| ExperimentError::Unknown {
        name: name.to_owned(),
        known: EXPERIMENTS.iter().map(|e| e.name).collect::<Vec<_>>().join(", "),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn experiments_are_found_by_their_names() {
        for (i, e) in EXPERIMENTS.iter().enumerate() {
            assert!(EXPERIMENTS[..i].iter().all(|other| other.name != e.name));
            assert_eq!(find(e.name).unwrap().paper, e.paper);
        }
        assert!(matches!(find("nothing"), Err(ExperimentError::Unknown { .. })));
    }
}
