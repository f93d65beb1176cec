//! How the rotors turn the body: angular acceleration per thrust, rotor lag, and delays.
//!
//! `ω̇ = effectiveness·Σ lever·T − damping·ω + constant` on each body axis, both sides smoothed by a bump (see
//! [`super::smooth`]), constants free in every few seconds. Thrust is per mass, so the effectiveness of roll and pitch
//! is arm·m/I, and that of yaw torque-ratio·m/I.

use super::Quantity;
use super::bins::{Drive, Reference};
use super::flight::Flight;
use super::regress::{Fit, Rows};
use super::series::median;
use super::smooth::{Bump, STEP_S, lag, vertex};
use crate::vehicle::airframe::Airframe;
use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

/// Width of the bump, s: longer than some samples of 50 Hz telemetry, shorter than a vehicle's swing.
const BUMP_S: f64 = 0.24;
/// Constants of the torque balance hold this long, s.
const CLUSTER_S: f64 = 4.0;
/// Every how many points of the grid a row is taken.
const STRIDE: usize = 5;
/// Telemetry slower than this cannot show torques, s between samples.
const SLOWEST_S: f64 = 0.06;
const LAGS_S: [f64; 8] = [0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.07, 0.1];
/// Delays from −80 to 80 ms are looked at, in points of the grid.
const REACH: isize = 20;
/// Longest stretch of flight that is used, s: more adds little and takes long.
const LONGEST_S: f64 = 420.0;

/// Rotation about one body axis.
#[derive(Debug, Clone)]
pub struct AxisFit {
    /// Angular acceleration per lever-weighted thrust per mass, rad/s² per N/kg (lever 1: the longest arm, or for yaw
    /// the sense of rotation).
    pub effectiveness: Quantity,
    /// Of each rotor, fitted on its own, with its sign: rad/s² per N/kg.
    pub rotors: Vec<Quantity>,
    /// 1/s.
    pub damping: Quantity,
    /// Share of the angular acceleration that the model explains.
    pub explained: f64,
}

#[derive(Debug, Clone)]
pub struct TorqueFit {
    /// Roll, pitch, yaw.
    pub axes: [AxisFit; 3],
    pub time_constant_s: Quantity,
    /// From the actuator message's stamp to the rotor.
    pub actuator_delay_s: Quantity,
    /// By how much the gyro trails the attitude.
    pub gyro_delay_s: Quantity,
}

/// Lever of a rotor for roll, pitch and yaw: thrust times lever is torque over arm (over torque ratio for yaw).
pub fn levers(airframe: &Airframe) -> Vec<Vector3<f64>> {
    let lever = |p: &crate::vehicle::airframe::Place| {
        Vector3::new(-p.forward_right.y, p.forward_right.x, p.spin.reaction_sign())
    };
    airframe.places.iter().map(lever).collect()
}

/// Fits the rotation, given one rotor's full thrust per mass. `None` where the telemetry is too slow or too short.
pub fn fit(
    flight: &Flight,
    airframe: &Airframe,
    reference: Reference,
    max_npkg: f64,
    spans: &[(f64, f64)],
) -> Option<TorqueFit> {
    if flight.imu().period_s() > SLOWEST_S || flight.outputs.period_s() > SLOWEST_S {
        return None;
    }
    let bump = Bump::new(BUMP_S);
    let mut tracks = Vec::new();
    let mut left = LONGEST_S;
    for (a, b) in spans {
        let b = b.min(a + left);
        left -= b - a;
        tracks.extend(Track::new(flight, airframe, reference, max_npkg, (*a, b), &bump));
    }
    if tracks.is_empty() {
        return None;
    }
    let levers = levers(airframe);
    let fits = LAGS_S.map(|tau| {
        let lagged: Vec<Vec<Vec<f64>>> =
            tracks.iter().map(|t| t.thrust.iter().map(|x| lag(x, tau)).collect()).collect();
        let best = [0, 1, 2].map(|axis| best_delay(&tracks, &lagged, &levers, axis));
        (tau, lagged, best)
    });
    // of roll and pitch together: what is left unexplained
    let left_over = |best: &[Option<Delay>; 3]| match (best[0], best[1]) {
        (Some(roll), Some(pitch)) => Some(2.0 - roll.explained - pitch.explained),
        _ => None,
    };
    let least = fits.iter().filter_map(|(_, _, best)| left_over(best)).min_by(f64::total_cmp)?;
    let good: Vec<_> = fits.iter().filter(|(_, _, best)| left_over(best).is_some_and(|l| l <= 1.04 * least)).collect();
    let (first, last) = (good.first()?, good.last()?);
    let (tau, lagged, best) = first;
    let spread = 0.5 * (last.0 - tau) + 0.5 * (LAGS_S[1] - LAGS_S[0]);

    let gyro = gyro_delay(&tracks);
    // the gyro's stamp less the command's: what is not the gyro's own delay is the actuators'
    let total = 0.5 * (best[0]?.delay_s + best[1]?.delay_s);
    let trailing = gyro.map_or(total, |g| g.max(total)).clamp(0.0, 0.3);
    let seen = gyro.is_some() && least < 0.3;
    let missing = (!seen).then_some("brisk roll and pitch with 50 Hz of IMU, attitude and outputs");
    // delays that nothing shows are better left at zero than set by chance
    let delay = |value: f64, sigma: f64| {
        if seen { Quantity { value, sigma, missing } } else { Quantity { value: 0.0, sigma: 0.02, missing } }
    };
    let axis =
        |k: usize| -> Option<AxisFit> { axis_fit(&tracks, lagged, &levers, k, best[k]?, smoothed_noise(flight, k)) };
    Some(TorqueFit {
        axes: [axis(0)?, axis(1)?, axis(2)?],
        time_constant_s: Quantity {
            value: *tau,
            sigma: spread,
            missing: (spread > 0.03).then_some("short, hard roll and pitch commands at 50 Hz of telemetry or more"),
        },
        actuator_delay_s: delay((trailing - total).max(0.0), spread.max(STEP_S)),
        gyro_delay_s: delay(trailing, STEP_S),
    })
}

#[derive(Debug, Clone, Copy)]
struct Delay {
    points: isize,
    delay_s: f64,
    explained: f64,
}

fn best_delay(tracks: &[Track], lagged: &[Vec<Vec<f64>>], levers: &[Vector3<f64>], axis: usize) -> Option<Delay> {
    let explained: Vec<f64> = (-REACH..=REACH)
        .map(|d| rows(tracks, lagged, levers, axis, d, false).plain_explained().unwrap_or_default())
        .collect();
    let best = (0..explained.len()).max_by(|a, b| explained[*a].total_cmp(&explained[*b]))?;
    let points = best as isize - REACH;
    let delay_s = (points as f64 + vertex(&explained, best)) * STEP_S;
    Some(Delay { points, delay_s, explained: explained[best] })
}

fn axis_fit(
    tracks: &[Track],
    lagged: &[Vec<Vec<f64>>],
    levers: &[Vector3<f64>],
    axis: usize,
    delay: Delay,
    gyro_noise: f64,
) -> Option<AxisFit> {
    const MANOEUVRE: [&str; 3] = ["roll left and right briskly", "pitch briskly", "turn left and right briskly"];
    let fit = rows(tracks, lagged, levers, axis, delay.points, false).fit()?;
    let share = true_share(&fit, gyro_noise);
    let quantity = |fit: &Fit, i: usize, factor: f64| {
        let value = fit.beta[i] * factor / share;
        let sigma = (fit.sigma(i) * factor / share).hypot(0.5 * (1.0 - share) * value);
        let missing = (sigma > 0.1 * value.abs() || fit.explained < 0.7).then_some(MANOEUVRE[axis]);
        Quantity { value, sigma, missing }
    };
    let each = rows(tracks, lagged, levers, axis, delay.points, true).fit();
    let rotors = match &each {
        Some(each) => levers.iter().enumerate().map(|(i, l)| quantity(each, i, l[axis])).collect(),
        None => vec![Quantity::unknown(MANOEUVRE[axis]); levers.len()],
    };
    let damping = Quantity::observed(-fit.beta[1] / share, fit.sigma(1) / share);
    Some(AxisFit { effectiveness: quantity(&fit, 0, 1.0), rotors, damping, explained: fit.explained })
}

/// The share of what the commands seem to vary (beyond what the rate explains) that is true.
///
/// Commands change faster than telemetry samples them, so the smoothed command carries an error, and an error in a
/// regressor shrinks its coefficient by exactly this share (errors in variables). What is left unexplained is laid at
/// its door, save for what the gyro's own noise explains.
fn true_share(fit: &Fit, gyro_noise: f64) -> f64 {
    let in_commands = (fit.left - gyro_noise * fit.weight).max(0.0);
    let alone = fit.alone(0);
    (alone / (alone + in_commands)).clamp(0.7, 1.0)
}

/// Variance that white noise of the gyro leaves in the smoothed angular acceleration, rad²/s⁴: σ²·period·∫φ̇².
fn smoothed_noise(flight: &Flight, axis: usize) -> f64 {
    let imu: Vec<_> = flight.imu().iter().collect();
    let mut apart: Vec<f64> = imu
        .windows(3)
        .map(|w| {
            let [a, b, c] = [0, 1, 2].map(|i| w[i].1.rate_frd_rads[axis]);
            (b - 0.5 * (a + c)).abs()
        })
        .collect();
    // a normal variable's median size is 0.6745 σ; the second difference of white noise has √1.5 of its σ
    let sigma = median(&mut apart).unwrap_or_default() / 0.6745 / 1.5_f64.sqrt();
    let slope_energy = 2.0 * std::f64::consts::PI.powi(2) / BUMP_S.powi(3);
    sigma * sigma * flight.imu().period_s() * slope_energy
}

/// Rows of one axis, the gyro read `delay` points later than the commands. `each`: a column for every rotor.
fn rows(
    tracks: &[Track],
    lagged: &[Vec<Vec<f64>>],
    levers: &[Vector3<f64>],
    axis: usize,
    delay: isize,
    each: bool,
) -> Rows {
    let drives = if each { levers.len() } else { 1 };
    let (mut x, mut y, mut cluster) = (Vec::new(), Vec::new(), Vec::new());
    let mut first = 0;
    for (track, thrust) in tracks.iter().zip(lagged) {
        let mut newest = first;
        for i in track.usable().step_by(STRIDE) {
            let Some(at) = i.checked_add_signed(delay) else { continue };
            if !track.whole(i) || !track.whole(at) {
                continue;
            }
            let push = thrust.iter().zip(levers).map(|(t, l)| t[i] * l[axis]);
            if each {
                x.extend(push)
            } else {
                x.push(push.sum())
            }
            x.push(track.rate[axis][at]);
            y.push(track.acceleration[axis][at]);
            newest = first + (i as f64 * STEP_S / CLUSTER_S) as usize;
            cluster.push(newest);
        }
        first = newest + 1;
    }
    // clusters must be numbered without gaps
    let mut numbers = std::collections::BTreeMap::new();
    for c in &mut cluster {
        let next = numbers.len();
        *c = *numbers.entry(*c).or_insert(next);
    }
    Rows { x: DMatrix::from_row_slice(y.len(), drives + 1, &x), y: DVector::from_vec(y), cluster }.without_means()
}

/// By how much the gyro's stamps trail those of the attitude's rate, s.
fn gyro_delay(tracks: &[Track]) -> Option<f64> {
    let explained: Vec<f64> = (-REACH..=REACH)
        .map(|d| {
            let (mut xy, mut xx, mut yy) = (0.0, 0.0, 1e-300);
            for t in tracks {
                for i in t.usable().step_by(STRIDE) {
                    let Some(at) = i.checked_add_signed(d).filter(|at| t.whole(i) && t.whole(*at)) else { continue };
                    for axis in 0..2 {
                        let (x, y) = (t.attitude_rate[axis][i], t.rate[axis][at]);
                        (xy, xx, yy) = (xy + x * y, xx + x * x, yy + y * y);
                    }
                }
            }
            if xx > 0.0 { xy * xy / (xx * yy) } else { 0.0 }
        })
        .collect();
    let best = (0..explained.len()).max_by(|a, b| explained[*a].total_cmp(&explained[*b]))?;
    (explained[best] > 0.7).then(|| (best as isize - REACH) as f64 * STEP_S + vertex(&explained, best) * STEP_S)
}

/// A stretch of free flight on the grid, smoothed.
struct Track {
    /// Of each rotor, N/kg.
    thrust: Vec<Vec<f64>>,
    /// Body rate, rad/s, and angular acceleration, rad/s².
    rate: [Vec<f64>; 3],
    acceleration: [Vec<f64>; 3],
    /// Body rate as the attitude moves, rad/s.
    attitude_rate: [Vec<f64>; 3],
    /// How many points up to each have all channels.
    counted: Vec<usize>,
    reach: usize,
}

impl Track {
    fn new(
        flight: &Flight,
        airframe: &Airframe,
        reference: Reference,
        max_npkg: f64,
        span: (f64, f64),
        bump: &Bump,
    ) -> Option<Self> {
        let n = ((span.1 - span.0) / STEP_S) as usize;
        if n < 20 * bump.reach() {
            return None;
        }
        let mut thrust = vec![vec![0.0; n]; airframe.places.len()];
        let mut rate = [vec![0.0; n], vec![0.0; n], vec![0.0; n]];
        let mut turned = rate.clone();
        let mut counted = Vec::with_capacity(n);
        let mut good = 0;
        let half = 0.5 * flight.attitude.period_s().max(STEP_S);
        let slerp = |a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>, s: f64| a.try_slerp(b, s, 1e-9).unwrap_or(*b);
        for i in 0..n {
            let t = span.0 + i as f64 * STEP_S;
            let imu = flight.imu().interpolate(t, |a, b, s| crate::signal::Imu {
                accel_frd_mps2: a.accel_frd_mps2.lerp(&b.accel_frd_mps2, s),
                rate_frd_rads: a.rate_frd_rads.lerp(&b.rate_frd_rads, s),
            });
            let outputs = flight.outputs.interpolate(t, |a, b, s| std::array::from_fn(|k| a[k] + s * (b[k] - a[k])));
            if let (Some(imu), Some(outputs)) = (imu, outputs) {
                good += 1;
                let drive = Drive::new(flight, airframe, reference, t, &outputs);
                for (track, shape) in thrust.iter_mut().zip(drive.shape) {
                    track[i] = max_npkg * shape;
                }
                for (track, w) in rate.iter_mut().zip(imu.rate_frd_rads.iter()) {
                    track[i] = *w;
                }
            }
            counted.push(good);
            let ends = [t - half, t + half].map(|t| flight.attitude.interpolate(t, slerp));
            if let [Some(a), Some(b)] = ends {
                let w = (a.inverse() * b).scaled_axis() / (2.0 * half);
                for (track, w) in turned.iter_mut().zip(w.iter()) {
                    track[i] = *w;
                }
            }
        }
        Some(Self {
            thrust: thrust.iter().map(|x| bump.smooth(x)).collect(),
            acceleration: [0, 1, 2].map(|k| bump.differentiate(&rate[k])),
            rate: rate.map(|x| bump.smooth(&x)),
            attitude_rate: turned.map(|x| bump.smooth(&x)),
            counted,
            reach: bump.reach(),
        })
    }

    /// Points whose smoothing and whose delays stay inside.
    fn usable(&self) -> std::ops::Range<usize> {
        let margin = 3 * self.reach + REACH as usize;
        margin..self.counted.len().saturating_sub(margin)
    }

    /// Has everything that the smoothed point rests on been measured?
    fn whole(&self, i: usize) -> bool {
        let (Some(from), Some(to)) = (i.checked_sub(self.reach), self.counted.get(i + self.reach)) else {
            return false;
        };
        *to - self.counted[from] == 2 * self.reach
    }
}
