use crate::signal::Stamp;
use crate::sim::dynamics::Truth;
use std::collections::VecDeque;

type Reader = fn(&Truth) -> f64;

/// What the truth can say of an estimated signal, by the signal's name.
const KNOWN: [(&str, Reader); 23] = [
    ("force_n", |t| t.residual_force_ned_n.x),
    ("force_e", |t| t.residual_force_ned_n.y),
    ("force_d", |t| t.residual_force_ned_n.z),
    ("torque_x", |t| t.residual_torque_frd_nm.x),
    ("torque_y", |t| t.residual_torque_frd_nm.y),
    ("torque_z", |t| t.residual_torque_frd_nm.z),
    ("wind_n", |t| t.wind_ned_mps.x),
    ("wind_e", |t| t.wind_ned_mps.y),
    ("wind_d", |t| t.wind_ned_mps.z),
    ("mass_kg", |t| t.mass_kg),
    ("payload_kg", |t| t.payload_kg),
    ("velocity_n", |t| t.velocity_ned_mps.x),
    ("velocity_e", |t| t.velocity_ned_mps.y),
    ("velocity_d", |t| t.velocity_ned_mps.z),
    ("position_n", |t| t.position_ned_m.x),
    ("position_e", |t| t.position_ned_m.y),
    ("position_d", |t| t.position_ned_m.z),
    ("rate_x", |t| t.rate_frd_rads.x),
    ("rate_y", |t| t.rate_frd_rads.y),
    ("rate_z", |t| t.rate_frd_rads.z),
    ("roll", |t| t.body_to_ned.euler_angles().0),
    ("pitch", |t| t.body_to_ned.euler_angles().1),
    ("yaw", |t| t.body_to_ned.euler_angles().2),
];

/// True for signals that can be scored.
pub fn is_known(signal: &str) -> bool {
    KNOWN.iter().any(|(name, _)| *name == signal)
}

/// The last few seconds of truth, to be looked up by the vehicle's boot clock.
#[derive(Debug, Default)]
pub struct TruthTrack {
    points: VecDeque<(Stamp, Truth)>,
}

/// Estimates are held against the truth of their own stamp, which lies at most this far back, s.
const KEPT_S: f64 = 5.0;
/// Stamps further than this from any point have no truth, s.
const NEAREST_S: f64 = 0.05;

impl TruthTrack {
    /// Appends the truth at a boot time. A boot time that goes back begins anew.
    pub fn push(&mut self, boot: Stamp, truth: Truth) {
        if self.points.back().is_some_and(|(last, _)| boot < *last) {
            self.points.clear();
        }
        self.points.push_back((boot, truth));
        while self.points.front().is_some_and(|(first, _)| boot - *first > KEPT_S) {
            self.points.pop_front();
        }
    }

    /// The truth nearest to a stamp.
    pub fn at(&self, stamp: Stamp) -> Option<&Truth> {
        let after = self.points.partition_point(|(t, _)| *t < stamp);
        let next = self.points.get(after);
        let before = after.checked_sub(1).and_then(|i| self.points.get(i));
        let distance = |p: &(Stamp, Truth)| (p.0 - stamp).abs();
        let nearest = match (before, next) {
            (Some(a), Some(b)) => Some(if distance(a) <= distance(b) { a } else { b }),
            (a, b) => a.or(b),
        };
        nearest.filter(|p| distance(p) <= NEAREST_S).map(|(_, truth)| truth)
    }

    /// True value of a signal at a stamp; `None` for what is not known.
    pub fn value(&self, signal: &str, stamp: Stamp) -> Option<f64> {
        let (_, read) = KNOWN.iter().find(|(name, _)| *name == signal)?;
        self.at(stamp).map(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::{FlightPlan, SimVehicle};
    use crate::vehicle::resolve;

    #[test]
    fn the_nearest_point_answers_and_a_distant_one_does_not() {
        let mut v = SimVehicle::new(&FlightPlan::calm(resolve("px4-sih").unwrap(), 1)).unwrap();
        let mut track = TruthTrack::default();
        for _ in 0..1000 {
            let truth = v.advance().truth;
            track.push(truth.stamp, truth);
        }
        let end = v.now().truth.stamp;
        assert_eq!(track.at(end.plus_secs(0.01)).unwrap().stamp, end);
        assert_eq!(track.at(end.plus_secs(-1.0001)).unwrap().stamp, end.plus_secs(-1.0));
        assert!(track.at(end.plus_secs(0.1)).is_none() && track.at(Stamp::from_secs(-1.0)).is_none());
        assert_eq!(track.value("wind_n", end), Some(0.0));
        assert_eq!((track.value("mass_kg", end), track.value("payload_kg", end)), (Some(1.0), Some(0.0)));
        assert_eq!(track.value("colour", end), None);
    }
}
