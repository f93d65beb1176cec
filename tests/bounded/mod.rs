//! A quadrotor whose rotors turn faster or slower than commanded, pushed and measured at the ends of declared bounds;
//! its truth is integrated ten times finer than the filter steps. For tests and examples of the zonotopic filter.

use mavobserver::observers::zonotopic_ekf::{
    ATTITUDE, Drive, FilterSettings, Mode, Output, POSITION, Quadrotor, RATE, STATES, VELOCITY, ZonotopicFilter,
};
use mavobserver::sets::{Interval, Overlap, Reduction};
use nalgebra::{Matrix3, SVector, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub const DT_S: f64 = 0.02;
const SUBSTEPS: usize = 10;
const MASS_KG: f64 = 3.0;
const INERTIA: [f64; 3] = [0.02297, 0.02297, 0.04594];
const ARM_M: f64 = 0.24749;
const TORQUE_RATIO_M: f64 = 0.0159;
const GRAVITY_MPS2: f64 = 9.80665;
/// What the controller asks of a rotor at most, N.
const MOST_N: f64 = 14.0;

/// Bounds of what is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conditions {
    /// A rotor turns at most this share faster or slower than commanded.
    pub speed_error: f64,
    /// Largest force and torque of the air, N (NED) and N m (FRD).
    pub air_n: f64,
    pub air_nm: f64,
    /// Noise of position, velocity, attitude and rate: m, m/s, rad, rad/s.
    pub noise: [f64; 4],
}

/// Ordinary outdoor flight on a good autopilot.
pub const OUTDOORS: Conditions =
    Conditions { speed_error: 0.01, air_n: 1.5, air_nm: 0.05, noise: [0.1, 0.12, 0.0105, 0.03] };
/// A hall with motion capture, rotors that turn as they should: here the error of the linearisation is not hidden
/// behind noise.
pub const INDOORS: Conditions =
    Conditions { speed_error: 1e-4, air_n: 0.01, air_nm: 2e-4, noise: [0.002, 0.01, 0.002, 0.005] };

type State = SVector<f64, STATES>;

/// Either end of −1..1, or now and then something between.
fn vertex(rng: &mut impl Rng) -> f64 {
    match rng.random_range(0..10) {
        0 => rng.random_range(-1.0..1.0),
        1..6 => 1.0,
        _ => -1.0,
    }
}

/// ẋ under a body force, a torque and a force of the air.
pub fn slope(x: &State, force_frd_n: &Vector3<f64>, torque: &Vector3<f64>, air_ned_n: &Vector3<f64>) -> State {
    let [roll, pitch, yaw] = [x[ATTITUDE], x[ATTITUDE + 1], x[ATTITUDE + 2]];
    let w: Vector3<f64> = x.fixed_rows::<3>(RATE).into_owned();
    let rotation = nalgebra::Rotation3::from_euler_angles(roll, pitch, yaw);
    let a = (rotation * force_frd_n + air_ned_n) / MASS_KG + Vector3::z() * GRAVITY_MPS2;
    let across = w.y * roll.sin() + w.z * roll.cos();
    let inertia = Vector3::from(INERTIA);
    let spin = (torque - w.cross(&inertia.component_mul(&w))).component_div(&inertia);
    let mut out = State::zeros();
    for i in 0..3 {
        out[POSITION + i] = x[VELOCITY + i];
        out[VELOCITY + i] = a[i];
        out[RATE + i] = spin[i];
    }
    out[ATTITUDE] = w.x + across * pitch.tan();
    out[ATTITUDE + 1] = w.y * roll.cos() - w.z * roll.sin();
    out[ATTITUDE + 2] = across / pitch.cos();
    out
}

/// One classical Runge-Kutta step.
pub fn advance(x: &State, dt: f64, f: impl Fn(&State) -> State) -> State {
    let a = f(x);
    let b = f(&(x + a * (0.5 * dt)));
    let c = f(&(x + b * (0.5 * dt)));
    let d = f(&(x + c * dt));
    x + (a + (b + c) * 2.0 + d) * (dt / 6.0)
}

/// Body force and torque of four rotors (front right, rear left, front left, rear right) with these thrusts, N.
fn wrench(thrust: &[f64; 4]) -> (Vector3<f64>, Vector3<f64>) {
    let [a, b, c, d] = *thrust;
    let torque = Vector3::new(ARM_M * (b + c - a - d), ARM_M * (a + c - b - d), TORQUE_RATIO_M * (a + b - c - d));
    (Vector3::new(0.0, 0.0, -(a + b + c + d)), torque)
}

/// Thrusts that fly towards a place; feedback of the true state.
fn thrusts(x: &State, goal: &Vector3<f64>) -> [f64; 4] {
    let e: Vector3<f64> = x.fixed_rows::<3>(POSITION) - goal;
    let v: Vector3<f64> = x.fixed_rows::<3>(VELOCITY).into_owned();
    let want = -(e * 0.8 + v * 1.6);
    let (s, c) = x[ATTITUDE + 2].sin_cos();
    let ahead = ((c * want.x + s * want.y) / GRAVITY_MPS2).clamp(-0.4, 0.4);
    let aside = ((-s * want.x + c * want.y) / GRAVITY_MPS2).clamp(-0.4, 0.4);
    let angle = |i: usize| x[ATTITUDE + i];
    let lift = (MASS_KG * (GRAVITY_MPS2 - want.z.clamp(-4.0, 4.0)) / (angle(0).cos() * angle(1).cos()).max(0.5)) * 0.25;
    let roll = INERTIA[0] * (60.0 * (aside - angle(0)) - 12.0 * x[RATE]) / ARM_M * 0.25;
    let pitch = INERTIA[1] * (60.0 * (-ahead - angle(1)) - 12.0 * x[RATE + 1]) / ARM_M * 0.25;
    let yaw = INERTIA[2] * (-2.0 * x[RATE + 2]) / TORQUE_RATIO_M * 0.25;
    let (roll, pitch, yaw) = (roll.clamp(-3.0, 3.0), pitch.clamp(-3.0, 3.0), yaw.clamp(-1.5, 1.5));
    [-roll + pitch + yaw, roll - pitch + yaw, roll + pitch - yaw, -roll - pitch - yaw]
        .map(|t| (lift + t).clamp(0.5, MOST_N))
}

/// The filter's model: the error of four rotors and the air, as boxes that hold them at every thrust they give.
pub fn model(c: &Conditions) -> Quadrotor {
    // thrust goes with the square of speed
    let each = (2.0 * c.speed_error + c.speed_error * c.speed_error) * MOST_N;
    Quadrotor::new(
        MASS_KG,
        &Matrix3::from_diagonal(&Vector3::from(INERTIA)),
        Vector3::zeros(),
        Vector3::repeat(c.air_n),
        Vector3::new(0.0, 0.0, 4.0 * each),
        Vector3::new(4.0 * ARM_M * each, 4.0 * ARM_M * each, 4.0 * TORQUE_RATIO_M * each).add_scalar(c.air_nm),
    )
    .expect("a body that can be")
}

/// Which outputs are measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    pub name: &'static str,
    /// Of position, velocity, attitude, rate.
    pub groups: [bool; 4],
}

pub const MEASURED: [Measured; 5] = [
    Measured { name: "position", groups: [true, false, false, false] },
    Measured { name: "position, velocity", groups: [true, true, false, false] },
    Measured { name: "position, attitude", groups: [true, false, true, false] },
    Measured { name: "position, velocity, attitude", groups: [true, true, true, false] },
    Measured { name: "all", groups: [true, true, true, true] },
];

#[derive(Debug, Clone)]
pub struct Score {
    pub steps: usize,
    /// Steps at which all twelve states lay in their intervals.
    pub inside: usize,
    /// Steps at which the data were found inconsistent, or the set could not be carried on.
    pub contradicted: usize,
    pub lost: usize,
    /// Mean half-width and 99.9 % error of each state, from 2 s after the start of an episode.
    pub half_width: [f64; STATES],
    pub error: [f64; STATES],
}

impl Score {
    pub fn coverage(&self) -> f64 {
        self.inside as f64 / self.steps as f64
    }

    /// Mean half-width over the 99.9 % error, the worst of a group of three states.
    pub fn tightness(&self, group: usize) -> f64 {
        (3 * group..3 * group + 3).map(|i| self.half_width[i] / self.error[i]).fold(0.0, f64::max)
    }
}

/// Flies `episodes` of `length` steps each, the initial box of roll, pitch and yaw up to `initial_rad` wide to a side.
pub fn fly(c: &Conditions, mode: Mode, measured: &Measured, initial_rad: f64, episodes: usize, length: usize) -> Score {
    let weights = State::from_fn(|i, _| 1.0 / c.noise[i / 3]);
    let settings = FilterSettings { mode, reduction: Reduction::Girard, order: 15, weights };
    let mut filter: ZonotopicFilter<STATES, 264> = ZonotopicFilter::new(&[Interval::ZERO; STATES], settings);
    let model = model(c);
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut score =
        Score { steps: 0, inside: 0, contradicted: 0, lost: 0, half_width: [0.0; STATES], error: [0.0; STATES] };
    let mut errors: Vec<Vec<f64>> = vec![Vec::new(); STATES];
    let mut settled = 0_usize;
    for _ in 0..episodes {
        let wide = initial_rad * rng.random_range(0.03..=1.0);
        let radius: State = State::from_fn(|i, _| [0.5, 0.5, wide, 0.2][i / 3]);
        let middle = State::from_fn(|i, _| if i == ATTITUDE + 2 { rng.random_range(-3.0..3.0) } else { 0.0 });
        let mut x = middle + radius.map(|r| r * vertex(&mut rng));
        filter.restart(&std::array::from_fn(|i| Interval::centred(middle[i], radius[i])));
        let mut goal = Vector3::zeros();
        for k in 0..length {
            if k % 250 == 0 {
                goal = Vector3::from_fn(|_, _| rng.random_range(-6.0..6.0));
            }
            let commanded = thrusts(&x, &goal);
            let (force, torque) = wrench(&commanded);
            // the rotors and the air change their mind within the step too
            let mut push = || {
                let true_thrusts = commanded.map(|t| t * (1.0 + c.speed_error * vertex(&mut rng)).powi(2));
                let (f, t) = wrench(&true_thrusts);
                let air = Vector3::from_fn(|_, _| c.air_n * vertex(&mut rng));
                (f, t + Vector3::from_fn(|_, _| c.air_nm * vertex(&mut rng)), air)
            };
            let two = [push(), push()];
            for s in 0..SUBSTEPS {
                let (f, t, air) = &two[usize::from(s >= SUBSTEPS / 2)];
                x = advance(&x, DT_S / SUBSTEPS as f64, |x| slope(x, f, t, air));
            }
            let drive = Drive { dt_s: DT_S, force_frd_n: force, torque_frd_nm: torque, doubt: 0.0 };
            score.steps += 1;
            if filter.predict(&model, &drive).is_err() {
                // nothing is claimed any more; that holds, but is of no use
                score.lost += 1;
                score.inside += 1;
                continue;
            }
            let outputs: Vec<Output<STATES>> = (0..STATES)
                .filter(|i| measured.groups[i / 3])
                .filter_map(|i| Output::of_state("", i, x[i] + c.noise[i / 3] * vertex(&mut rng), c.noise[i / 3]))
                .collect();
            let mut told = [Overlap::default(); STATES];
            filter.correct(&outputs, &mut told);
            score.contradicted += usize::from(told[..outputs.len()].iter().any(|t| !t.touches()));
            let hull = filter.hull();
            score.inside += usize::from(hull.iter().zip(x.iter()).all(|(i, x)| i.contains(*x)));
            if k >= 100 {
                settled += 1;
                for i in 0..STATES {
                    score.half_width[i] += hull[i].radius();
                    errors[i].push((filter.set().centre()[i] - x[i]).abs());
                }
            }
        }
    }
    for (i, e) in errors.iter_mut().enumerate() {
        score.half_width[i] /= settled.max(1) as f64;
        let at = e.len() * 999 / 1000;
        if !e.is_empty() {
            score.error[i] = *e.select_nth_unstable_by(at, f64::total_cmp).1;
        }
    }
    score
}
