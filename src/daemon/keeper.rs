//! Parameters that ground stations set, kept on disk.

use crate::outputs::OutputSettings;
use crate::pipeline::Tuning;
use crate::station::{self, ParameterFile, ParameterFileError, StationSettings};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use tracing::warn;

/// Writes what was set to a file, if there is one.
#[derive(Debug, Default)]
pub(super) struct Keeper {
    path: Option<PathBuf>,
    /// Only what was set: the config decides about everything else.
    set: Vec<(&'static str, f64)>,
}

/// Why the file of parameters cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeeperError {
    #[error("cannot read it: {0}")]
    Unreadable(#[from] std::io::Error),
    #[error("{0}; mend the line or delete the file")]
    Invalid(#[from] ParameterFileError),
}

impl Keeper {
    /// Reads the file, if it is there, and takes its values into the settings of each link.
    ///
    /// # Errors
    /// The file cannot be read or understood.
    pub(super) fn open<'a>(
        path: Option<&Path>,
        links: impl Iterator<Item = &'a mut OutputSettings>,
    ) -> Result<Self, KeeperError> {
        let Some(path) = path else { return Ok(Self::default()) };
        let text = match std::fs::read_to_string(path) {
            Ok(text) => text,
            Err(e) if e.kind() == ErrorKind::NotFound => String::new(),
            Err(e) => return Err(e.into()),
        };
        let set = ParameterFile::values(&text)?;
        let keeper = Self { path: Some(path.to_owned()), set };
        for outputs in links {
            *outputs = keeper.taken(StationSettings { outputs: *outputs, ..StationSettings::default() }).outputs;
        }
        Ok(keeper)
    }

    /// How the observers are to run by what is kept.
    pub(super) fn tuning(&self, tuning: Tuning) -> Tuning {
        self.taken(StationSettings { tuning, ..StationSettings::default() }).tuning
    }

    fn taken(&self, mut settings: StationSettings) -> StationSettings {
        for (name, value) in &self.set {
            if let Some((_, parameter)) = station::parameter(name) {
                parameter.set(&mut settings, *value);
            }
        }
        settings
    }

    /// Keeps a value. A file that cannot be written costs the value at the next start, and a warning now.
    pub(super) fn keep(&mut self, name: &'static str, value: f64) {
        match self.set.iter_mut().find(|(known, _)| *known == name) {
            Some((_, kept)) => *kept = value,
            None => self.set.push((name, value)),
        }
        let Some(path) = &self.path else { return };
        // written whole beside it and moved over it: a crash leaves the old file or the new one
        let new = path.with_extension("new");
        let written = std::fs::write(&new, ParameterFile::write(&self.set)).and_then(|()| std::fs::rename(&new, path));
        if let Err(e) = written {
            warn!("cannot keep parameters in {}: {e}", path.display());
        }
    }
}
