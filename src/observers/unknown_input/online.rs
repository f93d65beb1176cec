use super::design::{Objective, design};
use super::mass::MassBalance;
use super::plant::attitude_of;
use super::schedule::{Body, Schedule, Source};
use super::torque::{TorqueFilter, TorqueStep};
use crate::observers::{BuildError, Observer, Options, Registration, StepError};
use crate::signal::{Aged, Channel, Discontinuity, Estimate, Guarantee, Measurement, RotorCommands, Signal, Verdict};
use crate::vehicle::{Spin, Vehicle};
use nalgebra::{Matrix3, Matrix6, Vector3};

pub const REGISTRATION: Registration = Registration {
    name: "unknown_input",
    id: 5,
    paper: "Pham, Ichalal, Mammar: LPV unknown input observer for attitude of a mass-varying quadcopter (2020)",
    estimates: "external torque (FRD) under changing mass and inertia, mass and payload; no bound",
    needs: &[Channel::Imu, Channel::Attitude, Channel::Actuators],
    options: &[
        "tau_s",
        "decay",
        "schedule",
        "mass_tau_s",
        "other_mass_kg",
        "other_roll_kgm2",
        "other_pitch_kgm2",
        "other_yaw_kgm2",
    ],
    prefix: "UIO",
    dials: &[],
    standard: true,
    builder,
};

const SIGNALS: [Signal; 5] = [
    Signal { name: "torque_x", unit: "N m", frame: "FRD" },
    Signal { name: "torque_y", unit: "N m", frame: "FRD" },
    Signal { name: "torque_z", unit: "N m", frame: "FRD" },
    Signal { name: "mass_kg", unit: "kg", frame: "" },
    Signal { name: "payload_kg", unit: "kg", frame: "" },
];

/// Attitude or rotor commands older than this starve the observer, s.
const MAX_AGE_S: f64 = 0.3;
/// Longer steps say nothing about the torque between, s.
const MAX_DT_S: f64 = 0.55;
/// Yaw rate up to which the design holds, rad/s.
const YAW_RADS: f64 = 3.0;

/// The LPV unknown-input observer on a flying vehicle, in the full attitude.
///
/// # What it gives
/// The torque that the rotor model does not explain, low-passed with τ (`tau_s`, longer on axes of more inertia, so
/// that all are equally noisy); mass, and what it exceeds that of the vehicle file by. No bound: the paper has none, and
/// [`WrenchObserver`](crate::observers::quadratic_bounded::WrenchObserver) gives one.
pub struct TorqueObserver {
    vehicle: Vehicle,
    schedule: Schedule,
    filter: TorqueFilter,
    balance: MassBalance,
    /// A reset begins with these.
    initial: (TorqueFilter, MassBalance),
    settled_after_s: f64,
    flown_s: f64,
    estimate: Estimate,
}

fn builder(vehicle: &Vehicle, options: &mut Options) -> Result<Box<dyn Observer>, BuildError> {
    let observer = REGISTRATION.name;
    let option = |source| BuildError::Option { observer, source };
    let tau_s = options.number("tau_s", 1e-3, 5.0).map_err(option)?.unwrap_or(0.05);
    let decay = options.number("decay", 0.1, 100.0).map_err(option)?.unwrap_or(5.0);
    let mass_tau_s = options.number("mass_tau_s", 0.05, 60.0).map_err(option)?.unwrap_or(1.0);
    let sources = [("nominal", Source::Nominal), ("message", Source::Message), ("hover", Source::Hover)];
    let source = options.choice("schedule", &sources).map_err(option)?.unwrap_or(Source::Hover);
    let nominal = Body { mass_kg: vehicle.mass_kg.nominal, inertia_kgm2: vehicle.inertia_kgm2 };
    let mut other = nominal;
    let mass = options.number("other_mass_kg", 1e-3, 1e4).map_err(option)?;
    for (i, key) in ["other_roll_kgm2", "other_pitch_kgm2", "other_yaw_kgm2"].into_iter().enumerate() {
        if let Some(x) = options.number(key, 1e-9, 1e6).map_err(option)? {
            other.inertia_kgm2[(i, i)] = x;
        }
    }
    other.mass_kg = mass.unwrap_or(other.mass_kg);
    let failed = |source: Box<dyn std::error::Error + Send + Sync>| BuildError::Design {
        observer,
        part: "attitude".to_owned(),
        source,
    };
    let rotors = vehicle.dynamics.inertia_kgm2 * vehicle.dynamics.max_speed_rads * vehicle.rotors.len() as f64;
    let plant =
        attitude_of(&other, &nominal, YAW_RADS, rotors).ok_or_else(|| failed("an inertia is singular".into()))?;
    let designed = design(&plant, Objective::SmallestGain { decay }).map_err(|e| failed(Box::new(e)))?;
    // one gain serves: the corners differ in what Q takes out alone
    let gain = designed.gains.first().map_or_else(Matrix6::zeros, |l| Matrix6::from_fn(|i, j| l[(i, j)]));
    let schedule = Schedule { nominal, other, source };
    Ok(Box::new(TorqueObserver::new(vehicle, schedule, &gain, tau_s, mass_tau_s)))
}

impl TorqueObserver {
    /// `gain` is L of a [`design`] for [`attitude_of`] the schedule's bodies; `tau_s` is τ of the axis with the least
    /// inertia.
    pub fn new(vehicle: &Vehicle, schedule: Schedule, gain: &Matrix6<f64>, tau_s: f64, mass_tau_s: f64) -> Self {
        let inertia = schedule.nominal.inertia_kgm2.diagonal();
        let time_constants_s = inertia * (tau_s / inertia.min());
        let filter = TorqueFilter::new(gain, time_constants_s);
        let balance = MassBalance::new(mass_tau_s);
        Self {
            vehicle: vehicle.clone(),
            schedule,
            initial: (filter.clone(), balance),
            filter,
            balance,
            settled_after_s: 4.0 * time_constants_s.max(),
            flown_s: 0.0,
            estimate: Estimate::unknown(SIGNALS.len()),
        }
    }

    fn body(&self, m: &Measurement) -> Body {
        let told = m.mass_kg.map(|x| x.value);
        let mass = match self.schedule.source {
            Source::Nominal => None,
            Source::Message => told,
            Source::Hover => self.balance.mass_kg(),
        };
        self.schedule.body(mass.unwrap_or(self.schedule.nominal.mass_kg))
    }

    /// Angular momentum of the spinning rotors, body FRD, N m s.
    fn rotors_nms(&self, commands: &RotorCommands) -> Vector3<f64> {
        let (d, thrust) = (&self.vehicle.dynamics, &self.vehicle.thrust);
        if d.inertia_kgm2 == 0.0 {
            return Vector3::zeros();
        }
        let each = self.vehicle.rotors.iter().zip(commands.command);
        each.map(|(rotor, c)| {
            // thrust goes with the square of the speed
            let speed = d.max_speed_rads * ((1.0 - thrust.expo) * c + thrust.expo * c * c).max(0.0).sqrt();
            let sense = if rotor.spin == Spin::Ccw { 1.0 } else { -1.0 };
            rotor.axis_frd * (sense * d.inertia_kgm2 * speed)
        })
        .sum()
    }

    fn silence(&mut self, m: &Measurement, verdict: Verdict) {
        (self.filter, self.balance) = self.initial.clone();
        self.flown_s = 0.0;
        self.estimate.stamp = m.stamp;
        self.estimate.verdict = verdict;
        self.estimate.residual = 0.0;
    }

    fn publish(&mut self, m: &Measurement) {
        let mass = self.balance.mass_kg().unwrap_or(self.schedule.nominal.mass_kg);
        let e = &mut self.estimate;
        e.stamp = m.stamp;
        e.guarantee = Guarantee::None;
        e.verdict = if self.flown_s < self.settled_after_s { Verdict::Settling } else { Verdict::Consistent };
        let noise = &self.vehicle.noise;
        e.residual = self.filter.attitude_error_rad().norm() / (noise.tilt_rad + noise.yaw_rad).max(1e-3);
        e.values[..3].copy_from_slice(self.filter.torque_frd_nm().as_slice());
        e.values[3] = mass;
        e.values[4] = mass - self.schedule.nominal.mass_kg;
    }
}

impl Observer for TorqueObserver {
    fn signals(&self) -> &[Signal] {
        &SIGNALS
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError> {
        fn fresh<T: Copy>(x: Option<Aged<T>>) -> Option<T> {
            x.filter(|x| x.age_s.abs() <= MAX_AGE_S).map(|x| x.value)
        }
        if !m.gate.may_fly() {
            self.silence(m, Verdict::Grounded);
            return Ok(&self.estimate);
        }
        let (Some(attitude), Some(actuation), true) = (fresh(m.attitude), fresh(m.actuation), m.dt_s <= MAX_DT_S)
        else {
            self.silence(m, Verdict::Starved);
            return Ok(&self.estimate);
        };
        match m.discontinuity {
            Some(Discontinuity::EstimatorReset) => self.filter.interrupt(),
            Some(_) => self.silence(m, Verdict::Settling),
            None => {}
        }
        // the accelerometer's z axis is the rotors' thrust axis, but for small cants that the model holds in force too
        self.balance.step(actuation.force_frd_n.z, m.imu.accel_frd_mps2.z, m.dt_s);
        let damping = m.imu.rate_frd_rads.component_mul(&Vector3::from(self.vehicle.drag.angular));
        let inertia_kgm2: Matrix3<f64> = self.body(m).inertia_kgm2;
        self.filter.step(&TorqueStep {
            dt_s: m.dt_s,
            body_to_ned: attitude,
            rate_frd_rads: m.imu.rate_frd_rads,
            torque_frd_nm: actuation.torque_frd_nm - damping,
            rotors_frd_nms: self.rotors_nms(&actuation.rotors),
            inertia_kgm2,
        });
        self.flown_s += m.dt_s;
        if let Some(i) = self.filter.torque_frd_nm().iter().position(|x| !x.is_finite()) {
            self.reset();
            return Err(StepError::NotFinite { signal: SIGNALS[i].name });
        }
        self.publish(m);
        Ok(&self.estimate)
    }

    fn reset(&mut self) {
        (self.filter, self.balance) = self.initial.clone();
        self.flown_s = 0.0;
        self.estimate = Estimate::unknown(SIGNALS.len());
    }

    fn fresh(&self) -> Box<dyn Observer> {
        let (filter, balance) = self.initial.clone();
        Box::new(Self {
            vehicle: self.vehicle.clone(),
            schedule: self.schedule,
            initial: (filter.clone(), balance),
            filter,
            balance,
            settled_after_s: self.settled_after_s,
            flown_s: 0.0,
            estimate: Estimate::unknown(SIGNALS.len()),
        })
    }
}
