//! The experiment of section 5.2.1 in software: the Quanser rig, its encoders, and the noise that was added to them.

use super::experiment::Record;
use super::plant::Plant;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::f64::consts::TAU;

/// Table A.3.
const K_V: f64 = 54.945;
const THRUST: f64 = 3.9351e-6;
const DRAG: f64 = 1.1925e-7;
const ARM_M: f64 = 0.1969;
const ROTOR_INERTIA: f64 = 6e-5;
const V_MAX: f64 = 10.0;
/// Voltage about which the rotors are driven; the paper does not say.
const V_MEAN: f64 = 5.0;
/// Friction of the pivot, N m s: small, and unknown to the observers.
const FRICTION: f64 = 0.002;

/// How the rig is moved and measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Experiment {
    /// Amplitude of the excitation in yaw, rad/s², and its frequency, Hz.
    pub yaw_accel_rads2: f64,
    pub yaw_hz: f64,
    /// References of roll and pitch change between ± this, rad, every `switch_s`.
    pub reference_rad: f64,
    pub switch_s: f64,
    pub duration_s: f64,
    /// Standard deviation of the noise added to the encoders, rad.
    pub noise_rad: f64,
    /// Amplitude of the chirp added to the encoders, rad; .01 to 10 Hz in cycles of 5 s.
    pub chirp_rad: f64,
    pub seed: u64,
}

impl Experiment {
    /// As printed: references of ±10° every 30 s, a sinusoid in yaw from 5 s to 60 s, noise of .001 rad (printed as a
    /// variance, with the unit of a deviation), a chirp of 8e−4 rad.
    pub fn printed() -> Self {
        Self {
            yaw_accel_rads2: 0.35,
            yaw_hz: 0.06,
            reference_rad: 10f64.to_radians(),
            switch_s: 30.0,
            duration_s: 65.0,
            noise_rad: 1e-3,
            chirp_rad: 8e-4,
            seed: 1,
        }
    }

    /// Fast manoeuvres: roll and pitch of ±30° reverse every 2 s while yaw turns at up to 1.4 rad/s.
    ///
    /// At α = 18 SOS-2G then has the smallest error. In the slow experiment it has not: with little to follow, the gain
    /// that lets the least noise through wins, and that is LM-A's.
    pub fn fast() -> Self {
        Self { yaw_accel_rads2: 0.7, yaw_hz: 0.08, reference_rad: 30f64.to_radians(), switch_s: 2.0, ..Self::printed() }
    }

    /// Moves the rig and records it at the plant's sample time.
    ///
    /// The rig is a rigid body with Euler angles as its encoders have them, integrated five times as finely as it is
    /// sampled; the observers' model (1) takes angles for axes. True speeds are the angles' exact derivatives.
    pub fn record(&self, plant: &Plant) -> Record {
        let mut rng = StdRng::seed_from_u64(self.seed);
        let mut normal = || {
            let (a, b): (f64, f64) = (rng.random_range(f64::MIN_POSITIVE..1.0), rng.random());
            (-2.0 * a.ln()).sqrt() * (TAU * b).cos()
        };
        let steps = (self.duration_s / plant.dt_s) as usize;
        let mut record = Record { dt_s: plant.dt_s, ..Record::default() };
        let mut state = [0.0; 6];
        for k in 0..steps {
            let t = k as f64 * plant.dt_s;
            let volts = self.voltages(plant, t, &state);
            let spin = K_V * (volts[0] + volts[2] - volts[1] - volts[3]);
            let input = accelerations(plant, &volts);
            let chirp = self.chirp_rad * chirp(t);
            record.angles.push([0, 1, 2].map(|i| state[i] + self.noise_rad * normal() + chirp));
            record.inputs.push(input);
            record.momentum.push(ROTOR_INERTIA * spin / plant.rotor_momentum);
            record.speeds.push(euler_rates(&state));
            for _ in 0..5 {
                state = runge_kutta(plant, &state, &input, ROTOR_INERTIA * spin, plant.dt_s / 5.0);
            }
        }
        record
    }

    /// What a slow controller and the excitation apply.
    fn voltages(&self, plant: &Plant, t: f64, state: &[f64; 6]) -> [f64; 4] {
        let side = |t: f64| if ((t / self.switch_s) as u64).is_multiple_of(2) { 1.0 } else { -1.0 };
        let moving = if (5.0..60.0).contains(&t) { 1.0 } else { 0.0 };
        let reference = [side(t), side(t + 0.5 * self.switch_s)].map(|s| s * moving * self.reference_rad);
        let rates = euler_rates(state);
        let follow = |i: usize| 4.0 * (reference[i] - state[i]) - 3.0 * rates[i];
        let yaw = moving * self.yaw_accel_rads2 * (TAU * self.yaw_hz * t).cos() - 0.05 * state[2] - 0.05 * rates[2];
        let k2 = K_V * K_V;
        let [ix, iy, iz] = plant.inertia_kgm2;
        // V₂² − V₄², V₃² − V₁², V₁² − V₂² + V₃² − V₄² of (3)
        let roll = follow(0) * ix / (THRUST * ARM_M * k2);
        let pitch = follow(1) * iy / (THRUST * ARM_M * k2);
        let turn = yaw * iz / (DRAG * k2);
        let mean = V_MEAN * V_MEAN;
        [
            mean + 0.25 * turn - 0.5 * pitch,
            mean - 0.25 * turn + 0.5 * roll,
            mean + 0.25 * turn + 0.5 * pitch,
            mean - 0.25 * turn - 0.5 * roll,
        ]
        .map(|square| square.clamp(0.0, V_MAX * V_MAX).sqrt())
    }
}

/// (3).
fn accelerations(plant: &Plant, v: &[f64; 4]) -> [f64; 3] {
    let k2 = K_V * K_V;
    let [ix, iy, iz] = plant.inertia_kgm2;
    let s = v.map(|v| v * v);
    [
        THRUST * ARM_M * k2 * (s[1] - s[3]) / ix,
        THRUST * ARM_M * k2 * (s[2] - s[0]) / iy,
        DRAG * k2 * (s[0] - s[1] + s[2] - s[3]) / iz,
    ]
}

/// Derivatives of the Euler angles from body rates.
fn euler_rates(x: &[f64; 6]) -> [f64; 3] {
    let [phi, theta, _, p, q, r] = *x;
    let turn = q * phi.sin() + r * phi.cos();
    [p + theta.tan() * turn, q * phi.cos() - r * phi.sin(), turn / theta.cos()]
}

/// d/dt of (φ, θ, ψ, p, q, r).
fn derivative(plant: &Plant, x: &[f64; 6], input: &[f64; 3], spin: f64) -> [f64; 6] {
    let [ix, iy, iz] = plant.inertia_kgm2;
    let [c1, c2, c3] = plant.coriolis();
    let [_, _, _, p, q, r] = *x;
    let angles = euler_rates(x);
    [
        angles[0],
        angles[1],
        angles[2],
        input[0] + spin * q / ix + c1 * q * r - FRICTION * p / ix,
        input[1] - spin * p / iy + c2 * r * p - FRICTION * q / iy,
        input[2] + c3 * p * q - FRICTION * r / iz,
    ]
}

fn runge_kutta(plant: &Plant, x: &[f64; 6], input: &[f64; 3], spin: f64, h: f64) -> [f64; 6] {
    let f = |x: &[f64; 6]| derivative(plant, x, input, spin);
    let along = |k: &[f64; 6], h: f64| -> [f64; 6] { std::array::from_fn(|i| x[i] + h * k[i]) };
    let k1 = f(x);
    let k2 = f(&along(&k1, 0.5 * h));
    let k3 = f(&along(&k2, 0.5 * h));
    let k4 = f(&along(&k3, h));
    std::array::from_fn(|i| x[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

/// A sinusoid whose frequency rises from .01 to 10 Hz in 5 s, again and again.
fn chirp(t: f64) -> f64 {
    let s = t % 5.0;
    (TAU * (0.01 * s + 0.5 * (10.0 - 0.01) / 5.0 * s * s)).sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rig_stays_in_the_region_of_the_design() {
        let plant = Plant::quanser();
        for experiment in [Experiment::printed(), Experiment::fast()] {
            let record = experiment.record(&plant);
            record.check().unwrap();
            let speed = record.speeds.iter().map(|s| s.iter().map(|v| v * v).sum::<f64>()).fold(0.0, f64::max);
            assert!(speed > 0.3 && speed < plant.radius2, "{experiment:?}: {speed}");
            assert!(record.momentum.iter().all(|u| u.abs() <= 1.0));
        }
    }

    #[test]
    fn without_friction_and_input_energy_is_kept() {
        let plant = Plant { inertia_kgm2: [0.05, 0.06, 0.1], ..Plant::quanser() };
        let energy = |x: &[f64; 6]| (0..3).map(|i| plant.inertia_kgm2[i] * x[3 + i] * x[3 + i]).sum::<f64>();
        let mut x = [0.0, 0.0, 0.0, 0.8, 0.3, -0.5];
        let start = energy(&x);
        for _ in 0..1000 {
            x = runge_kutta(&plant, &x, &[0.0; 3], 0.05, 0.001);
        }
        // friction takes a little in a second, nothing else does
        assert!(energy(&x) < start && energy(&x) > 0.9 * start);
    }
}
