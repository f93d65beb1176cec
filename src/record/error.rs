use std::io;
use std::path::PathBuf;

/// Why a recording cannot be written, read or converted.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error("cannot open {}: {source}", path.display())]
    Open { path: PathBuf, source: io::Error },
    #[error("cannot read: {0}")]
    Read(io::Error),
    #[error("cannot write: {0}")]
    Write(io::Error),
    #[error(transparent)]
    Log(#[from] crate::wire::tlog::TlogError),
    #[error("the recording is damaged: {0}; `mavobserver recover` saves what is left")]
    Damaged(String),
    #[error("{0}")]
    Unsupported(String),
}

impl RecordError {
    /// An error of the MCAP library while writing: nearly always the disk's.
    pub(super) fn writing(error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(error) => Self::Write(error),
            other => Self::Write(io::Error::other(other)),
        }
    }

    /// An error of the MCAP library while reading.
    pub(super) fn reading(error: mcap::McapError) -> Self {
        match error {
            mcap::McapError::Io(error) => Self::Read(error),
            other => Self::Damaged(other.to_string()),
        }
    }
}
