use super::bins::Bin;
use super::flight::Flight;
use super::series::quantile;
use crate::vehicle::GRAVITY_MPS2;
use nalgebra::Vector3;

/// Of the largest errors that a flight shows, a bound keeps this much distance.
const MARGIN: f64 = 1.5;
/// Scatter says nothing of errors that last: stamps that are 10 ms off cost this much in an ordinary manoeuvre.
const LEAST_ACCEL_MPS2: f64 = 0.08;
const LEAST_GYRO_RADS: f64 = 0.03;
/// Attitude, velocity and accelerometer are held against each other over this long, s.
const CONSISTENCY_S: f64 = 2.0;

/// Estimates of the noise bounds. No truth is at hand: these come from how the sensors scatter and contradict each
/// other, and a constant error that all share does not show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Of one sample, body FRD.
    pub accel_mps2: [f64; 3],
    pub gyro_rads: [f64; 3],
    pub accel_bias_mps2: [f64; 3],
    pub velocity_mps: [f64; 3],
    pub tilt_rad: f64,
}

pub(super) fn bounds(flight: &Flight, bins: &[Bin], spans: &[(f64, f64)]) -> Noise {
    let samples: Vec<_> =
        flight.imu().iter().filter(|(t, _)| spans.iter().any(|(a, b)| (*a..=*b).contains(t))).collect();
    let scatter = |pick: &dyn Fn(&crate::signal::Imu) -> f64| {
        // against the mean of both neighbours: what moves smoothly drops out; a white noise is seen √1.5 times
        let mut sizes: Vec<f64> = samples
            .windows(3)
            .filter(|w| w[2].0 - w[0].0 < 0.1)
            .map(|w| (pick(&w[1].1) - 0.5 * (pick(&w[0].1) + pick(&w[2].1))).abs() / 1.5_f64.sqrt())
            .collect();
        quantile(&mut sizes, 0.99).map(|q| MARGIN * q)
    };
    let accel = |k: usize| scatter(&|imu| imu.accel_frd_mps2[k]).unwrap_or(0.5).clamp(LEAST_ACCEL_MPS2, 20.0);
    let gyro = |k: usize| scatter(&|imu| imu.rate_frd_rads[k]).unwrap_or(0.03).clamp(LEAST_GYRO_RADS, 2.0);

    let (tilt, velocity, bias) = consistency(bins);
    Noise {
        accel_mps2: [accel(0), accel(1), accel(2)],
        gyro_rads: [gyro(0), gyro(1), gyro(2)],
        accel_bias_mps2: bias,
        velocity_mps: [velocity; 3],
        tilt_rad: tilt,
    }
}

/// What the velocity's change says against the specific force, turned by the attitude: a bound of tilt (rad), of
/// velocity (m/s), and of a constant accelerometer error (m/s²).
fn consistency(bins: &[Bin]) -> (f64, f64, [f64; 3]) {
    let n = (CONSISTENCY_S / 0.1) as usize;
    let gravity = Vector3::new(0.0, 0.0, GRAVITY_MPS2);
    let (mut drift, mut bias, mut count) = (Vec::new(), Vector3::zeros(), 0.0);
    for w in bins.windows(n + 1).step_by(n / 4) {
        let (a, b) = (&w[0], &w[n]);
        if a.span != b.span || b.t_s - a.t_s > 1.2 * CONSISTENCY_S {
            continue;
        }
        let trapezoid = |i: usize| if i == 0 || i == n { 0.5 } else { 1.0 };
        let force: Vector3<f64> =
            w.iter().enumerate().map(|(i, b)| (b.rotation * b.accel_frd_mps2 + gravity) * trapezoid(i)).sum();
        let error = b.velocity_ned_mps - a.velocity_ned_mps - force * ((b.t_s - a.t_s) / n as f64);
        drift.push(error.xy().norm());
        bias += w[n / 2].rotation.tr_mul(&(error / (b.t_s - a.t_s)));
        count += 1.0;
    }
    if count < 5.0 {
        return (1.5_f64.to_radians(), 0.3, [0.1; 3]);
    }
    let error = MARGIN * quantile(&mut drift, 0.95).unwrap_or(0.3);
    let bias = (bias / count).map(|b| (MARGIN * b.abs()).clamp(0.02, 0.3));
    let tilt = (error / CONSISTENCY_S / GRAVITY_MPS2).clamp(0.3_f64.to_radians(), 5.0_f64.to_radians());
    (tilt, error.clamp(0.1, 1.0), bias.into())
}
