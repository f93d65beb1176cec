use super::Reference;
use nalgebra::Vector3;

/// Turns wishes (go there, fly that fast) into a reference without jumps: velocity is slewed within an acceleration,
/// position is its integral.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shaper {
    pub position: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub acceleration: Vector3<f64>,
    pub yaw_rad: f64,
    acceleration_limit: f64,
    yaw_rate_limit: f64,
}

impl Shaper {
    pub fn at(position: Vector3<f64>, yaw_rad: f64, acceleration_limit: f64) -> Self {
        Self {
            position,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            yaw_rad,
            acceleration_limit,
            yaw_rate_limit: 0.8,
        }
    }

    /// One step towards a point at no more than `speed`, braking in time to stop there.
    pub fn towards(&mut self, target: Vector3<f64>, speed: f64, dt: f64) {
        let way = target - self.position;
        let distance = way.norm();
        // brake with half the limit; near the target approach exponentially instead of overshooting by a step
        let approach = (self.acceleration_limit * distance).sqrt().min(1.5 * distance);
        let wish = if distance > 1e-9 { way * (speed.min(approach) / distance) } else { Vector3::zeros() };
        self.with_velocity(wish, dt);
    }

    /// One step towards a velocity.
    pub fn with_velocity(&mut self, wish: Vector3<f64>, dt: f64) {
        let change = wish - self.velocity;
        let size = change.norm();
        let most = self.acceleration_limit * dt;
        let change = if size > most { change * (most / size) } else { change };
        self.acceleration = change / dt;
        self.position += (self.velocity + change * 0.5) * dt;
        self.velocity += change;
    }

    /// One step of the heading, the short way round.
    pub fn turn(&mut self, target_rad: f64, dt: f64) {
        let error = wrap(target_rad - self.yaw_rad);
        self.yaw_rad = wrap(self.yaw_rad + error.clamp(-self.yaw_rate_limit * dt, self.yaw_rate_limit * dt));
    }

    pub fn reference(&self) -> Reference {
        Reference {
            position_ned_m: self.position,
            velocity_ned_mps: self.velocity,
            acceleration_ned_mps2: self.acceleration,
            yaw_rad: self.yaw_rad,
        }
    }
}

/// An angle in −π..π.
pub(in crate::sim) fn wrap(angle: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    (angle + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrives_without_overshoot_within_its_limits() {
        let mut s = Shaper::at(Vector3::zeros(), 0.0, 2.5);
        let target = Vector3::new(40.0, 0.0, -5.0);
        let (mut top, mut farthest): (f64, f64) = (0.0, 0.0);
        for _ in 0..15_000 {
            s.towards(target, 5.0, 0.0025);
            top = top.max(s.velocity.norm());
            farthest = farthest.max(s.position.x);
            assert!(s.acceleration.norm() < 2.5 + 1e-9);
        }
        assert!((s.position - target).norm() < 1e-3 && farthest < 40.01 && (4.99..5.01).contains(&top));
    }

    #[test]
    fn turns_the_short_way() {
        let mut s = Shaper::at(Vector3::zeros(), 3.0, 1.0);
        s.turn(-3.0, 0.1);
        assert!(s.yaw_rad > 3.0);
        assert!((wrap(7.0) - (7.0 - std::f64::consts::TAU)).abs() < 1e-12);
    }
}
