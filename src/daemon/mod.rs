//! Links, forwarding, the estimator's thread and the recorder: the only place with an async runtime, sockets, threads
//! and clocks.
//!
//! In: a list of links and an [`Estimator`]. Out: every frame of a link on all others, untouched; estimates as MAVLink on
//! every link; recordings; a status line for each link and vehicle. May import everything.
//!
//! ```text
//!  link task ──frame──► Router ──────────────► the links that crate::routing names (and other peers of the same port)
//!     │ └─────────────► Recorder (thread) ───► DIR/TIME.tlog
//!     └───────────────► Estimator (thread) ──► LinkOutputs, one a link ─► Router
//! ```
//!
//! # What happens when a queue is full
//!
//! | queue | length | when full |
//! |---|---|---|
//! | UDP socket, in | the kernel's buffer, 4 MiB where it allows that | the kernel drops the newest datagram and counts it; we read its count |
//! | UDP socket, out | the kernel's buffer, 4 MiB where it allows that | the newest frame is dropped for that peer and counted |
//! | TCP connection, out | 256 KiB beside the kernel's buffer | frames wait; beyond that the newest is dropped and counted |
//! | serial port, out | what the line carries in 0.25 s | frames wait; beyond that the newest is dropped and counted |
//! | link → estimator, live link | [`ESTIMATOR_QUEUE`] frames | the newest frame is dropped for the estimator and counted; it is still forwarded |
//! | link → estimator, played log | the same | the log waits |
//! | → recorder | [`RECORDER_QUEUE`] frames | a gap: the newest frame is not recorded and counted |
//! | log reader → log link | [`READ_AHEAD`] frames | the reader waits |
//! | status, metrics | none | the latest state is shown |
//!
//! Nothing that is full makes another link, or the receiving side of its own, wait.
//!
//! # Stopping
//!
//! First the vehicles get back what they granted: every message that was asked for goes to the interval that it had.
//! Then, in this order, under one deadline: links close, the estimator works off its queue and ends, the recorder writes what
//! it has. Whatever is not done by then is named and left behind.

mod batches;
mod clock;
mod dialogue;
mod error;
mod estimator;
mod farewell;
mod guard;
mod inlet;
mod keeper;
mod links;
mod lock;
mod metrics;
mod pairing;
#[cfg(test)]
mod pairing_flights;
mod recorder;
mod router;
mod service;
mod settings;
mod status;

pub use clock::steady_ns;
pub use error::DaemonError;
pub use estimator::Estimator;
pub use guard::TimesError;
pub use keeper::KeeperError;
pub(crate) use lock::lock;
pub use router::LinkId;
pub use service::{Control, Daemon, Summary};
pub use settings::Settings;
pub use status::{Decision, LinkStatus, ObserverStatus, RecordingStatus, SourceStatus, Status, VehicleStatus};

/// Frames that may wait for the estimator: a second of twenty vehicles.
pub const ESTIMATOR_QUEUE: usize = 4096;
/// Frames that may wait for the disk.
pub const RECORDER_QUEUE: usize = 8192;
/// Frames that are read from a log before they are due.
pub const READ_AHEAD: usize = 256;
