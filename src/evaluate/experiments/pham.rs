use super::{Experiment, ExperimentError, Findings, Limit, Trace};
use crate::observers::{self, OptionValue, Options};
use crate::signal::{Actuation, Aged, Discontinuity, Imu, MAX_ROTORS, Measurement, RotorCommands, Stamp};
use crate::vehicle;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use std::f64::consts::TAU;

const NAME: &str = "pham-mass";

pub const EXPERIMENT: Experiment = Experiment {
    name: NAME,
    paper: "Pham, Ichalal, Mammar 2020, section IV",
    about: "Torque on a quadrotor that drops from 2 to 1.12 kg at 5 s and takes the load up again at 25 s, its inertia \
            with it: step, impulse, random and sine torques, rate noise 2e-3 rad/s",
    run,
};

/// Length of one run and step of its integration, s.
const END_S: f64 = 30.0;
const FINE_S: f64 = 2.5e-4;
/// Standard deviations of the measurements: rad/s as asked for, rad.
const RATE_NOISE: f64 = 2e-3;
const ANGLE_NOISE: f64 = 5e-4;
/// When the mass changes, s.
const LIGHT_FROM_S: f64 = 5.0;
const LIGHT_UNTIL_S: f64 = 25.0;
/// (kg; kg m²)
const HEAVY: (f64, [f64; 3]) = (2.0, [0.0142, 0.0142, 0.0267]);
const LIGHT: (f64, [f64; 3]) = (1.12, [0.0119, 0.0119, 0.0223]);

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    None,
    Step,
    Impulse,
    Random,
    Sine,
}

const KINDS: [(Kind, &str); 4] =
    [(Kind::Step, "step"), (Kind::Impulse, "impulse"), (Kind::Random, "random"), (Kind::Sine, "sine")];

/// What is done to the measurements of one run.
#[derive(Clone, Copy)]
struct Setting {
    kind: Kind,
    rate_hz: f64,
    noise: f64,
    /// How late the vehicle tells its mass, s.
    late_s: f64,
}

/// The torque that nobody tells the observer, N m; yaw has the weakest actuator and the smallest disturbance.
fn disturbance(kind: Kind, t: f64) -> Vector3<f64> {
    let size = Vector3::new(0.05, -0.04, 0.02);
    match kind {
        Kind::None => Vector3::zeros(),
        Kind::Step => size * f64::from(t >= 10.0),
        Kind::Impulse => size * f64::from((10.0..10.2).contains(&t)),
        // three slow tones whose phases were drawn once
        Kind::Random => {
            let tone = |hz: f64, phase: f64| (TAU * (hz * t + phase)).sin() / 3.0;
            size * (tone(0.05, 0.17) + tone(0.11, 0.62) + tone(0.19, 0.88))
        }
        Kind::Sine => size * t.sin(),
    }
}

fn body(t: f64) -> (f64, Matrix3<f64>) {
    let (mass, j) = if (LIGHT_FROM_S..LIGHT_UNTIL_S).contains(&t) { LIGHT } else { HEAVY };
    (mass, Matrix3::from_diagonal(&Vector3::from(j)))
}

/// One run: times, true and estimated torque.
type Course = Vec<(f64, Vector3<f64>, Vector3<f64>)>;

fn fly(setting: Setting) -> Result<Course, ExperimentError> {
    let model = vehicle::resolve("pham-quadrotor").map_err(ExperimentError::in_part(NAME, "vehicle"))?;
    let mut options = Options::default();
    let numbers = [
        ("tau_s", 0.02),
        ("other_mass_kg", LIGHT.0),
        ("other_roll_kgm2", LIGHT.1[0]),
        ("other_pitch_kgm2", LIGHT.1[1]),
        ("other_yaw_kgm2", LIGHT.1[2]),
    ];
    for (key, value) in numbers {
        options.insert(key, OptionValue::Number(value));
    }
    options.insert("schedule", OptionValue::Text("message".to_owned()));
    let mut observer =
        observers::build("unknown_input", &model, options).map_err(ExperimentError::in_part(NAME, "observer"))?;
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut normal = |sigma: f64| Vector3::from_fn(|_, _| sigma * rng.sample::<f64, _>(StandardNormal));

    let fine_steps = (1.0 / (setting.rate_hz * FINE_S)).round() as u64;
    let (mut attitude, mut rate) = (UnitQuaternion::identity(), Vector3::<f64>::zeros());
    let (mut known_sum, mut known) = (Vector3::zeros(), Vector3::zeros());
    let mut course = Course::new();
    for k in 0..=(END_S / FINE_S) as u64 {
        let t = k as f64 * FINE_S;
        if k % fine_steps == 0 {
            let dt_s = if k == 0 { 0.0 } else { fine_steps as f64 * FINE_S };
            let imu = Imu { accel_frd_mps2: Vector3::zeros(), rate_frd_rads: rate + normal(setting.noise) };
            let mut m = Measurement::new(Stamp::from_secs(t), imu);
            m.dt_s = dt_s;
            m.discontinuity = (k == 0).then_some(Discontinuity::First);
            let angles = normal(if setting.noise > 0.0 { ANGLE_NOISE } else { 0.0 });
            m.attitude = aged(attitude * UnitQuaternion::from_scaled_axis(angles));
            m.actuation = aged(Actuation {
                rotors: RotorCommands { command: [0.5; MAX_ROTORS], count: 4 },
                force_frd_n: Vector3::zeros(),
                torque_frd_nm: known_sum / fine_steps as f64,
                sum_sqrt_thrust: 0.0,
                inflow_n_per_mps2: 0.0,
                doubt: 0.0,
                climb_mps: 0.0,
            });
            m.mass_kg = aged(body(t - dt_s - setting.late_s).0);
            let estimate = observer.step(&m).map_err(ExperimentError::in_part(NAME, "step"))?;
            course.push((t, disturbance(setting.kind, t), Vector3::from_row_slice(&estimate.values[..3])));
            known_sum = Vector3::zeros();
            // the pilot's torque is held between two samples, as an autopilot's is
            let wanted = Vector3::new(0.15 * (0.8 * t).sin(), 0.12 * (1.1 * t).cos(), 0.3 * (0.3 * t).sin());
            let error = attitude.scaled_axis() - wanted;
            known = -(error * 0.6 + rate * 0.13);
        }
        known_sum += known;
        let inertia = body(t).1;
        let torque = known + disturbance(setting.kind, t);
        (attitude, rate) = advance(attitude, rate, &inertia, &torque);
    }
    Ok(course)
}

fn aged<T>(value: T) -> Option<Aged<T>> {
    Some(Aged { value, age_s: 0.0 })
}

/// Euler's equation over one fine step by the classical Runge-Kutta rule; four equal rotors in pairs leave no angular
/// momentum of their own.
fn advance(
    attitude: UnitQuaternion<f64>,
    rate: Vector3<f64>,
    inertia: &Matrix3<f64>,
    torque: &Vector3<f64>,
) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let j = inertia.diagonal();
    let slope = |w: Vector3<f64>| (torque - w.cross(&w.component_mul(&j))).component_div(&j);
    let a = slope(rate);
    let b = slope(rate + a * (0.5 * FINE_S));
    let c = slope(rate + b * (0.5 * FINE_S));
    let d = slope(rate + c * FINE_S);
    let next = rate + (a + b * 2.0 + c * 2.0 + d) * (FINE_S / 6.0);
    (attitude * UnitQuaternion::from_scaled_axis((rate + next) * (0.5 * FINE_S)), next)
}

/// Root mean square of the worst axis, in mN m, over the samples that `keep` keeps.
fn rmse_mnm(course: &Course, keep: impl Fn(f64) -> bool) -> f64 {
    let mut sums = Vector3::<f64>::zeros();
    let mut n = 0.0;
    for (_, truth, estimate) in course.iter().filter(|(t, _, _)| keep(*t)) {
        sums += (estimate - truth).map(|e| e * e);
        n += 1.0;
    }
    1e3 * (sums.max() / n).sqrt()
}

/// Time after 10 s until no axis is ever again more than 2 % of the step off, s.
fn converged_s(course: &Course) -> f64 {
    let off = |truth: &Vector3<f64>, e: &Vector3<f64>| truth.iter().zip(e).any(|(d, e)| (e - d).abs() > 0.02 * d.abs());
    let after = course.iter().filter(|(t, _, _)| (10.0..LIGHT_UNTIL_S - 0.1).contains(t));
    after.filter(|(_, truth, e)| off(truth, e)).map(|(t, _, _)| t - 10.0).fold(0.0, f64::max)
}

fn run() -> Result<Findings, ExperimentError> {
    let mut f = Findings::default();
    for rate_hz in [1000.0, 200.0, 50.0] {
        for (kind, name) in KINDS {
            let course = fly(Setting { kind, rate_hz, noise: RATE_NOISE, late_s: 0.0 })?;
            let what = format!("torque RMSE of the worst axis, {name}, {rate_hz:.0} Hz");
            let rmse = rmse_mnm(&course, |t| t > 1.0);
            if rate_hz == 1000.0 {
                f.judge(what, rmse, "mN m", Limit::AtMost(2.0));
                f.traces.push(trace(&course, name));
            } else {
                f.tell(what, rmse, "mN m");
            }
        }
    }
    let clean = Setting { kind: Kind::Step, rate_hz: 1000.0, noise: 0.0, late_s: 0.0 };
    f.judge("step found to 2 % without noise after", converged_s(&fly(clean)?), "s", Limit::AtMost(1.0));
    let near_a_change = |t: f64| [LIGHT_FROM_S, LIGHT_UNTIL_S].iter().any(|at| (*at - 0.005..*at + 0.5).contains(&t));
    let calm = Setting { kind: Kind::None, noise: RATE_NOISE, ..clean };
    let course = fly(calm)?;
    let ratio = rmse_mnm(&course, near_a_change) / rmse_mnm(&course, |t| t > 1.0 && !near_a_change(t));
    f.judge("noise in the half second after a change of mass, against elsewhere", ratio, "×", Limit::AtMost(1.3));
    let worst = |course: &Course| {
        let near = course.iter().filter(|(t, _, _)| near_a_change(*t));
        1e3 * near.map(|(_, d, e)| (e - d).amax()).fold(0.0, f64::max)
    };
    f.judge(
        "largest error there without noise",
        worst(&fly(Setting { noise: 0.0, ..calm })?),
        "mN m",
        Limit::AtMost(2.0),
    );
    let late = worst(&fly(Setting { noise: 0.0, late_s: 0.2, ..calm })?);
    f.tell("the same, the change told 0.2 s late", late, "mN m");
    f.remarks.push(
        "τ is 0.02 s for roll and pitch and grows with the inertia for yaw; the torque's noise is J·σ/τ, so the noise \
         and not the matrix inequality sets the error"
            .to_owned(),
    );
    Ok(f)
}

fn trace(course: &Course, name: &str) -> Trace {
    let mut trace = Trace::new(
        format!("Torque, {name}"),
        "N m",
        &["roll", "roll found", "pitch", "pitch found", "yaw", "yaw found"],
    );
    // a picture needs no more than 100 points a second
    for (t, d, e) in course.iter().step_by(10) {
        trace.push(*t, &[d.x, e.x, d.y, e.y, d.z, e.z]);
    }
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_torque_is_found_whatever_the_mass_does() {
        for (kind, _) in KINDS {
            let course = fly(Setting { kind, rate_hz: 1000.0, noise: RATE_NOISE, late_s: 0.0 }).unwrap();
            assert!(rmse_mnm(&course, |t| t > 1.0) <= 2.0);
        }
    }
}
