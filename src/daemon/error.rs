use crate::record::RecordError;
use crate::wire::tlog::TlogError;
use std::io;
use std::path::PathBuf;

/// Why the daemon cannot start. Nothing of this happens once it runs.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    #[error(
        "{link}: the port is in use by another program (a ground station, mavlink-router, another mavobserver?); \
         stop that one, or choose another port here and there"
    )]
    PortInUse { link: String },
    #[error("{link}: cannot open the socket: {source}")]
    Socket { link: String, source: io::Error },
    #[error("{link}: the host name cannot be resolved: {source}")]
    Resolve { link: String, source: io::Error },
    #[error("{link}: {source}")]
    Log { link: String, source: TlogError },
    #[error("cannot record into {}: {source}", directory.display())]
    Record { directory: PathBuf, source: RecordError },
    #[error("cannot start the {name} thread: {source}")]
    Thread { name: &'static str, source: io::Error },
}
