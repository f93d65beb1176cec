//! The wrench observer's bound, on synthetic flights whose noise is as bad as the vehicle declares and no worse.

use mavobserver::observers::{Observer, Options, build};
use mavobserver::signal::{Actuation, Aged, Discontinuity, Gate, Imu, Measurement, RotorCommands, Stamp, Verdict};
use mavobserver::vehicle::{self, GRAVITY_MPS2, Vehicle};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A vehicle that keeps its attitude while a known force and torque act on it. The state is integrated exactly: both
/// change linearly within a step.
struct World {
    vehicle: Vehicle,
    attitude: UnitQuaternion<f64>,
    velocity: Vector3<f64>,
    /// R J ω, world.
    spin: Vector3<f64>,
    force: Vector3<f64>,
    torque: Vector3<f64>,
    stamp: Stamp,
    rng: ChaCha8Rng,
}

impl World {
    fn new(vehicle: &Vehicle, yaw: f64, seed: u64) -> Self {
        Self {
            vehicle: vehicle.clone(),
            attitude: UnitQuaternion::from_euler_angles(0.05, -0.1, yaw),
            velocity: Vector3::zeros(),
            spin: Vector3::zeros(),
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
            stamp: Stamp::from_secs(10.0),
            rng: ChaCha8Rng::seed_from_u64(seed),
        }
    }

    /// Moves on by `dt` while force and torque run linearly to the given values, and measures with noise at the corners
    /// of the declared bounds: the worst there is.
    fn step(&mut self, dt: f64, force: Vector3<f64>, torque: Vector3<f64>, first: bool) -> Measurement {
        let mass = self.vehicle.mass_kg.nominal;
        let lift = Vector3::new(0.0, 0.0, -mass * GRAVITY_MPS2);
        let pull = self.attitude * lift + Vector3::new(0.0, 0.0, mass * GRAVITY_MPS2);
        self.velocity += (pull + 0.5 * (self.force + force)) / mass * dt;
        self.spin += 0.5 * (self.torque + torque) * dt;
        (self.force, self.torque) = (force, torque);
        self.stamp = self.stamp.plus_secs(dt);

        let noise = self.vehicle.noise;
        let accel: Vector3<f64> = noise.accel_mps2.map(|x| self.corner(x)).into();
        let bias: Vector3<f64> = noise.accel_bias_mps2.into();
        let rate: Vector3<f64> = noise.gyro_rads.map(|x| self.corner(x)).into();
        let speed: Vector3<f64> = noise.velocity_mps.map(|x| self.corner(x)).into();
        let specific = self.attitude.inverse() * force / mass + lift / mass;
        let spin_body = self.attitude.inverse() * self.spin;
        let inertia = self.vehicle.inertia_kgm2.diagonal();
        let mut m = Measurement::new(
            self.stamp,
            Imu { accel_frd_mps2: specific + accel + bias, rate_frd_rads: spin_body.component_div(&inertia) + rate },
        );
        m.dt_s = if first { 0.0 } else { dt };
        m.discontinuity = first.then_some(Discontinuity::First);
        m.gate = Gate { armed: Some(true), in_air: Some(true) };
        let now = |value| Some(Aged { value, age_s: 0.0 });
        m.attitude = Some(Aged { value: self.attitude, age_s: 0.0 });
        m.velocity_ned_mps = now(self.velocity + speed);
        m.actuation = Some(Aged {
            value: Actuation {
                rotors: RotorCommands { command: [0.5; 12], count: 4 },
                force_frd_n: lift,
                torque_frd_nm: Vector3::zeros(),
                sum_sqrt_thrust: 10.8,
                inflow_n_per_mps2: 0.0,
                doubt: 0.0,
                climb_mps: 0.0,
            },
            age_s: 0.0,
        });
        m
    }

    fn corner(&mut self, x: f64) -> f64 {
        if self.rng.random::<bool>() { x } else { -x }
    }

    /// Are force (NED) and torque (FRD) inside the bounds?
    fn inside(&self, observer: &dyn Observer) -> bool {
        let e = observer.estimate();
        let torque = self.attitude.inverse() * self.torque;
        let truth = [self.force.x, self.force.y, self.force.z, torque.x, torque.y, torque.z];
        truth.iter().zip(&e.values).zip(&e.half_widths).all(|((t, v), h)| (t - v).abs() <= *h)
    }
}

fn observer(vehicle: &Vehicle) -> Box<dyn Observer> {
    build("quadratic_bounded", vehicle, Options::default()).expect("a design")
}

/// Flies with rate and noise at the edge of what is declared, and says what broke.
fn edge_flight(seed: u64, yaw: f64, slow: bool) -> Result<(), String> {
    let vehicle = vehicle::resolve("arducopter-sitl").expect("a preset");
    let mut observer = observer(&vehicle);
    let mut world = World::new(&vehicle, yaw, seed);
    let e = vehicle.envelope;
    let (mut force, mut torque) = (Vector3::<f64>::zeros(), Vector3::<f64>::zeros());
    for k in 0..600 {
        let dt = if slow { world.rng.random_range(0.1..0.3) } else { world.rng.random_range(0.005..0.05) };
        // the rate sits at a corner of its box for a while, then at another; the envelope is not left
        for i in 0..3 {
            let drift = world.corner(e.force_rate_nps[i]) * dt;
            force[i] = (force[i] + drift).clamp(-0.9 * e.force_n[i], 0.9 * e.force_n[i]);
            // small enough that the torque's world axes stay within the smallest body rate
            let twist = world.corner(0.5 * e.torque_rate_nmps[2]) * dt;
            torque[i] = (torque[i] + twist).clamp(-0.5 * e.torque_nm[2], 0.5 * e.torque_nm[2]);
        }
        let m = world.step(dt, force, torque, k == 0);
        let verdict = observer.step(&m).expect("finite").verdict;
        if !world.inside(&*observer) {
            return Err(format!("step {k}: {force:?} {torque:?} outside {:?}", observer.estimate()));
        }
        if verdict == Verdict::AssumptionViolated {
            return Err(format!("step {k}: residual {}", observer.estimate().residual));
        }
    }
    match observer.estimate().verdict {
        Verdict::Consistent => Ok(()),
        other => Err(format!("{other:?} at the end")),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// While rate and noise stay within what is declared, the truth never leaves the bounds and no assumption is called
    /// broken, whatever the step lengths.
    #[test]
    fn bounds_hold_while_the_assumptions_do(seed in any::<u64>(), yaw in -3.1..3.1_f64, slow in any::<bool>()) {
        prop_assert_eq!(edge_flight(seed, yaw, slow), Ok(()));
    }
}

/// A flight in which all errors of one axis stand at their bounds at once.
#[test]
fn errors_that_reach_their_bounds_break_no_assumption() {
    assert_eq!(edge_flight(8_788_084_322_600_480_947, 0.0, true), Ok(()));
}

/// A step has no bounded derivative. It is noticed at once, the bound opens around it, and closes again.
#[test]
fn a_step_reopens_the_bound() {
    let vehicle = vehicle::resolve("arducopter-sitl").expect("a preset");
    let mut observer = observer(&vehicle);
    let mut world = World::new(&vehicle, 0.7, 1);
    let mut seen = None;
    for k in 0..400 {
        let force = if k < 200 { Vector3::zeros() } else { Vector3::new(6.0, -3.0, 2.0) };
        let m = world.step(0.02, force, Vector3::zeros(), k == 0);
        let verdict = observer.step(&m).expect("finite").verdict;
        assert!(world.inside(&*observer), "step {k}");
        if verdict == Verdict::AssumptionViolated {
            seen.get_or_insert(k);
        }
    }
    assert_eq!(seen, Some(200));
    assert_eq!(observer.estimate().verdict, Verdict::Consistent);
    assert!(observer.estimate().half_widths[0] < 1.0);
}

#[test]
fn what_is_missing_is_said() {
    let vehicle = vehicle::resolve("arducopter-sitl").expect("a preset");
    let mut observer = observer(&vehicle);
    let mut world = World::new(&vehicle, 0.0, 2);
    let mut m = world.step(0.02, Vector3::zeros(), Vector3::zeros(), true);
    assert_eq!(observer.step(&m).expect("finite").verdict, Verdict::Settling);
    m.velocity_ned_mps = None;
    assert_eq!(observer.step(&m).expect("finite").verdict, Verdict::Starved);
    assert!(observer.estimate().half_widths.iter().all(|h| h.is_infinite()));
    m.gate.armed = Some(false);
    assert_eq!(observer.step(&m).expect("finite").verdict, Verdict::Grounded);
}
