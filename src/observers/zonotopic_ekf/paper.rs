//! The quadrotor of Wang and Puig (13)–(14) and their hover experiment (§VI): position measured, a rotor fault at 40 s.
//!
//! The paper names no figures for the vehicle. They are those of its source, Alexis, Nikolakopoulos and Tzes,
//! *Model predictive quadrotor control* (IET Control Theory and Applications 6, 2012), rounded.

use super::filter::{FilterSettings, Mode, ZonotopicFilter};
use super::model::Output;
use super::smooth::{Differentiated, Equations, Smooth};
use crate::sets::{Interval, Overlap, Reduction};
use crate::vehicle::GRAVITY_MPS2;
use nalgebra::{SVector, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const MASS_KG: f64 = 1.1;
const IXX_KGM2: f64 = 0.0196;
const IYY_KGM2: f64 = 0.0196;
const IZZ_KGM2: f64 = 0.0264;
const ROTOR_KGM2: f64 = 8.5e-4;
const ARM_M: f64 = 0.21;
/// Thrust and drag torque over the square of rotor speed: N s², N m s².
const THRUST: f64 = 9.29e-5;
const DRAG: f64 = 1.1e-6;
const DT_S: f64 = 0.01;

/// States of the paper: φ, φ̇, θ, θ̇, ψ, ψ̇, z, ż, x, ẋ, y, ẏ; z points up.
const N: usize = 12;
const ALTITUDE: usize = 6;
/// How wide the interval of each state typically is: what makes columns of mixed units comparable.
const TYPICAL_SIZES: [f64; N] = [0.05, 0.1, 0.05, 0.1, 0.05, 0.1, 0.001, 0.02, 0.001, 0.02, 0.001, 0.02];
/// Generators: order 20, the box, and one for each output.
const M: usize = 22 * N;

/// Euler's discretisation of (13). The input holds the four rotor speeds, rad/s.
#[derive(Debug, Clone, Copy)]
pub struct Hover {
    /// Largest disturbance of every acceleration, rad/s² and m/s².
    pub disturbance: f64,
}

impl Equations<N> for Hover {
    type Input = Vector4<f64>;

    fn next<S: Smooth>(&self, x: &[S; N], speeds: &Vector4<f64>) -> [S; N] {
        let square = speeds.component_mul(speeds);
        let u1 = THRUST * square.sum();
        let u2 = THRUST * (square[1] - square[3]);
        let u3 = THRUST * (square[2] - square[0]);
        let u4 = DRAG * (square[1] + square[3] - square[0] - square[2]);
        let spin = speeds[1] + speeds[3] - speeds[0] - speeds[2];
        let [phi, dphi, theta, dtheta, psi, dpsi, z, dz, px, dx, py, dy] = *x;
        let (a1, a3, a5) =
            ((IYY_KGM2 - IZZ_KGM2) / IXX_KGM2, (IZZ_KGM2 - IXX_KGM2) / IYY_KGM2, (IXX_KGM2 - IYY_KGM2) / IZZ_KGM2);
        let (a2, a4) = (ROTOR_KGM2 / IXX_KGM2, ROTOR_KGM2 / IYY_KGM2);
        let constant = S::constant;
        let roll = dtheta * dpsi * a1 + dtheta * (a2 * spin) + constant(ARM_M / IXX_KGM2 * u2);
        let pitch = dphi * dpsi * a3 - dphi * (a4 * spin) + constant(ARM_M / IYY_KGM2 * u3);
        let yaw = dphi * dtheta * a5 + constant(u4 / IZZ_KGM2);
        let (sphi, cphi) = (phi.sin(), phi.cos());
        let (stheta, ctheta) = (theta.sin(), theta.cos());
        let (spsi, cpsi) = (psi.sin(), psi.cos());
        let lift = u1 / MASS_KG;
        let up = cphi * ctheta * lift - constant(GRAVITY_MPS2);
        let ahead = (cphi * stheta * cpsi + sphi * spsi) * lift;
        let aside = (cphi * stheta * spsi - sphi * cpsi) * lift;
        let step = |value: S, rate: S| value + rate * DT_S;
        [
            step(phi, dphi),
            step(dphi, roll),
            step(theta, dtheta),
            step(dtheta, pitch),
            step(psi, dpsi),
            step(dpsi, yaw),
            step(z, dz),
            step(dz, up),
            step(px, dx),
            step(dx, ahead),
            step(py, dy),
            step(dy, aside),
        ]
    }

    fn disturbance(&self, _: &Vector4<f64>) -> SVector<f64, N> {
        SVector::from_fn(|i, _| if i % 2 == 0 { 0.0 } else { DT_S * self.disturbance })
    }
}

/// What came of the experiment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HoverRun {
    /// Share of the steps before the fault for which intervals were given in which every true state lay in its own.
    pub coverage: f64,
    /// When the intervals had grown so wide that none could be given any more, s.
    pub lost_s: Option<f64>,
    /// Mean half-width of each state before the fault.
    pub half_widths: [f64; N],
    /// Time from the fault to the first residual interval without zero, s, and its output; `None` if there was none.
    pub detected: Option<(f64, &'static str)>,
    /// Steps before the fault whose residual interval did not hold zero.
    pub false_alarms: usize,
    /// The altitude, step by step.
    pub altitude: Vec<AltitudeInstant>,
}

/// The paper's output 1 at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AltitudeInstant {
    pub t_s: f64,
    /// What it is, and the interval it is said to lie in, m.
    pub truth_m: f64,
    pub interval_m: Interval,
    /// Interval of its residual (Algorithm 2), m.
    pub residual_m: Interval,
}

/// How the experiment is run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoverSettings {
    pub mode: Mode,
    pub duration_s: f64,
    pub fault_s: f64,
    /// Share of its thrust that rotor 1 loses.
    pub loss: f64,
    /// Bound of the noise of each position, m.
    pub noise_m: f64,
    /// Bound of the disturbance of every acceleration, rad/s² and m/s².
    pub disturbance: f64,
    /// Half-width of the initial box in every state.
    pub initial_box: f64,
    /// Are the angles measured too, to ±0.01 rad? The paper measures position alone.
    pub angles_measured: bool,
    pub seed: u64,
}

impl HoverSettings {
    /// The paper's: position alone, a fault of a rotor (here its loss) at 40 s. Noise and disturbance are not printed.
    pub fn published() -> Self {
        Self {
            mode: Mode::Paper,
            duration_s: 45.0,
            fault_s: 40.0,
            loss: 1.0,
            noise_m: 0.001,
            disturbance: 0.002,
            initial_box: 0.02,
            angles_measured: false,
            seed: 3,
        }
    }
}

/// Runs the experiment: a controller with the true state in hand, as in the paper, hovers while noise and disturbance
/// take any value within their bounds, ends included.
pub fn hover(settings: &HoverSettings) -> HoverRun {
    const OUTPUTS: [(&str, usize); 6] = [("z", 6), ("x", 8), ("y", 10), ("phi", 0), ("theta", 2), ("psi", 4)];
    let model = Hover { disturbance: settings.disturbance };
    let equations = Differentiated(model);
    let mut rng = ChaCha8Rng::seed_from_u64(settings.seed);
    let mut either = move || if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let initial = [settings.initial_box; N];
    let mut x = SVector::<f64, N>::from_fn(|i, _| initial[i] * either());
    // with position alone, columns by their length and in mixed units (the paper's own reduction) let the intervals of
    // the angles grow without end
    let filter = FilterSettings {
        mode: settings.mode,
        reduction: Reduction::Girard,
        order: 15,
        weights: SVector::from(TYPICAL_SIZES).map(|size| 1.0 / size),
    };
    let mut observer: ZonotopicFilter<N, M> = ZonotopicFilter::new(&initial.map(|r| Interval::centred(0.0, r)), filter);
    let mut run = HoverRun::default();
    let steps = (settings.duration_s / DT_S) as usize;
    let healthy = ((settings.fault_s / DT_S) as usize).min(steps);
    let outputs = if settings.angles_measured { 6 } else { 3 };
    for k in 0..steps {
        let speeds = controls(&x);
        // before the instant k + 1, both move under the same command
        let faulty = k >= healthy;
        let mut true_speeds = speeds;
        true_speeds[0] *= if faulty { (1.0 - settings.loss).sqrt() } else { 1.0 };
        let disturbance = model.disturbance(&speeds).map(|d| d * either());
        x = SVector::from(model.next(&x.into(), &true_speeds)) + disturbance;
        if observer.predict(&equations, &speeds).is_err() {
            run.lost_s = Some((k + 1) as f64 * DT_S);
            break;
        }
        let measured = OUTPUTS[..outputs].iter().filter_map(|&(name, state)| {
            let noise = if state < ALTITUDE { 0.01 } else { settings.noise_m };
            Output::of_state(name, state, x[state] + noise * either(), noise)
        });
        let measured: Vec<Output<N>> = measured.collect();
        let mut told = [Overlap::default(); 6];
        observer.correct(&measured, &mut told);
        let offending = measured.iter().zip(&told).find(|(_, t)| !t.touches());
        match offending {
            Some(_) if !faulty => run.false_alarms += 1,
            Some((output, _)) if run.detected.is_none() => {
                run.detected = Some(((k + 1 - healthy) as f64 * DT_S, output.name));
            }
            _ => {}
        }
        let hull = observer.hull();
        run.altitude.push(AltitudeInstant {
            t_s: (k + 1) as f64 * DT_S,
            truth_m: x[ALTITUDE],
            interval_m: hull[ALTITUDE],
            residual_m: Interval::centred(told[0].residual, told[0].admissible),
        });
        if run.detected.is_some() {
            break;
        }
        if !faulty {
            // running means
            let share = 1.0 / (k + 1) as f64;
            run.coverage += share * (f64::from(hull.iter().zip(x.iter()).all(|(i, x)| i.contains(*x))) - run.coverage);
            for (mean, side) in run.half_widths.iter_mut().zip(&hull) {
                *mean += share * (side.radius() - *mean);
            }
        }
    }
    run
}

/// Rotor speeds that hold the hover: proportional and derivative feedback of the true state, in place of the paper's
/// predictive controller.
fn controls(x: &SVector<f64, N>) -> Vector4<f64> {
    let lift = (MASS_KG * (GRAVITY_MPS2 - 4.0 * x[6] - 3.0 * x[7])).max(1.0);
    let (lean_x, lean_y) = (-0.15 * x[8] - 0.2 * x[9], -0.15 * x[10] - 0.2 * x[11]);
    let pitch = IYY_KGM2 * (60.0 * (lean_x.clamp(-0.2, 0.2) - x[2]) - 12.0 * x[3]) / ARM_M;
    let roll = IXX_KGM2 * (60.0 * (-lean_y.clamp(-0.2, 0.2) - x[0]) - 12.0 * x[1]) / ARM_M;
    let yaw = IZZ_KGM2 * (-4.0 * x[4] - 3.0 * x[5]);
    // U1 = b·ΣΩ², U2 = b(Ω₂² − Ω₄²), U3 = b(Ω₃² − Ω₁²), U4 = d(−Ω₁² + Ω₂² − Ω₃² + Ω₄²)
    let (quarter, turn) = (0.25 * lift / THRUST, 0.25 * yaw.clamp(-0.01, 0.01) / DRAG);
    Vector4::new(
        quarter - 0.5 * pitch / THRUST - turn,
        quarter + 0.5 * roll / THRUST + turn,
        quarter + 0.5 * pitch / THRUST - turn,
        quarter - 0.5 * roll / THRUST + turn,
    )
    .map(|square| square.max(0.0).sqrt())
}
