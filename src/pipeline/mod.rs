//! One vehicle's chain from frames to a [`Snapshot`], and the [`Fleet`] of all vehicles on the links.
//!
//! In: frames with their receive time. Out: [`Event`]s: a snapshot per measurement, notices on state changes. No I/O,
//! no clock of its own, no async runtime: `replay` and the daemon run the very same code, so they give the very same numbers.
//!
//! Imports everything but `outputs`, `config`, `daemon` and `cli`.

mod chain;
mod fleet;
mod notices;
mod slot;
mod snapshot;

pub use chain::{Chain, Reports};
pub use fleet::{Event, Fleet, FleetSettings, ObserverSetting, Severity, Tuning, VehicleKind};
pub use slot::Clock;
pub use snapshot::{FaultDetail, FaultMask, ObserverReport, Snapshot, VehicleId, WindEstimate, WrenchEstimate};
