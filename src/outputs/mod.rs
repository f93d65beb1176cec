//! Snapshot → MAVLink messages.

mod settings;

pub use settings::{OutputSettings, Rate, Rates};
