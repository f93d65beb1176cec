//! Where what stands in a recording. Only what `/mavlink/` and [`BAD`] hold came over a link; everything else is
//! derived from it, and conversion back to a telemetry log leaves it out.

/// MAVLink messages: `/mavlink/SYSTEM/COMPONENT/MESSAGE`.
pub const MAVLINK: &str = "/mavlink/";
/// Bytes that were no frame.
pub const BAD: &str = "/link/bad";
/// Stretches in which the recorder could not follow.
pub const GAP: &str = "/record/gap";
/// Estimates: `/observer/SYSTEM/NAME`.
pub const OBSERVER: &str = "/observer/";

/// Metadata record that says what a recording was made from.
pub const SOURCE: &str = "mavobserver.source";
/// Metadata record that says what was found in it.
pub const SUMMARY: &str = "mavobserver.summary";
