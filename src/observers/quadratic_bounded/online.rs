use super::channels::{Channels, Family, Pace};
use super::filter::Filter;
use super::thrust::ThrustLaw;
use super::trust::{Inertial, Trust};
use crate::observers::{Observer, StepError};
use crate::sets::Interval;
use crate::signal::{Actuation, Aged, Estimate, Guarantee, Measurement, Signal, Verdict};
use crate::vehicle::{GRAVITY_MPS2, Vehicle};
use nalgebra::{DVector, Matrix3, UnitQuaternion, Vector3};

/// Attitude, velocity or rotor commands older than this starve the observer, s.
const MAX_AGE_S: f64 = 0.3;
/// A slow stream counts as fast again after this many steps that a fast design admits.
const FAST_AFTER: u32 = 10;
/// Above this level of V the bound still shrinks from a reopening: it says `Settling`.
const SETTLED_LEVEL: f64 = 1.5;

/// Nothing is known.
const UNKNOWN: Interval = Interval::ENTIRE;

const SIGNALS: [Signal; 6] = [
    Signal { name: "force_n", unit: "N", frame: "NED" },
    Signal { name: "force_e", unit: "N", frame: "NED" },
    Signal { name: "force_d", unit: "N", frame: "NED" },
    Signal { name: "torque_x", unit: "N m", frame: "FRD" },
    Signal { name: "torque_y", unit: "N m", frame: "FRD" },
    Signal { name: "torque_z", unit: "N m", frame: "FRD" },
];

/// The wrench observer of Cayero, Rotondo, Morcego and Puig (2019) on a flying vehicle.
///
/// State: linear and spin momentum in the world frame (their eq. 35) and a chain of disturbance derivatives for each
/// axis (eq. 42). In the world frame the equations are linear, with the rotors' wrench and gravity as input (eq. 47).
/// Outputs: momentum from velocity and body rate, and the residual force `R(m·a − f_a)` from the accelerometer
/// (eq. 54, with the sign corrected). The axes are designed one by one, which is less conservative than one ellipsoid
/// over all six: the declared noise bounds are a box.
///
/// # The bound
/// `Guaranteed`, given the vehicle's declared ranges, noise bounds and envelope, for the residual wrench: everything the
/// rotors and gravity do not explain, whether what the nominal model leaves over or what really acts is meant. While the data agree with the assumptions, the ellipsoid's projection is
/// intersected with what the accelerometer alone admits: the interval of forces that fit every sample so far, widened
/// by the declared rate from one to the next. When an output leaves its admissible set or that interval empties, the
/// verdict is `AssumptionViolated`; the bound is reopened, held open for the time a gust front is declared to last, and
/// decays again. The force is reopened to `gust_factor` times what the accelerometer shows of the breach, within the
/// envelope; the torque, which nothing shows directly, to the whole envelope.
pub struct WrenchObserver {
    vehicle: Vehicle,
    channels: Channels,
    /// Momentum and disturbance filters: force N, E, D, then torque N, E, D.
    filters: [Filter; 6],
    pace: Pace,
    quick_steps: u32,
    inputs: [DVector<f64>; 6],
    outputs: [DVector<f64>; 6],
    /// Residual force that the accelerometer shows, NED, N.
    residual_ned_n: Vector3<f64>,
    /// For how much longer each family's bound is kept open, s: force, torque.
    hold_s: [f64; 2],
    /// Half-widths to which the bounds of the axes were last reopened.
    opening: [f64; 6],
    /// The forces that fit every accelerometer sample since the last reopening, NED, N.
    admitted: [Interval; 3],
    opened: bool,
    trust: Trust,
    previous: Option<Frame>,
    estimate: Estimate,
    violations: u64,
}

/// What the outputs and inputs are made of at one instant.
#[derive(Debug, Clone, Copy)]
struct Frame {
    rotation: Matrix3<f64>,
    attitude: UnitQuaternion<f64>,
    velocity_ned_mps: Vector3<f64>,
    accel_frd_mps2: Vector3<f64>,
    actuation: Actuation,
    thrust: ThrustLaw,
}

impl Frame {
    fn of(vehicle: &Vehicle, m: &Measurement) -> Option<Self> {
        fn fresh<T: Copy>(x: Option<Aged<T>>) -> Option<T> {
            x.filter(|x| x.age_s.abs() <= MAX_AGE_S).map(|x| x.value)
        }
        let attitude = fresh(m.attitude)?;
        let velocity_ned_mps = fresh(m.velocity_ned_mps)?;
        let mut actuation = fresh(m.actuation)?;
        let rotation = attitude.to_rotation_matrix().into_inner();
        let thrust = ThrustLaw::of(vehicle, m, &rotation, velocity_ned_mps, &actuation);
        actuation.force_frd_n.z += thrust.correction_n;
        let accel_frd_mps2 = m.imu.accel_frd_mps2;
        Some(Self { rotation, attitude, velocity_ned_mps, accel_frd_mps2, actuation, thrust })
    }

    fn inertial(&self) -> Inertial {
        Inertial {
            rotation: self.rotation,
            velocity_ned_mps: self.velocity_ned_mps,
            accel_frd_mps2: self.accel_frd_mps2,
        }
    }
}

impl WrenchObserver {
    pub fn new(vehicle: &Vehicle, channels: Channels) -> Self {
        let filters = channels.filters(Pace::Fast);
        Self {
            vehicle: vehicle.clone(),
            inputs: filters.each_ref().map(|f| DVector::zeros(f.state().len())),
            outputs: filters.each_ref().map(|f| DVector::zeros(f.outputs())),
            filters,
            pace: Pace::Fast,
            quick_steps: 0,
            channels,
            residual_ned_n: Vector3::zeros(),
            hold_s: [0.0; 2],
            opening: [f64::INFINITY; 6],
            admitted: [UNKNOWN; 3],
            opened: false,
            trust: Trust::default(),
            previous: None,
            estimate: Estimate::unknown(SIGNALS.len()),
            violations: 0,
        }
    }

    /// How often an assumption was found broken since the last reset.
    pub fn violations(&self) -> u64 {
        self.violations
    }

    /// Chooses the design that is certified for the sample times that come. True when it changed: then the bound of
    /// the other design means nothing and must be opened anew.
    fn keep_pace(&mut self, dt_s: f64) -> bool {
        let fits_fast = self.channels.covers(Pace::Fast, dt_s);
        self.quick_steps = if fits_fast { self.quick_steps.saturating_add(1) } else { 0 };
        let pace = match self.pace {
            Pace::Fast if !fits_fast => Pace::Slow,
            Pace::Slow if self.quick_steps >= FAST_AFTER || !self.channels.covers(Pace::Slow, dt_s) && fits_fast => {
                Pace::Fast
            }
            same => same,
        };
        if pace == self.pace {
            return false;
        }
        self.pace = pace;
        let states = self.filters.each_ref().map(|f| [f.state()[0], f.state()[1]]);
        self.filters = self.channels.filters(pace);
        for (filter, [p, d]) in self.filters.iter_mut().zip(states) {
            filter.state_mut()[0] = p;
            filter.state_mut()[1] = d;
        }
        true
    }

    fn fill(&mut self, frame: &Frame, previous: &Frame, m: &Measurement) {
        let v = &self.vehicle;
        // the rotors' mean wrench over the step, turned by the mean attitude
        let mid = previous.attitude.nlerp(&frame.attitude, 0.5);
        let mut force = mid * frame.actuation.force_frd_n;
        force.z += v.mass_kg.nominal * GRAVITY_MPS2;
        let damping = m.imu.rate_frd_rads.component_mul(&Vector3::from(v.drag.angular));
        let torque = mid * (frame.actuation.torque_frd_nm - damping);

        let momentum = frame.velocity_ned_mps * v.mass_kg.nominal;
        let spin = frame.rotation * (v.inertia_kgm2 * m.imu.rate_frd_rads);
        self.residual_ned_n = frame.rotation * (m.imu.accel_frd_mps2 * v.mass_kg.nominal - frame.actuation.force_frd_n);
        for i in 0..3 {
            self.inputs[i][0] = force[i];
            self.outputs[i][0] = momentum[i];
            if let Some(direct) = self.outputs[i].get_mut(1) {
                *direct = self.residual_ned_n[i];
            }
            self.inputs[3 + i][0] = torque[i];
            self.outputs[3 + i][0] = spin[i];
        }
    }

    /// Starts the filters at what is measured, with the bound opened from the envelope.
    fn start(&mut self) {
        for (i, filter) in self.filters.iter_mut().enumerate() {
            filter.state_mut()[1] = self.residual_ned_n.get(i).copied().unwrap_or(0.0);
        }
        self.opening = [f64::INFINITY; 6];
        self.open(Family::Force);
        self.open(Family::Torque);
        self.admitted = [UNKNOWN; 3];
        self.opened = true;
    }

    /// Opens the bound of one family of axes: momentum is taken as measured, the disturbance as within its opening and
    /// the declared envelope.
    fn open(&mut self, family: Family) {
        for i in family.axes() {
            self.filters[i].state_mut()[0] = self.outputs[i][0];
            let [momentum, disturbance] = self.channels.envelope_box(i, self.filters[i].state()[1]);
            self.filters[i].open(&[momentum, disturbance.min(self.opening[i])]);
        }
    }

    /// Half-width of the accelerometer's residual force on world axis `i`, N, at this attitude.
    fn force_noise(&self, frame: &Frame, i: usize) -> f64 {
        let noise = &self.vehicle.noise;
        let body: f64 =
            (0..3).map(|j| frame.rotation[(i, j)].abs() * (noise.accel_mps2[j] + noise.accel_bias_mps2[j])).sum();
        let horizontal = self.residual_ned_n.xy().norm();
        let turned = if i < 2 {
            noise.yaw_rad * horizontal + noise.tilt_rad * self.residual_ned_n.z.abs()
        } else {
            noise.tilt_rad * horizontal
        };
        body * self.vehicle.mass_kg.range.hi() + turned
    }

    fn correct(&mut self, frame: &Frame, dt_s: f64) -> f64 {
        let mut worst: [f64; 2] = [0.0; 2];
        let mut shown = [f64::INFINITY; 6];
        for (i, shown) in shown.iter_mut().enumerate() {
            let force_noise = if i < 3 { self.force_noise(frame, i) } else { 0.0 };
            let family = Family::of(i) as usize;
            let filter = &mut self.filters[i];
            let noise = [self.channels.momentum_noise(i), force_noise];
            for (j, noise) in noise.into_iter().enumerate().take(filter.outputs()) {
                let allowed = filter.admissible(j, noise);
                worst[family] = worst[family].max(filter.innovation(&self.outputs[i])[j].abs() / allowed);
            }
            if i < 3 {
                let factor = self.channels.gust_factor();
                *shown = factor * ((filter.state()[1] - self.residual_ned_n[i]).abs() + force_noise);
            }
            filter.update(&self.outputs[i], u32::MAX, dt_s);
        }
        worst[Family::Force as usize] = worst[Family::Force as usize].max(self.admit(frame, dt_s));
        for family in [Family::Force, Family::Torque] {
            let k = family as usize;
            if worst[k] > 1.0 {
                self.violations += 1;
                for i in family.axes() {
                    let kept = if self.hold_s[k] > 0.0 { self.opening[i] } else { 0.0 };
                    self.opening[i] = shown[i].max(kept);
                }
                self.hold_s[k] = self.channels.hold_s();
                if family == Family::Force {
                    self.admitted = [UNKNOWN; 3];
                }
            }
            if self.hold_s[k] > 0.0 {
                self.hold_s[k] -= dt_s;
                self.open(family);
            }
        }
        worst[0].max(worst[1])
    }

    /// Narrows the intervals of admitted forces by this sample; above 1 when nothing is left of one.
    fn admit(&mut self, frame: &Frame, dt_s: f64) -> f64 {
        let mut worst: f64 = 0.0;
        for i in 0..3 {
            // while the bound settles, the accelerometer is as suspect as the declared rate
            if self.filters[i].level() > SETTLED_LEVEL || self.hold_s[Family::Force as usize] > 0.0 {
                self.admitted[i] = UNKNOWN;
                continue;
            }
            let noise = self.force_noise(frame, i);
            let seen = Interval::centred(self.residual_ned_n[i], noise);
            let beyond = self.residual_ned_n[i].abs() - noise - self.channels.envelope(i);
            if beyond > 0.0 {
                // more than was declared to be possible
                worst = worst.max(1.0 + beyond / noise);
            }
            let drift = self.channels.rate(i) * dt_s;
            let before = self.admitted[i] + Interval::centred(0.0, drift);
            match before.intersect(seen) {
                Some(both) => self.admitted[i] = both,
                None => {
                    let gap = (seen.lo() - before.hi()).max(before.lo() - seen.hi());
                    worst = worst.max(1.0 + gap / noise);
                    self.admitted[i] = seen;
                }
            }
        }
        worst
    }

    /// Tells the estimate. The certificate holds for what the nominal model leaves over; what really acts differs from
    /// that by the errors of thrust, mass and inertia within their declared ranges, and the bound is widened by them.
    fn publish(&mut self, frame: &Frame, m: &Measurement, residual: f64) {
        let thrust = frame.rotation.column(2).abs() * frame.thrust.half_width_n;
        let mass_share = self.vehicle.mass_share();
        let share = self.vehicle.thrust_share() + frame.actuation.doubt;
        let inertia_share = self.vehicle.inertia_uncertainty;
        let known_torque = frame.actuation.torque_frd_nm.abs();
        self.estimate.stamp = m.stamp;
        self.estimate.guarantee = if self.trust.holds() { Guarantee::Guaranteed } else { Guarantee::None };
        self.estimate.residual = residual;
        let level = self.filters.iter().map(Filter::level).fold(0.0, f64::max);
        self.estimate.verdict = if residual > 1.0 {
            Verdict::AssumptionViolated
        } else if level > SETTLED_LEVEL {
            Verdict::Settling
        } else {
            Verdict::Consistent
        };
        for i in 0..3 {
            let value = self.filters[i].state()[1];
            let mut range = self.within_envelope(i, Interval::centred(value, self.filters[i].half_width(1)));
            range = range.intersect(self.admitted[i]).unwrap_or(range);
            let value = value.clamp(range.lo(), range.hi());
            self.estimate.values[i] = value;
            self.estimate.half_widths[i] =
                (range.hi() - value).max(value - range.lo()) + thrust[i] + mass_share * value.abs();
        }
        let world = Vector3::from_fn(|i, _| self.filters[3 + i].state()[1]);
        let spread = Vector3::from_fn(|i, _| {
            let range = Interval::centred(world[i], self.filters[3 + i].half_width(1));
            let range = self.within_envelope(3 + i, range);
            (range.hi() - world[i]).max(world[i] - range.lo())
        });
        let body = frame.rotation.tr_mul(&world);
        let body_spread = frame.rotation.abs().tr_mul(&spread);
        for i in 0..3 {
            self.estimate.values[3 + i] = body[i];
            let modelled = (share + inertia_share) * known_torque[i] + inertia_share * body[i].abs();
            self.estimate.half_widths[3 + i] = body_spread[i] + modelled;
        }
    }

    /// While a bound shrinks from a reopening, the declared envelope itself may say more: unless the accelerometer shows
    /// a force outside it.
    fn within_envelope(&self, axis: usize, range: Interval) -> Interval {
        if axis < 3 && self.residual_ned_n[axis].abs() > self.channels.envelope(axis) {
            return range;
        }
        range.intersect(Interval::centred(0.0, self.channels.envelope(axis))).unwrap_or(range)
    }

    /// Nothing can be said now, for this reason.
    fn silence(&mut self, m: &Measurement, verdict: Verdict) {
        self.estimate.stamp = m.stamp;
        self.estimate.verdict = verdict;
        self.estimate.guarantee = Guarantee::None;
        self.estimate.half_widths.fill(f64::INFINITY);
        self.opened = false;
        self.previous = None;
    }
}

impl Observer for WrenchObserver {
    fn signals(&self) -> &[Signal] {
        &SIGNALS
    }

    fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    fn step(&mut self, m: &Measurement) -> Result<&Estimate, StepError> {
        if !m.gate.may_fly() {
            self.silence(m, Verdict::Grounded);
            return Ok(&self.estimate);
        }
        let Some(frame) = Frame::of(&self.vehicle, m) else {
            self.silence(m, Verdict::Starved);
            return Ok(&self.estimate);
        };
        let dt_s = m.dt_s;
        let design_changed = m.discontinuity.is_none() && self.keep_pace(dt_s);
        if m.discontinuity.is_none() && !self.channels.covers(self.pace, dt_s) {
            // steps longer than any design is certified for: between two samples anything may have happened
            self.silence(m, Verdict::Starved);
            return Ok(&self.estimate);
        }
        let previous = self.previous.replace(frame).unwrap_or(frame);
        self.fill(&frame, &previous, m);
        if !self.opened || m.discontinuity.is_some() || design_changed {
            // this step is gathered nowhere, so what was gathered up to it no longer adds up
            self.trust.restart();
            self.start();
            self.publish(&frame, m, 0.0);
            return Ok(&self.estimate);
        }
        for (filter, u) in self.filters.iter_mut().zip(&self.inputs) {
            filter.predict(u, dt_s);
        }
        let residual = self.correct(&frame, dt_s);
        let apart = self.trust.compare(&self.vehicle, m);
        let contradiction = self.trust.step(&self.vehicle, &previous.inertial(), &frame.inertial(), dt_s);
        if let Some(i) = self.filters.iter().position(|f| f.state().iter().any(|x| !x.is_finite())) {
            self.reset();
            return Err(StepError::NotFinite { signal: SIGNALS[i].name });
        }
        self.publish(&frame, m, residual.max(contradiction).max(apart));
        Ok(&self.estimate)
    }

    fn reset(&mut self) {
        *self = Self::new(&self.vehicle, self.channels.clone());
    }

    fn fresh(&self) -> Box<dyn Observer> {
        Box::new(Self::new(&self.vehicle, self.channels.clone()))
    }
}
