//! `mavobserver`: what acts on a flying vehicle, with a bound on the error, from the telemetry it already sends.
//!
//! Bytes become frames, frames become samples, samples become measurements, measurements become estimates:
//!
//! ```text
//!  bytes ─► wire ─► telemetry ─► observers ─► wind ─► outputs ─► bytes
//!            │      (Sample,      (Estimate)            (MAVLink)
//!            │      Measurement)
//!            └────────────── daemon: router, recorder, untouched frames
//! ```
//!
//! | folder | what lives there | may import |
//! |---|---|---|
//! | [`sets`] | intervals, zonotopes, ellipsoids with outward rounding | nothing |
//! | [`sdp`] | affine matrix expressions, LMIs, log-det, the Clarabel bridge, verification | nothing |
//! | [`sos`] | polynomials, sums of squares on regions, their certificates | `sdp` |
//! | [`document`] | TOML read key by key, every issue collected with its place | nothing |
//! | [`report`] | charts as SVG, reports as one HTML page | nothing |
//! | [`signal`] | `Stamp`, `Sample`, `Measurement`, `Estimate`: the values that flow | nothing |
//! | [`vehicle`] | rigid body, rotors, drag, actuator → wrench, presets | `sets`, `signal`, `document` |
//! | [`observers`] | the `Observer` trait, its registry, one room per paper | `sets`, `sdp`, `sos`, `vehicle`, `signal` |
//! | [`wind`] | wrench → wind velocity with its bound | `sets`, `vehicle`, `signal` |
//! | [`faults`] | which part is at fault, from what telemetry contradicts | `vehicle`, `signal` |
//! | [`wire`] | MAVLink framing, dialects, link statistics | nothing |
//! | [`routing`] | which links a frame goes to: rules, filters, limits, duplicates; no I/O | `wire` |
//! | [`telemetry`] | MAVLink → `Sample` → `Measurement`; clocks | `wire`, `signal`, `vehicle` |
//! | [`pipeline`] | one vehicle's chain from frames to a snapshot; no I/O | all of the above |
//! | [`outputs`] | snapshot → MAVLink messages | `wire`, `signal`, `pipeline` |
//! | [`record`] | MCAP recordings: schemas, writing, reading, conversion, recovery | `wire`, `signal`, `telemetry`, `pipeline` |
//! | [`station`] | what we answer: own parameters, message intervals, requests, pings | `wire`, `observers`, `faults`, `pipeline`, `outputs` |
//! | [`sim`] | a multirotor in software: physics, air, sensors, autopilot, MAVLink feed | `document`, `signal`, `vehicle`, `wire` |
//! | [`evaluate`] | simulated flights with known truth, and scores of the estimates | `observers`, `pipeline`, `sim`, `signal`, `vehicle`, `wire` |
//! | [`config`] | TOML → checked config, every issue at once | `document`, `vehicle`, `observers`, `pipeline`, `outputs`, `record`, `routing`, `wire`, `faults` |
//! | [`daemon`] | links, forwarding, recording: the only place with tokio | everything |
//! | [`cli`] | one file per subcommand | everything |
//!
//! `tests/architecture.rs` holds the `use` lines of the sources against this table.

#![deny(clippy::print_stdout, clippy::unwrap_used)]

pub mod cli;
pub mod config;
pub mod daemon;
pub mod document;
pub mod evaluate;
pub mod faults;
pub mod observers;
pub mod outputs;
pub mod pipeline;
pub mod record;
pub mod report;
pub mod routing;
pub mod sdp;
pub mod sets;
pub mod signal;
pub mod sim;
pub mod sos;
pub mod station;
pub mod telemetry;
pub mod vehicle;
pub mod wind;
pub mod wire;

/// Compiles the README's examples.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
