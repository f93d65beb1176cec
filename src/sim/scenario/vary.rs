use super::read::number_or;
use crate::document::{Limit, Table};
use crate::sim::FlightPlan;
use crate::sim::faults::FaultKind;
use crate::sim::random::Random;
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::TAU;

/// What every seed draws anew, beside the noise: so that one file is hundreds of different flights.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Vary {
    /// The whole weather is turned by any angle, and scaled by a factor between these.
    pub wind_turns: bool,
    pub wind_share: Option<[f64; 2]>,
    /// The nose points anywhere at the start.
    pub heading: bool,
    /// Only one of the faults happens: the first for seed 0, the second for seed 1, and so on in turn.
    pub one_fault: bool,
    /// Each fault begins (and ends) up to this much later, s.
    pub fault_later_s: f64,
    /// Faults of a rotor happen to any rotor; biases and shifts point anywhere.
    pub fault_place: bool,
}

/// Reads `[vary]`.
pub(super) fn vary(t: &mut Table<'_>) -> Option<Vary> {
    let mut flag = |key| t.get(key).map_or(Some(false), |v| v.flag());
    let (wind_turns, heading) = (flag("wind_turns"), flag("heading"));
    let (one_fault, fault_place) = (flag("one_fault"), flag("fault_place"));
    let fault_later_s = number_or(t, "fault_later_s", Limit::NonNegative, 0.0);
    let wind_share = match t.get("wind_share") {
        None => Some(None),
        Some(v) => share(&v).map(Some),
    };
    Some(Vary {
        wind_turns: wind_turns?,
        wind_share: wind_share?,
        heading: heading?,
        one_fault: one_fault?,
        fault_later_s: fault_later_s?,
        fault_place: fault_place?,
    })
}

fn share(v: &crate::document::Value<'_>) -> Option<[f64; 2]> {
    let [low, high] = v.array()?;
    let (low, high) = (low.number(Limit::NonNegative)?, high.number(Limit::NonNegative)?);
    if low > high {
        v.problem("has its ends the wrong way round", "write the smaller factor first");
        return None;
    }
    Some([low, high])
}

impl Vary {
    /// Draws one flight.
    pub(super) fn apply(&self, plan: &mut FlightPlan, random: &mut Random) {
        // every number is drawn whether it is used or not: switching one off changes no other
        let (turn, share, heading) = (random.between(0.0, TAU), random.between(0.0, 1.0), random.between(0.0, TAU));
        let turn = if self.wind_turns { turn } else { 0.0 };
        let share = self.wind_share.map_or(1.0, |[low, high]| low + share * (high - low));
        let change = Rotation3::from_axis_angle(&Vector3::z_axis(), turn).into_inner() * share;
        plan.wind = plan.wind.mapped(|w| change * w);
        for gust in &mut plan.gusts {
            gust.peak_ned_mps = change * gust.peak_ned_mps;
        }
        if let Some(turbulence) = &mut plan.turbulence {
            turbulence.heading_rad += turn;
            turbulence.wind_at_20ft_mps *= share;
        }
        if self.heading {
            plan.heading_rad = heading;
        }
        if self.one_fault && !plan.faults.is_empty() {
            let chosen = (plan.seed % plan.faults.len() as u64) as usize;
            plan.faults = plan.faults.get(chosen).copied().into_iter().collect();
        }
        let rotors = plan.model.rotors.len();
        for fault in &mut plan.faults {
            let later = random.between(0.0, 1.0) * self.fault_later_s;
            let (rotor, direction) = (random.below(rotors.max(1)), direction(random));
            fault.from_s += later;
            fault.until_s += later;
            if self.fault_place {
                place(&mut fault.kind, rotor, direction);
            }
        }
    }
}

/// Uniform on the sphere.
fn direction(random: &mut Random) -> Vector3<f64> {
    let drawn = Vector3::new(random.normal(), random.normal(), random.normal());
    drawn.try_normalize(1e-12).unwrap_or_else(Vector3::z)
}

/// The same fault at another rotor, or in another direction.
fn place(kind: &mut FaultKind, new_rotor: usize, direction: Vector3<f64>) {
    let level = || direction.xy().try_normalize(1e-12).map_or(Vector3::x(), |d| Vector3::new(d.x, d.y, 0.0));
    match kind {
        FaultKind::RotorWeak { rotor, .. }
        | FaultKind::RotorDamaged { rotor, .. }
        | FaultKind::RotorStuck { rotor, .. } => *rotor = new_rotor,
        FaultKind::AccelBias { bias_mps2: v, .. }
        | FaultKind::GyroBias { bias_rads: v, .. }
        | FaultKind::MagBias { bias_gauss: v } => *v = direction * v.norm(),
        FaultKind::GnssStep { shift_ned_m: v } | FaultKind::GnssRamp { speed_ned_mps: v } => *v = level() * v.norm(),
        FaultKind::BaroBias { bias_pa } => *bias_pa = bias_pa.copysign(direction.z),
        FaultKind::PayloadAttached(_)
        | FaultKind::AccelNoise { .. }
        | FaultKind::AccelFrozen { .. }
        | FaultKind::GyroNoise { .. }
        | FaultKind::GyroFrozen { .. }
        | FaultKind::MagNoise { .. }
        | FaultKind::MagFrozen
        | FaultKind::BaroNoise { .. }
        | FaultKind::BaroFrozen
        | FaultKind::GnssLost
        | FaultKind::Link(_) => {}
    }
}
