use super::gains::{AxisGains, NavigationGains};
use crate::signal::Stamp;
use crate::vehicle::GRAVITY_MPS2;
use nalgebra::{Matrix2, Vector2, Vector3};

/// Steps that a delayed fix may lie back.
const KEPT: usize = 64;
/// Time constant with which the barometer's height is tied to the receiver's, s.
const TIE_S: f64 = 60.0;

/// Σ₂ with its extension: position, velocity and ξ, eqs. (24a)–(24c).
///
/// The paper's injection acts on continuous measurements. Between samples the innovation of the last one is carried on
/// by the observer's own model of it, ė = −ℭKe: that is what the continuous observer would see if the measured
/// quantity moved as predicted. So a sample is worked in over the following moments, at any rate of samples, and
/// nothing is taken in twice. The step is implicit and so stable however fast the gains are.
#[derive(Debug, Clone)]
pub(super) struct Translation {
    gains: NavigationGains,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    /// ξ: what the estimated specific force has beside R̂a_b.
    xi: Vector3<f64>,
    /// Innovation of position and velocity that is still to be worked in, by axis.
    pending: [Vector2<f64>; 3],
    /// Does the barometer give the height now?
    barometer: bool,
    /// Height of the barometer above that of the receiver, m, and for how long that has been averaged.
    offset: Option<(f64, f64)>,
    past: [Past; KEPT],
    newest: usize,
    filled: usize,
    /// All corrections so far, to bring a past state up to date.
    corrected: [Vector3<f64>; 2],
}

/// The state at a past step, and the corrections up to it.
#[derive(Debug, Clone, Copy, Default)]
struct Past {
    stamp: Stamp,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    corrected: [Vector3<f64>; 2],
}

impl Translation {
    pub fn new(gains: NavigationGains, stamp: Stamp, position: Vector3<f64>, velocity: Vector3<f64>) -> Self {
        let mut new = Self {
            gains,
            position,
            velocity,
            xi: Vector3::zeros(),
            pending: [Vector2::zeros(); 3],
            barometer: false,
            offset: None,
            past: [Past::default(); KEPT],
            newest: 0,
            filled: 0,
            corrected: [Vector3::zeros(); 2],
        };
        new.remember(stamp);
        new
    }

    pub fn position(&self) -> Vector3<f64> {
        self.position
    }

    pub fn velocity(&self) -> Vector3<f64> {
        self.velocity
    }

    /// The estimated specific force in NED, ẑ = R̂a_b + ξ, from R̂a_b.
    pub fn force(&self, turned: Vector3<f64>) -> Vector3<f64> {
        turned + self.xi
    }

    /// The attitude was corrected, which changed R̂a_b by this: ẑ stays (the first term of eq. 24c).
    pub fn attitude_changed(&mut self, by: Vector3<f64>) {
        self.xi -= by;
    }

    /// GNSS is lost: ξ is forgotten by a share in the axes that nothing feeds.
    pub fn forget_force(&mut self, share: f64) {
        for axis in 0..if self.barometer { 2 } else { 3 } {
            self.xi[axis] *= 1.0 - share;
            self.pending[axis] = Vector2::zeros();
        }
    }

    /// One step with R̂a_b.
    pub fn advance(&mut self, stamp: Stamp, turned: Vector3<f64>, dt_s: f64) {
        let acceleration = self.force(turned) + Vector3::new(0.0, 0.0, GRAVITY_MPS2);
        self.position += self.velocity * dt_s + acceleration * (0.5 * dt_s * dt_s);
        self.velocity += acceleration * dt_s;
        for axis in 0..3 {
            let gains = self.axis_gains(axis);
            let [[pp, pv], [vp, vv]] = gains.decay();
            let implicit = Matrix2::new(1.0 + pp * dt_s, pv * dt_s, vp * dt_s, 1.0 + vv * dt_s);
            // the decay of a stable observer has no negative eigenvalue, so the inverse exists
            let left = implicit.try_inverse().map_or(Vector2::zeros(), |inverse| inverse * self.pending[axis]);
            self.pending[axis] = left;
            let from_velocity = gains.velocity.unwrap_or([0.0; 3]);
            let step = |k: usize| (gains.position[k] * left.x + from_velocity[k] * left.y) * dt_s;
            self.position[axis] += step(0);
            self.velocity[axis] += step(1);
            self.xi[axis] += step(2);
            self.corrected[0][axis] += step(0);
            self.corrected[1][axis] += step(1);
        }
        self.remember(stamp);
    }

    fn axis_gains(&self, axis: usize) -> AxisGains {
        match (axis, self.barometer) {
            (0 | 1, _) => self.gains.level,
            (_, false) => self.gains.gnss_height,
            (_, true) => self.gains.barometer_height,
        }
    }

    fn remember(&mut self, stamp: Stamp) {
        self.newest = (self.newest + 1) % KEPT;
        self.past[self.newest] =
            Past { stamp, position: self.position, velocity: self.velocity, corrected: self.corrected };
        self.filled = (self.filled + 1).min(KEPT);
    }

    /// Position and velocity at an instant in the past, as corrected since; the oldest kept where it lies before.
    fn at(&self, stamp: Stamp) -> [Vector3<f64>; 2] {
        let mut later = self.past[self.newest];
        let mut found = [later.position, later.velocity];
        let mut corrected = later.corrected;
        for back in 1..self.filled {
            if stamp >= later.stamp {
                break;
            }
            let earlier = self.past[(self.newest + KEPT - back) % KEPT];
            let span = later.stamp - earlier.stamp;
            let share = if span > 0.0 { ((stamp - earlier.stamp) / span).clamp(0.0, 1.0) } else { 1.0 };
            found = [earlier.position.lerp(&later.position, share), earlier.velocity.lerp(&later.velocity, share)];
            corrected = [0, 1].map(|k: usize| earlier.corrected[k].lerp(&later.corrected[k], share));
            later = earlier;
        }
        [0, 1].map(|k: usize| found[k] + self.corrected[k] - corrected[k])
    }

    /// Takes in a fix that was true at `stamp`. Returns the innovations: position, and level velocity.
    pub fn fix(
        &mut self,
        stamp: Stamp,
        position: Vector3<f64>,
        ground_velocity: Option<[f64; 2]>,
        down_velocity: Option<f64>,
    ) -> [Vector3<f64>; 2] {
        let [p, v] = self.at(stamp);
        let by_position = position - p;
        let measured = [ground_velocity.map(|g| g[0]), ground_velocity.map(|g| g[1]), down_velocity];
        let by_velocity = Vector3::from_fn(|i, _| measured[i].map_or(0.0, |m| m - v[i]));
        for axis in 0..2 {
            self.pending[axis] = Vector2::new(by_position[axis], by_velocity[axis]);
        }
        if !self.barometer {
            self.pending[2] = Vector2::new(by_position.z, 0.0);
        }
        [by_position, by_velocity]
    }

    /// Takes in a height from the barometer, tied to the receiver's by `receiver_height_m` where there is a fix.
    pub fn height(&mut self, height_m: f64, receiver_height_m: Option<f64>, interval_s: f64) {
        if let Some(receiver) = receiver_height_m {
            let seen = height_m - receiver;
            let (offset, since) = self.offset.unwrap_or((seen, 0.0));
            let share = interval_s / (since + interval_s).clamp(interval_s, TIE_S);
            self.offset = Some((offset + share * (seen - offset), (since + interval_s).min(TIE_S)));
        }
        if let Some((offset, _)) = self.offset {
            self.barometer = true;
            self.pending[2] = Vector2::new(-(height_m - offset) - self.position.z, 0.0);
        }
    }

    /// The barometer is silent: the receiver gives the height again.
    pub fn without_barometer(&mut self) {
        if self.barometer {
            self.barometer = false;
            self.offset = None;
            self.pending[2] = Vector2::zeros();
        }
    }

    pub fn is_finite(&self) -> bool {
        self.position.iter().chain(&self.velocity).chain(&self.xi).all(|x| x.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::super::gains::NavigationGoal;
    use super::*;

    /// A vehicle that accelerates at a constant 0.5 m/s² north, whose R̂a_b does not show it: ξ must find it.
    fn fly(latency_s: f64, told_s: f64, noise: f64) -> (f64, f64, f64) {
        let gains = NavigationGains::new(&NavigationGoal::default()).unwrap();
        let truth = |t: f64| (0.25 * t * t, 0.5 * t);
        let mut x = Translation::new(gains, Stamp::default(), Vector3::zeros(), Vector3::zeros());
        let turned = Vector3::new(0.0, 0.0, -GRAVITY_MPS2);
        let mut errors = (0.0, 0.0, 0.0);
        for k in 1..6000 {
            let t = 0.01 * f64::from(k);
            let stamp = Stamp::from_secs(t);
            x.advance(stamp, turned, 0.01);
            if k % 20 == 0 {
                let (p, v) = truth(t - latency_s);
                let wiggle = noise * f64::from(k).sin();
                let position = Vector3::new(p + wiggle, 0.0, 0.0);
                x.fix(stamp.plus_secs(-told_s), position, Some([v + 0.1 * wiggle, 0.0]), None);
            }
            let (p, v) = truth(t);
            errors = (x.position.x - p, x.velocity.x - v, x.xi.x - 0.5);
        }
        errors
    }

    #[test]
    fn an_unseen_acceleration_is_found() {
        let (p, v, z) = fly(0.0, 0.0, 0.0);
        assert!(p.abs() < 0.02 && v.abs() < 0.01 && z.abs() < 0.01, "{p} {v} {z}");
        let (p, v, z) = fly(0.0, 0.0, 0.3);
        assert!(p.abs() < 0.3 && v.abs() < 0.1 && z.abs() < 0.2, "{p} {v} {z}");
    }

    #[test]
    fn a_known_delay_costs_nothing_and_an_unknown_one_does() {
        let (p, v, _) = fly(0.2, 0.2, 0.0);
        assert!(p.abs() < 0.05 && v.abs() < 0.02, "{p} {v}");
        let (_, v, _) = fly(0.2, 0.0, 0.0);
        assert!(v.abs() > 0.08, "{v}");
    }
}
