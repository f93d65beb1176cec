use super::chain::Reports;
use crate::signal::{Estimate, Guarantee, Signal, Stamp, Verdict};
use nalgebra::Vector3;
use std::fmt;

/// One vehicle: a MAVLink system and the component that is its autopilot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct VehicleId {
    pub system: u8,
    pub component: u8,
}

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.system, self.component)
    }
}

/// The residual wrench: everything the vehicle model without drag does not explain (air, contact, model error).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WrenchEstimate {
    /// N, world NED.
    pub force_ned_n: Vector3<f64>,
    /// N; infinite where nothing is claimed.
    pub force_half_width_n: Vector3<f64>,
    /// N m, body FRD.
    pub torque_frd_nm: Vector3<f64>,
    pub torque_half_width_nm: Vector3<f64>,
    pub guarantee: Guarantee,
    pub verdict: Verdict,
}

/// Velocity of the air over ground (*towards*), world NED, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindEstimate {
    pub velocity_ned_mps: Vector3<f64>,
    /// m/s; infinite where nothing is claimed.
    pub half_width_mps: Vector3<f64>,
    pub guarantee: Guarantee,
    pub verdict: Verdict,
}

/// Active faults, one bit each; the order is that of the `mavobserver.xml` enum MAVOBSERVER_FAULT.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultMask(pub u32);

impl FaultMask {
    /// Names of the bits, lowest first.
    pub const NAMES: [&str; 22] = [
        "rotor_1",
        "rotor_2",
        "rotor_3",
        "rotor_4",
        "rotor_5",
        "rotor_6",
        "rotor_7",
        "rotor_8",
        "rotor_9",
        "rotor_10",
        "rotor_11",
        "rotor_12",
        "gyro",
        "accel",
        "mag",
        "baro",
        "gnss_position",
        "gnss_velocity",
        "attitude",
        "payload",
        "gust",
        "link",
    ];

    /// `rotor_2|rotor_6`: one of these.
    pub fn one_of(self) -> String {
        self.names().collect::<Vec<_>>().join("|")
    }

    /// The names of the active faults.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES.iter().enumerate().filter(move |(i, _)| self.0 >> i & 1 != 0).map(|(_, n)| *n)
    }
}

/// The fault of a snapshot that began last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultDetail {
    /// Its bit; several where it is one of them.
    pub mask: FaultMask,
    pub onset: Stamp,
    /// Lost share of thrust for a rotor, kg for a payload (negative for one put down), the sensor's unit for a sensor.
    pub magnitude: f64,
    /// That there is one.
    pub guarantee: Guarantee,
}

/// What one observer says about itself in a snapshot.
#[derive(Debug, Clone, Copy)]
pub struct ObserverReport<'a> {
    /// Registry name, such as `quadratic_bounded`.
    pub name: &'static str,
    /// The id in STATE_BOUNDS and OBSERVER_STATUS.
    pub id: u8,
    pub signals: &'a [Signal],
    pub estimate: &'a Estimate,
    /// Steps taken since start.
    pub steps: u64,
    /// Mean computing time of the last steps, ns; 0 where no clock was given.
    pub step_ns: u32,
    /// Needed channels that do not arrive: [`Channel::bit`](crate::signal::Channel::bit)s.
    pub missing: u16,
}

/// Everything known about one vehicle after one measurement.
#[derive(Clone, Copy)]
pub struct Snapshot<'a> {
    pub vehicle: VehicleId,
    /// Boot time of the measurement.
    pub stamp: Stamp,
    /// When the frame that completed the measurement was received, µs since 1970.
    pub received_unix_us: u64,
    pub wrench: Option<WrenchEstimate>,
    pub wind: Option<WindEstimate>,
    pub faults: FaultMask,
    /// Faults of which at least one is present, where the data cannot tell which.
    pub fault_candidates: FaultMask,
    pub newest_fault: Option<FaultDetail>,
    /// Of all observers together: grounded where one is; else the worst of those that answer; starved when none does.
    pub verdict: Verdict,
    /// What each observer says; see [`Reports::iter`].
    pub observers: Reports<'a>,
}
