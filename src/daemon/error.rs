use super::guard::TimesError;
use super::keeper::KeeperError;
use crate::record::RecordError;
use crate::wire::tlog::TlogError;
use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Why the daemon cannot start: what waiting would not mend. Nothing of this happens once it runs.
#[derive(Debug, thiserror::Error)]
pub enum DaemonError {
    #[error(
        "{link}: the port is in use by another program (a ground station, mavlink-router, another mavobserver?); \
         stop that one, or choose another port here and there"
    )]
    PortInUse { link: String },
    #[error("{link}: {source}")]
    Log { link: String, source: TlogError },
    #[error("cannot record into {}: {source}", directory.display())]
    Record { directory: PathBuf, source: RecordError },
    #[error("cannot serve metrics at {address}: {source}; choose another `listen` in [metrics]")]
    Metrics { address: SocketAddr, source: io::Error },
    #[error("parameter file {}: {source}", path.display())]
    Parameters { path: PathBuf, source: KeeperError },
    #[error("times of signatures of {link}: {source}")]
    Times { link: String, source: TimesError },
    #[error("cannot start the {name} thread: {source}")]
    Thread { name: &'static str, source: io::Error },
}
