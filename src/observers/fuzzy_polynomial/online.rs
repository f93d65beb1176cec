use super::monitor::Monitor;
use super::schedule::Schedule;
use crate::observers::cache::Cache;
use crate::observers::{BuildError, Observer, Options, Registration, StepError};
use crate::signal::{Actuation, Channel, Estimate, Guarantee, MAX_ROTORS, Measurement, Signal, Verdict};
use crate::vehicle::Vehicle;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::sync::Arc;

pub const REGISTRATION: Registration = Registration {
    name: "fuzzy_polynomial",
    id: 4,
    paper: "Pitarch, Sala: Multicriteria fuzzy-polynomial observer design for a 3DoF nonlinear electromechanical platform (2014)",
    estimates: "body rates (FRD) from attitude and rotors, without the gyro",
    needs: &[Channel::Attitude, Channel::Actuators],
    options: &["alpha"],
    prefix: "FPO",
    dials: &[],
    // its gains take seconds, unless they are kept
    standard: false,
    builder,
};

/// Decay rate of the error when the config names none, 1/s: by hand, not by the ranking on flights that the methodology
/// asks for.
const ALPHA: f64 = 12.0;
/// Rotor commands older than this starve the observer, s.
const MAX_AGE_S: f64 = 0.3;
/// Half-widths in units of the root mean square error: 95 % of a normal distribution, and some more for its tails.
const SPREAD: f64 = 2.2;
/// A half-width is never below this, rad/s.
const FLOOR_RADS: f64 = 0.01;
/// The attitude moves this much about its own slow error, rad.
const JITTER_RAD: f64 = 4e-3;

const SIGNALS: [Signal; 3] = [
    Signal { name: "rate_x", unit: "rad/s", frame: "FRD" },
    Signal { name: "rate_y", unit: "rad/s", frame: "FRD" },
    Signal { name: "rate_z", unit: "rad/s", frame: "FRD" },
];

/// The observer (9) of Pitarch and Sala on a flying vehicle.
///
/// State: attitude (in place of the rig's three angles) and body rates. Each new attitude closes a step of the time T
/// since the one before it:
/// ```text
/// q̂⁺ = q̂ ⊗ exp(ω̂·T + L_θ·δ)
/// ω̂⁺ = ω̂ + T·J⁻¹(τ − D·ω̂ − ω̂ × (J·ω̂ + h)) + L_ω·δ,    δ = log(q̂⁻¹ ⊗ q)
/// ```
/// with the rotors' mean torque τ and angular momentum h over the step, and L for this T and h from the
/// [`Schedule`]. Against the rig's equations δ is a rotation vector in the body's frame, which turns by ω̂·T a step: a
/// small rotation of a small error, which the designs do not count. Between two attitudes the rates are predicted; an
/// attitude that was carried forward by the gyro is not one, so the gyro never enters.
///
/// # The bound
/// `Statistical`: from comparing, in hindsight, the estimates with the turn between attitudes (`monitor`). The residual
/// is the innovation over what the declared torque envelope can cause in the steady state.
#[derive(Debug, Clone)]
pub struct RateObserver {
    vehicle: Arc<Vehicle>,
    inertia_inverse: Matrix3<f64>,
    schedule: Arc<Schedule>,
    attitude: UnitQuaternion<f64>,
    rate: Vector3<f64>,
    /// δ of the newest attitude.
    innovation: Vector3<f64>,
    started: bool,
    /// Time since the newest attitude, and the rotors' torque and momentum summed over it.
    elapsed_s: f64,
    impulse: Vector3<f64>,
    spin: Vector3<f64>,
    /// The newest step's time, and the time since the start, s.
    step_s: f64,
    running_s: f64,
    alpha: f64,
    monitor: Monitor,
    estimate: Estimate,
}

fn builder(vehicle: &Vehicle, options: &mut Options) -> Result<Box<dyn Observer>, BuildError> {
    let option = |source| BuildError::Option { observer: REGISTRATION.name, source };
    let alpha = options.number("alpha", 0.5, 60.0).map_err(option)?.unwrap_or(ALPHA);
    let schedule = Schedule::of_vehicle(vehicle, alpha, &Cache::of_user()).map_err(|e| BuildError::Design {
        observer: REGISTRATION.name,
        part: "gains".into(),
        source: Box::new(e),
    })?;
    Ok(Box::new(RateObserver::new(vehicle, schedule, alpha)))
}

impl RateObserver {
    pub fn new(vehicle: &Vehicle, schedule: Schedule, alpha: f64) -> Self {
        Self {
            // a vehicle's inertia is checked to be positive
            inertia_inverse: vehicle.inertia_kgm2.try_inverse().unwrap_or_else(Matrix3::zeros),
            vehicle: Arc::new(vehicle.clone()),
            schedule: Arc::new(schedule),
            attitude: UnitQuaternion::identity(),
            rate: Vector3::zeros(),
            innovation: Vector3::zeros(),
            started: false,
            elapsed_s: 0.0,
            impulse: Vector3::zeros(),
            spin: Vector3::zeros(),
            step_s: 0.0,
            running_s: 0.0,
            alpha,
            monitor: Monitor::new(),
            estimate: Estimate::unknown(SIGNALS.len()),
        }
    }

    /// The rotors' angular momentum, body FRD, kg m²/s: from measured speeds where there are any, else from the command.
    fn rotor_momentum(&self, m: &Measurement, actuation: &Actuation) -> Vector3<f64> {
        let dynamics = &self.vehicle.dynamics;
        if dynamics.inertia_kgm2 <= 0.0 {
            return Vector3::zeros();
        }
        let measured = m.rotor_rpm.filter(|r| r.age_s.abs() <= MAX_AGE_S).map(|r| r.value);
        let mut sum = Vector3::zeros();
        for (k, rotor) in self.vehicle.rotors.iter().enumerate().take(MAX_ROTORS) {
            let rpm = measured.map(|r| r[k]).filter(|r| r.is_finite());
            let speed = rpm.map_or_else(
                || {
                    // thrust goes with the square of the speed
                    let (c, expo) = (actuation.rotors.command[k], self.vehicle.thrust.expo);
                    dynamics.max_speed_rads * ((1.0 - expo) * c + expo * c * c).max(0.0).sqrt()
                },
                |rpm| rpm * std::f64::consts::TAU / 60.0,
            );
            sum += rotor.axis_frd * (rotor.spin.reaction_sign() * dynamics.inertia_kgm2 * speed);
        }
        sum
    }

    /// dω/dt under a torque and a rotor momentum.
    fn acceleration(&self, rate: &Vector3<f64>, torque: &Vector3<f64>, spin: &Vector3<f64>) -> Vector3<f64> {
        let damping = rate.component_mul(&Vector3::from(self.vehicle.drag.angular));
        let momentum = self.vehicle.inertia_kgm2 * rate + spin;
        self.inertia_inverse * (torque - damping - rate.cross(&momentum))
    }

    fn restart(&mut self) {
        self.started = false;
        self.innovation = Vector3::zeros();
        self.rate = Vector3::zeros();
        self.running_s = 0.0;
        self.monitor = Monitor::new();
        self.clear_step();
    }

    fn clear_step(&mut self) {
        self.elapsed_s = 0.0;
        self.impulse = Vector3::zeros();
        self.spin = Vector3::zeros();
    }

    /// Closes the step that began at the attitude before this one.
    fn advance(&mut self, seen: UnitQuaternion<f64>) {
        let t = self.elapsed_s;
        let (torque, spin) = (self.impulse / t, self.spin / t);
        let largest = self.schedule.rotor_momentum;
        // the model's u: momentum against the body's z axis (plant.rs)
        let momentum = if largest > 0.0 { -spin.z / largest } else { 0.0 };
        let correction = self.schedule.gain(t, momentum) * self.innovation;
        let angle = |axis: usize| correction[2 * axis];
        let speed = |axis: usize| correction[2 * axis + 1];
        let turn = self.rate * t + Vector3::new(angle(0), angle(1), angle(2));
        let before = self.rate;
        self.rate += self.acceleration(&before, &torque, &spin) * t + Vector3::new(speed(0), speed(1), speed(2));
        self.attitude *= UnitQuaternion::from_scaled_axis(turn);
        self.innovation = (self.attitude.inverse() * seen).scaled_axis();
        self.running_s += t;
        self.step_s = t;
        // what was told over the step
        self.monitor.see(t, seen, 0.5 * (before + self.rate));
        self.clear_step();
    }

    /// The innovation over what the envelope's largest torque holds it at, and jitter.
    fn residual(&self) -> f64 {
        let dt_s = self.step_s.max(1e-3);
        let gain = self.schedule.gain(dt_s, 0.0);
        let share = |i: usize| {
            let steady = dt_s * self.vehicle.envelope.torque_nm[i] / self.vehicle.inertia_kgm2[(i, i)];
            let allowed = JITTER_RAD + steady / gain[(2 * i + 1, i)].max(f64::MIN_POSITIVE);
            self.innovation[i].abs() / allowed
        };
        share(0).max(share(1)).max(share(2))
    }

    fn publish(&mut self, rate: Vector3<f64>, verdict: Verdict) {
        self.estimate.values.copy_from_slice(rate.as_slice());
        self.estimate.verdict = verdict;
        let error = self.monitor.error().filter(|_| !matches!(verdict, Verdict::Starved | Verdict::Grounded));
        self.estimate.guarantee = if error.is_some() { Guarantee::Statistical(0.95) } else { Guarantee::None };
        for (i, h) in self.estimate.half_widths.iter_mut().enumerate() {
            *h = error.map_or(f64::INFINITY, |e| SPREAD * e[i].hypot(FLOOR_RADS / SPREAD));
        }
    }
}

impl Observer for RateObserver {
    fn signals(&self) -> &[Signal] {
        &SIGNALS
    }

    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError> {
        self.estimate.stamp = m.stamp;
        if m.discontinuity.is_some() {
            self.restart();
        }
        if !m.gate.may_fly() {
            self.restart();
            self.publish(Vector3::zeros(), Verdict::Grounded);
            return Ok(&self.estimate);
        }
        let actuation = m.actuation.filter(|a| a.age_s.abs() <= MAX_AGE_S).map(|a| a.value);
        self.elapsed_s += m.dt_s;
        if let Some(a) = &actuation {
            self.impulse += a.torque_frd_nm * m.dt_s;
            self.spin += self.rotor_momentum(m, a) * m.dt_s;
        }
        // an attitude of positive age was carried here by the gyro
        let seen = m.attitude.filter(|q| q.age_s <= 0.0).map(|q| q.value);
        let lost = self.elapsed_s > self.schedule.longest_s();
        match seen {
            Some(q) if !self.started || lost => {
                self.restart();
                self.attitude = q;
                self.started = true;
            }
            Some(q) if self.elapsed_s > 0.0 => self.advance(q),
            _ => {}
        }
        let mut rate = self.rate;
        if self.elapsed_s > 0.0 {
            let (torque, spin) = (self.impulse / self.elapsed_s, self.spin / self.elapsed_s);
            rate += self.acceleration(&self.rate, &torque, &spin) * self.elapsed_s;
        }
        if !rate.iter().chain(self.attitude.coords.iter()).all(|x| x.is_finite()) {
            self.reset();
            return Err(StepError::NotFinite { signal: SIGNALS[0].name });
        }
        self.estimate.residual = self.residual();
        let verdict = if !self.started || lost || actuation.is_none() {
            Verdict::Starved
        } else if self.running_s * self.alpha < 3.0 || self.monitor.error().is_none() {
            Verdict::Settling
        } else if self.estimate.residual > 1.0 {
            Verdict::AssumptionViolated
        } else {
            Verdict::Consistent
        };
        self.publish(rate, verdict);
        Ok(&self.estimate)
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn reset(&mut self) {
        self.restart();
        self.attitude = UnitQuaternion::identity();
        self.estimate = Estimate::unknown(SIGNALS.len());
    }

    fn fresh(&self) -> Box<dyn Observer> {
        let mut other = self.clone();
        other.reset();
        Box::new(other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{Aged, Imu, RotorCommands, Stamp};

    fn observer() -> RateObserver {
        let vehicle = crate::vehicle::resolve("px4-sih").unwrap();
        let schedule = Schedule::of_vehicle(&vehicle, ALPHA, &Cache::of_user()).unwrap();
        RateObserver::new(&vehicle, schedule, ALPHA)
    }

    /// A measurement without any gyro.
    fn measurement(t_ns: i64, dt_s: f64, attitude: UnitQuaternion<f64>, torque: Vector3<f64>) -> Measurement {
        let nothing = Vector3::from_element(f64::NAN);
        let imu = Imu { accel_frd_mps2: nothing, rate_frd_rads: nothing };
        let mut m = Measurement::new(Stamp::from_secs(t_ns as f64 * 1e-9), imu);
        m.dt_s = dt_s;
        m.attitude = Some(Aged { value: attitude, age_s: 0.0 });
        let rotors = RotorCommands { command: [0.4; MAX_ROTORS], count: 4 };
        let actuation = Actuation {
            rotors,
            force_frd_n: Vector3::new(0.0, 0.0, -9.8),
            torque_frd_nm: torque,
            sum_sqrt_thrust: 0.0,
            inflow_n_per_mps2: 0.0,
            doubt: 0.0,
            climb_mps: 0.0,
        };
        m.actuation = Some(Aged { value: actuation, age_s: 0.0 });
        m
    }

    /// A body that tumbles under changing torques, seen at jittering times: the rates are found, and the bound holds, while
    /// the gyro says nothing.
    #[test]
    fn rates_are_found_without_a_gyro() {
        let mut o = observer();
        let (mut q, mut rate, mut t_ns) = (UnitQuaternion::identity(), Vector3::zeros(), 0_i64);
        let (mut worst, mut inside, mut count) = (0.0_f64, 0, 0);
        for k in 0..1500 {
            let dt_ns = if k % 3 == 0 { 12_000_000 } else { 8_000_000 };
            let phase = t_ns as f64 * 1e-9;
            let torque = Vector3::new(0.05 * (3.0 * phase).sin(), 0.04 * (2.0 * phase).cos(), 0.01 * phase.sin());
            for _ in 0..8 {
                let h = dt_ns as f64 * 1e-9 / 8.0;
                rate += o.acceleration(&rate, &torque, &Vector3::zeros()) * h;
                q *= UnitQuaternion::from_scaled_axis(rate * h);
            }
            t_ns += dt_ns;
            let e = o.step(&measurement(t_ns, dt_ns as f64 * 1e-9, q, torque)).unwrap();
            if e.verdict == Verdict::Consistent {
                let error = Vector3::from_column_slice(&e.values) - rate;
                worst = worst.max(error.amax());
                inside += (0..3).filter(|&i| error[i].abs() <= e.half_widths[i]).count();
                count += 3;
                assert!(matches!(e.guarantee, Guarantee::Statistical(_)));
            }
        }
        assert!(count > 3000 && worst < 0.03, "{count} {worst}");
        assert!(inside as f64 >= 0.95 * count as f64);
    }

    #[test]
    fn missing_attitudes_starve_it_and_a_new_one_starts_it_again() {
        let mut o = observer();
        let attitude = UnitQuaternion::identity();
        let dt = 0.02;
        let at = |o: &mut RateObserver, k: i64, seen: bool| {
            let mut m = measurement(k * 20_000_000, dt, attitude, Vector3::zeros());
            if !seen {
                // carried forward by the gyro: not to be used
                m.attitude = m.attitude.map(|q| Aged { age_s: 0.02, ..q });
            }
            o.step(&m).unwrap().verdict
        };
        (0..200).for_each(|k| {
            at(&mut o, k, true);
        });
        assert_eq!(at(&mut o, 200, true), Verdict::Consistent);
        // one sample missed is predicted
        assert_eq!(at(&mut o, 201, false), Verdict::Consistent);
        assert_eq!(at(&mut o, 202, true), Verdict::Consistent);
        let last = (203..240).map(|k| at(&mut o, k, false)).last().unwrap();
        assert_eq!(last, Verdict::Starved);
        assert_eq!(o.estimate().guarantee, Guarantee::None);
        assert_eq!(at(&mut o, 240, true), Verdict::Starved);
        assert_eq!(at(&mut o, 241, true), Verdict::Settling);
    }
}
