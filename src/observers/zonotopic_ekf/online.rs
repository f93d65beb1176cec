use super::filter::{FilterSettings, Mode, ZonotopicFilter};
use super::model::Output;
use super::quadrotor::{ATTITUDE, Drive, POSITION, Quadrotor, RATE, STATES, VELOCITY};
use crate::observers::{Observer, StepError};
use crate::sets::{Interval, Overlap};
use crate::signal::{Actuation, Aged, Estimate, Guarantee, Measurement, Residual, Signal, Verdict};
use crate::vehicle::{Envelope, GRAVITY_MPS2, NoiseBounds};
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::TAU;

/// Room for order 20, the box spread out, and one column for each output.
pub(super) const GENERATORS: usize = 22 * STATES;
/// Attitude or rotor commands older than this starve the observer, s.
const MAX_AGE_S: f64 = 0.3;
/// Between samples further apart than this anything may happen, s.
const MAX_STEP_S: f64 = 0.6;
/// What is taken for a position or a velocity that was never measured: m, m/s.
const ANYWHERE_M: f64 = 1e6;
const ANY_SPEED_MPS: f64 = 1e3;

const SIGNALS: [Signal; STATES] = [
    Signal { name: "position_n", unit: "m", frame: "NED" },
    Signal { name: "position_e", unit: "m", frame: "NED" },
    Signal { name: "position_d", unit: "m", frame: "NED" },
    Signal { name: "velocity_n", unit: "m/s", frame: "NED" },
    Signal { name: "velocity_e", unit: "m/s", frame: "NED" },
    Signal { name: "velocity_d", unit: "m/s", frame: "NED" },
    Signal { name: "roll", unit: "rad", frame: "FRD to NED" },
    Signal { name: "pitch", unit: "rad", frame: "FRD to NED" },
    Signal { name: "yaw", unit: "rad", frame: "FRD to NED" },
    Signal { name: "rate_x", unit: "rad/s", frame: "FRD" },
    Signal { name: "rate_y", unit: "rad/s", frame: "FRD" },
    Signal { name: "rate_z", unit: "rad/s", frame: "FRD" },
];

/// Which outputs are used, each with all before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outputs {
    /// Position alone, as in the paper.
    Position,
    Velocity,
    Attitude,
    Rates,
}

/// How the observer runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    pub filter: FilterSettings<STATES>,
    pub outputs: Outputs,
}

/// The zonotopic extended Kalman filter of Wang and Puig on a flying vehicle: an interval for each of the twelve
/// states of a rigid body, from whatever of position, velocity, attitude and body rate the vehicle sends.
///
/// # The bound
/// In the guaranteed mode every interval holds the true state, given
/// - the declared noise bounds of each output, where a sample of age a counts with what the state may have moved
///   meanwhile on top;
/// - the declared envelope of residual force and torque, which covers air, contact and model error. It may change
///   at will between two samples, so no bound on its rate is needed;
/// - rotor commands that are right but for the doubt that the thrust law states.
///
/// When an output and the predicted set contradict each other, one of these is broken. The verdict then is
/// `AssumptionViolated`, [`Observer::residuals`] says which output it was, and the interval of that state is opened to
/// hold the prediction and the measurement both. In the paper's mode nothing is guaranteed.
pub struct StateObserver {
    model: Quadrotor,
    noise: NoiseBounds,
    envelope: Envelope,
    mass_kg: f64,
    settings: Settings,
    filter: ZonotopicFilter<STATES, GENERATORS>,
    running: bool,
    /// Steps since the start whose bounds still shrink.
    settling: u32,
    outputs: [Output<STATES>; STATES],
    overlaps: [Overlap; STATES],
    count: usize,
    residuals: [Residual; STATES],
    estimate: Estimate,
}

/// What is measured at one instant, fresh enough to use.
struct Seen {
    attitude: Aged<UnitQuaternion<f64>>,
    velocity: Option<Aged<Vector3<f64>>>,
    position: Option<Aged<Vector3<f64>>>,
    actuation: Actuation,
}

impl Seen {
    fn of(m: &Measurement) -> Option<Self> {
        fn fresh<T: Copy>(x: Option<Aged<T>>) -> Option<Aged<T>> {
            x.filter(|x| x.age_s.abs() <= MAX_AGE_S)
        }
        Some(Self {
            attitude: fresh(m.attitude)?,
            velocity: fresh(m.velocity_ned_mps),
            position: fresh(m.position_ned_m),
            actuation: fresh(m.actuation)?.value,
        })
        .filter(|s| s.velocity.is_some() || s.position.is_some())
    }
}

impl StateObserver {
    pub(super) fn new(
        model: Quadrotor,
        noise: NoiseBounds,
        envelope: Envelope,
        mass_kg: f64,
        settings: Settings,
    ) -> Self {
        let nothing = Output::nothing();
        let silent = Residual { name: "", value: 0.0, admissible: f64::INFINITY, guarantee: Guarantee::None };
        Self {
            model,
            noise,
            envelope,
            mass_kg,
            settings,
            filter: ZonotopicFilter::new(&[Interval::ZERO; STATES], settings.filter),
            running: false,
            settling: 0,
            outputs: [nothing; STATES],
            overlaps: [Overlap::default(); STATES],
            count: 0,
            residuals: [silent; STATES],
            estimate: Estimate::unknown(STATES),
        }
    }

    /// Fills in the outputs of this instant; what the state may have moved since a sample comes from the hull.
    fn measure(&mut self, m: &Measurement, seen: &Seen, hull: &[Interval; STATES]) {
        self.count = 0;
        let speed: [f64; 3] = std::array::from_fn(|i| hull[VELOCITY + i].mag());
        if let Some(p) = seen.position {
            for (i, speed) in speed.into_iter().enumerate() {
                self.add(POSITION + i, p.value[i], self.noise.position_m[i] + p.age_s.abs() * speed);
            }
        }
        if let (Some(v), true) = (seen.velocity, self.settings.outputs >= Outputs::Velocity) {
            let acceleration = self.largest_acceleration(seen, hull);
            for i in 0..3 {
                let noise = self.noise.velocity_mps[i] + self.noise.velocity_bias_mps[i];
                self.add(VELOCITY + i, v.value[i], noise + v.age_s.abs() * acceleration[i]);
            }
        }
        if self.settings.outputs >= Outputs::Attitude {
            let noise = self.attitude_noise(seen, hull);
            for (i, angle) in angles(&seen.attitude.value).into_iter().enumerate() {
                // the turn that is nearest to what is known
                let near = hull[ATTITUDE + i].mid();
                self.add(ATTITUDE + i, angle + TAU * ((near - angle) / TAU).round(), noise[i]);
            }
        }
        if self.settings.outputs >= Outputs::Rates {
            for i in 0..3 {
                self.add(RATE + i, m.imu.rate_frd_rads[i], self.noise.gyro_rads[i]);
            }
        }
    }

    fn add(&mut self, state: usize, y: f64, noise: f64) {
        let output = Output::of_state(SIGNALS[state].name, state, y, noise);
        if let (Some(place), Some(output), true) = (self.outputs.get_mut(self.count), output, y.is_finite()) {
            *place = output;
            self.count += 1;
        }
    }

    /// Largest |v̇| along each world axis while the attitude is within the hull, m/s².
    fn largest_acceleration(&self, seen: &Seen, hull: &[Interval; STATES]) -> Vector3<f64> {
        let force = seen.actuation.force_frd_n;
        let mut known = seen.attitude.value * force / self.mass_kg;
        known.z += GRAVITY_MPS2;
        let turned: f64 = (0..3).map(|i| hull[ATTITUDE + i].radius()).sum();
        let unknown = force.norm() * (turned.min(2.0) + seen.actuation.doubt) / self.mass_kg;
        known.abs() + Vector3::from(self.envelope.force_n) / self.mass_kg + Vector3::repeat(unknown)
    }

    /// Half-widths of roll, pitch and yaw. An error of the thrust axis by the angle ε moves pitch by at most ε and roll
    /// by at most asin(sin ε/cos pitch).
    fn attitude_noise(&self, seen: &Seen, hull: &[Interval; STATES]) -> [f64; 3] {
        let [_, pitch, _] = angles(&seen.attitude.value);
        let tilt = self.noise.tilt_rad + self.noise.tilt_bias_rad;
        let steepest = (pitch.abs() + tilt).min(1.5);
        let roll = (tilt.min(1.5).sin() / steepest.cos()).min(1.0).asin();
        let rate: f64 = (0..3).map(|i| hull[RATE + i].mag().powi(2)).sum::<f64>().sqrt();
        let moved = seen.attitude.age_s.abs() * rate / steepest.cos();
        [roll + moved, tilt + moved, self.noise.yaw_rad + self.noise.yaw_bias_rad + moved]
    }

    /// A box around what is measured now, whether or not it is used as an output later.
    fn start(&mut self, m: &Measurement, seen: &Seen) {
        let noise = &self.noise;
        let mut hull = [Interval::ZERO; STATES];
        for i in 0..3 {
            hull[RATE + i] = Interval::centred(m.imu.rate_frd_rads[i], noise.gyro_rads[i]);
        }
        let attitude = self.attitude_noise(seen, &hull);
        for (i, angle) in angles(&seen.attitude.value).into_iter().enumerate() {
            hull[ATTITUDE + i] = Interval::centred(angle, attitude[i]);
        }
        let acceleration = self.largest_acceleration(seen, &hull);
        for i in 0..3 {
            let (v, p) = (VELOCITY + i, POSITION + i);
            hull[v] = seen.velocity.map_or(Interval::centred(0.0, ANY_SPEED_MPS), |x| {
                let noise = noise.velocity_mps[i] + noise.velocity_bias_mps[i];
                Interval::centred(x.value[i], noise + x.age_s.abs() * acceleration[i])
            });
            hull[p] = seen.position.map_or(Interval::centred(0.0, ANYWHERE_M), |x| {
                Interval::centred(x.value[i], noise.position_m[i] + x.age_s.abs() * hull[v].mag())
            });
        }
        self.filter.restart(&hull);
        self.count = 0;
        self.running = true;
        self.settling = 5;
    }

    /// Takes in the outputs; gives the largest residual over its admissible size.
    fn correct(&mut self) -> f64 {
        let outputs = &self.outputs[..self.count];
        self.filter.correct(outputs, &mut self.overlaps);
        let guarantee = self.guarantee();
        let mut worst: f64 = 0.0;
        for ((output, overlap), residual) in outputs.iter().zip(&self.overlaps).zip(&mut self.residuals) {
            *residual =
                Residual { name: output.name, value: overlap.residual, admissible: overlap.admissible, guarantee };
            worst = worst.max(overlap.ratio());
            if let (Some(state), false) = (output.state, overlap.touches()) {
                let seen = Interval::centred(output.strip.offset, output.strip.half_width);
                self.filter.widen(state, seen);
            }
        }
        worst
    }

    fn guarantee(&self) -> Guarantee {
        match self.settings.filter.mode {
            Mode::Guaranteed => Guarantee::Guaranteed,
            Mode::Paper => Guarantee::None,
        }
    }

    /// Tells the hull, cut with what each output says alone where the two agree.
    fn publish(&mut self, m: &Measurement, residual: f64) {
        let mut hull = self.filter.hull();
        if self.settings.filter.mode == Mode::Guaranteed {
            for (output, overlap) in self.outputs.iter().zip(&self.overlaps).take(self.count) {
                if let (Some(state), true) = (output.state, overlap.touches()) {
                    let seen = Interval::centred(output.strip.offset, output.strip.half_width);
                    hull[state] = hull[state].intersect(seen).unwrap_or(hull[state]);
                }
            }
        }
        let e = &mut self.estimate;
        for (i, range) in hull.into_iter().enumerate() {
            let value = self.filter.set().centre()[i].clamp(range.lo(), range.hi());
            let half_width = (range.hi() - value).max(value - range.lo());
            let unknown = match i {
                ..VELOCITY => ANYWHERE_M,
                VELOCITY..ATTITUDE => ANY_SPEED_MPS,
                _ => f64::INFINITY,
            };
            e.half_widths[i] = if half_width < 0.1 * unknown { half_width } else { f64::INFINITY };
            let angle = (ATTITUDE..RATE).contains(&i);
            e.values[i] = if angle { value - TAU * (value / TAU).round() } else { value };
        }
        self.settling = self.settling.saturating_sub(1);
        e.stamp = m.stamp;
        e.residual = residual;
        e.verdict = if residual > 1.0 {
            Verdict::AssumptionViolated
        } else if self.settling > 0 {
            Verdict::Settling
        } else {
            Verdict::Consistent
        };
        self.estimate.guarantee = self.guarantee();
    }

    /// Nothing can be said now, for this reason.
    fn silence(&mut self, m: &Measurement, verdict: Verdict) {
        self.estimate.stamp = m.stamp;
        self.estimate.verdict = verdict;
        self.estimate.guarantee = Guarantee::None;
        self.estimate.residual = 0.0;
        self.estimate.half_widths.fill(f64::INFINITY);
        self.count = 0;
        self.running = false;
    }
}

/// Roll, pitch, yaw.
fn angles(attitude: &UnitQuaternion<f64>) -> [f64; 3] {
    let (roll, pitch, yaw) = attitude.euler_angles();
    [roll, pitch, yaw]
}

impl Observer for StateObserver {
    fn signals(&self) -> &[Signal] {
        &SIGNALS
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn residuals(&self) -> &[Residual] {
        &self.residuals[..self.count]
    }

    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError> {
        if !m.gate.may_fly() {
            self.silence(m, Verdict::Grounded);
            return Ok(&self.estimate);
        }
        let Some(seen) = Seen::of(m).filter(|_| m.dt_s <= MAX_STEP_S) else {
            self.silence(m, Verdict::Starved);
            return Ok(&self.estimate);
        };
        let drive = Drive {
            dt_s: m.dt_s,
            force_frd_n: seen.actuation.force_frd_n,
            torque_frd_nm: seen.actuation.torque_frd_nm,
            doubt: seen.actuation.doubt,
        };
        let continues = self.running && m.discontinuity.is_none() && m.dt_s > 0.0;
        if !continues || self.filter.predict(&self.model, &drive).is_err() {
            self.start(m, &seen);
            self.publish(m, 0.0);
            return Ok(&self.estimate);
        }
        let hull = self.filter.hull();
        self.measure(m, &seen, &hull);
        let residual = self.correct();
        if let Some(i) = self.filter.set().centre().iter().position(|x| !x.is_finite()) {
            self.reset();
            return Err(StepError::NotFinite { signal: SIGNALS[i].name });
        }
        self.publish(m, residual);
        Ok(&self.estimate)
    }

    fn reset(&mut self) {
        *self = Self::new(self.model.clone(), self.noise, self.envelope, self.mass_kg, self.settings);
    }

    fn fresh(&self) -> Box<dyn Observer> {
        Box::new(Self::new(self.model.clone(), self.noise, self.envelope, self.mass_kg, self.settings))
    }
}
