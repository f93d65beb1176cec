use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{PI, TAU};

/// Uncertainty of the heading before anything is known of it, rad: so large that the first sample decides.
const UNKNOWN_RAD: f64 = 4.0;
/// A disagreement of this many standard deviations is not noise.
const OUTLIER: f64 = 3.0;
/// Standard deviation of one heading from the magnetometer, rad.
const SAMPLE_RAD: f64 = 0.05;
/// How much the heading may wander while the tilt is not settled, rad/√s.
const DOUBT_RAD: f64 = 0.3;
/// A disagreement beyond this for longer than [`LOST_S`] means that the heading is lost, rad and s.
const LOST_RAD: f64 = 0.6;
const LOST_S: f64 = 5.0;

/// How large the errors are that the heading suffers from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingNoise {
    /// Random walk of the gyro's integral, rad/√s.
    pub gyro_walk: f64,
    /// Gyro bias: unknown at first, and its walk, rad/s and rad/s/√s.
    pub bias_rads: f64,
    pub bias_walk: f64,
    /// What bends the magnetometer's heading (currents, iron, a bias that the autopilot mislearns): standard deviation
    /// (rad) and correlation time (s).
    pub bend_rad: f64,
    pub bend_s: f64,
}

impl Default for HeadingNoise {
    fn default() -> Self {
        Self { gyro_walk: 0.002, bias_rads: 0.002, bias_walk: 1.5e-4, bend_rad: 0.17, bend_s: 300.0 }
    }
}

/// How much a magnetometer sample may turn the heading.
///
/// A Kalman filter for three numbers: the error of the heading, that of the gyro's bias about the vertical, and the
/// bend of the magnetometer's heading. The gyro knows how the heading changes over minutes, the magnetometer what it is
/// in the long run; a bend that comes and goes within a minute turns the heading by a fraction of itself only.
#[derive(Debug, Clone)]
pub(super) struct Heading {
    noise: HeadingNoise,
    p: Matrix3<f64>,
    bend_rad: f64,
    lost_s: f64,
}

/// What one sample of the magnetometer asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HeadingStep {
    /// Turn of the attitude about the vertical, rad, and of the bias about it, rad/s.
    pub turn_rad: f64,
    pub bias_rads: f64,
    /// Disagreement over its standard deviation.
    pub residual: f64,
}

impl Heading {
    pub fn new(noise: HeadingNoise) -> Self {
        let p = Matrix3::from_diagonal(&Vector3::new(UNKNOWN_RAD, noise.bias_rads, noise.bend_rad).map(|s| s * s));
        Self { noise, p, bend_rad: 0.0, lost_s: 0.0 }
    }

    /// The tilt is not settled: it bends the magnetometer's heading by more than itself, so until it is settled the
    /// heading follows the magnetometer.
    pub fn doubt(&mut self, dt_s: f64) {
        self.p[(0, 0)] += DOUBT_RAD * DOUBT_RAD * dt_s;
    }

    pub fn advance(&mut self, dt_s: f64) {
        let n = &self.noise;
        let kept = (-dt_s / n.bend_s).exp();
        self.bend_rad *= kept;
        // a gyro that reads too much turns the estimate too far
        let f = Matrix3::new(1.0, -dt_s, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, kept);
        self.p = f * self.p * f.transpose();
        self.p[(0, 0)] += n.gyro_walk.powi(2) * dt_s;
        self.p[(1, 1)] += n.bias_walk.powi(2) * dt_s;
        self.p[(2, 2)] += n.bend_rad.powi(2) * (1.0 - kept * kept);
    }

    /// The vehicle stands still: the gyro's rate about the vertical is its bias, known to `deviation_rads`. Returns the
    /// share of the difference to take.
    pub fn rest(&mut self, deviation_rads: f64) -> f64 {
        let gain = self.p.column(1) / (self.p[(1, 1)] + deviation_rads * deviation_rads);
        let row = self.p.row(1).into_owned();
        self.p -= gain * row;
        gain[1]
    }

    /// By `wanted_rad` the magnetometer would turn the heading; `interval_s` since its last sample.
    pub fn correct(&mut self, wanted_rad: f64, interval_s: f64) -> HeadingStep {
        let h = Vector3::new(1.0, 0.0, 1.0);
        let mut innovation = wrap(wanted_rad - self.bend_rad);
        let mut ph = self.p * h;
        let mut variance = h.dot(&ph) + SAMPLE_RAD * SAMPLE_RAD;
        if innovation.abs() > LOST_RAD.max(OUTLIER * variance.sqrt()) {
            // neither heading nor bend is told anything until it is clear that it stays
            self.lost_s += interval_s;
            if self.lost_s <= LOST_S {
                let residual = innovation.abs() / variance.sqrt();
                return HeadingStep { turn_rad: 0.0, bias_rads: 0.0, residual };
            }
            let noise = self.noise;
            *self = Self::new(noise);
            innovation = wrap(wanted_rad);
            ph = self.p * h;
            variance = h.dot(&ph) + SAMPLE_RAD * SAMPLE_RAD;
        }
        self.lost_s = 0.0;
        let gain = ph / variance;
        self.p -= gain * ph.transpose();
        self.p = (self.p + self.p.transpose()) * 0.5;
        self.bend_rad += gain[2] * innovation;
        HeadingStep {
            turn_rad: gain[0] * innovation,
            bias_rads: gain[1] * innovation,
            residual: innovation.abs() / variance.sqrt(),
        }
    }
}

/// An angle brought to −π to π.
pub(super) fn wrap(angle_rad: f64) -> f64 {
    (angle_rad + PI).rem_euclid(TAU) - PI
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Follows a magnetometer at 20 Hz for `seconds`; `mag` gives its heading error at a time. Returns the heading's
    /// error and the bias error at the end.
    fn follow(heading: &mut Heading, error: &mut f64, bias: &mut f64, seconds: f64, mag: impl Fn(f64) -> f64) {
        for k in 0..(seconds * 20.0) as usize {
            *error += *bias * 0.05;
            heading.advance(0.05);
            let step = heading.correct(mag(k as f64 * 0.05) - *error, 0.05);
            *error += step.turn_rad;
            *bias -= step.bias_rads;
        }
    }

    #[test]
    fn a_wrong_start_is_put_right_and_a_passing_bend_is_not_followed() {
        let mut h = Heading::new(HeadingNoise::default());
        let (mut error, mut bias) = (1.5, 0.0);
        for _ in 0..500 {
            h.advance(0.02);
            h.rest(0.005);
        }
        follow(&mut h, &mut error, &mut bias, 10.0, |_| 0.0);
        assert!(error.abs() < 0.01, "{error}");
        follow(&mut h, &mut error, &mut bias, 60.0, |_| 0.25);
        assert!(error.abs() < 0.18, "{error} after a minute of a field bent by 0.25");
        follow(&mut h, &mut error, &mut bias, 200.0, |_| 0.0);
        assert!(error.abs() < 0.04, "{error}");
    }

    #[test]
    fn a_biased_gyro_does_not_run_away() {
        let mut h = Heading::new(HeadingNoise::default());
        let (mut error, mut bias) = (0.0, 0.003);
        follow(&mut h, &mut error, &mut bias, 300.0, |_| 0.0);
        assert!(error.abs() < 0.05 && bias.abs() < 5e-4, "{error} {bias}");
    }

    #[test]
    fn a_lost_heading_is_found_again() {
        let mut h = Heading::new(HeadingNoise::default());
        let (mut error, mut bias) = (0.0, 0.0);
        follow(&mut h, &mut error, &mut bias, 60.0, |_| 0.0);
        error = 2.0;
        follow(&mut h, &mut error, &mut bias, 15.0, |_| 0.0);
        assert!(error.abs() < 0.05, "{error}");
    }

    #[test]
    fn standing_still_teaches_the_bias() {
        let mut h = Heading::new(HeadingNoise::default());
        let mut left = 1.0;
        for _ in 0..500 {
            h.advance(0.02);
            left *= 1.0 - h.rest(0.005);
        }
        assert!(left.abs() < 0.02, "{left}");
    }
}
