use super::instant::Flow;
use crate::vehicle::Vehicle;

/// Deviation of a receiver's velocity, from its carrier's Doppler shift, m/s.
const GNSS_SIGMA_MPS: f64 = 0.1;
/// Time over which it is averaged where the autopilot's velocity is just as good, s; it grows steeply where that is
/// better, as fixes come late and a late velocity is a wrong one.
const EQUAL_S: f64 = 0.5;
/// A declared bound is taken as this many standard deviations.
const BOUND_IN_SIGMAS: f64 = 3.0;

/// What the autopilot's velocity lacks, by the receiver's own: the better the autopilot's is declared to be, the slower
/// it is corrected, and never by more than it is declared to be off.
///
/// An autopilot that has learnt a wrong accelerometer bias or heading carries tenths of a metre a second for minutes; its
/// receiver does not, but comes late and seldom.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Drift {
    lacks_mps: [f64; 2],
    since_fix_s: f64,
}

impl Drift {
    pub fn step(&mut self, vehicle: &Vehicle, flow: &Flow, dt_s: f64) -> [f64; 2] {
        self.since_fix_s += dt_s;
        if let Some(fix) = flow.gnss_velocity_mps {
            for (i, (lacks, fix)) in self.lacks_mps.iter_mut().zip(fix).enumerate() {
                let declared = vehicle.noise.velocity_mps[i];
                let sigma = (declared / BOUND_IN_SIGMAS).max(1e-3);
                let time_s = EQUAL_S * (GNSS_SIGMA_MPS / sigma).powi(4);
                let fresh = 1.0 - (-self.since_fix_s / time_s).exp();
                *lacks += fresh * (fix - flow.velocity_ned_mps[i] - *lacks);
                *lacks = lacks.clamp(-declared, declared);
            }
            self.since_fix_s = 0.0;
        }
        self.lacks_mps
    }
}
