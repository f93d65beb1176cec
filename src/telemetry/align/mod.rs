mod actuation;
mod jump;
mod latest;
mod pending;

use super::geodesy::LocalOrigin;
use super::history::{History, Lookup};
use crate::signal::{
    Aged, Barometer, Channel, Discontinuity, FixType, Gate, GnssFix, Imu, ImuSource, MAX_ROTORS, MagField, Measurement,
    Sample, SampleKind, Stamp,
};
use crate::vehicle::{RotorBank, Vehicle, air_density_kgm3};
use jump::jumped;
use latest::Latest;
use nalgebra::{UnitQuaternion, Vector3};
use pending::Pending;
use std::sync::Arc;

/// IMU samples closer together than this are averaged into one measurement, s.
const MIN_PERIOD_S: f64 = 0.0095;
/// Measurements are at least this far apart, s: averaging makes irregular instants.
const MIN_SPACING_S: f64 = 0.004;
/// A measurement waits at most this long (by the vehicle's clock) for samples of the other channels, s.
const HORIZON_S: f64 = 0.25;
/// A gap between IMU samples longer than this breaks continuity, s.
const GAP_S: f64 = 2.0;
/// A channel whose newest sample is older than this is missing, s.
const STALE_S: f64 = 1.0;
/// A sensor at its own pace is held this long, s: receivers may send one fix in a second.
const HELD_S: f64 = 2.0;
/// Pressure tells the air's density for this long, s: it changes slowly.
const DENSITY_S: f64 = 30.0;
/// A better IMU source that stays silent this long gives way to the next one, s.
const SOURCE_TIMEOUT_S: f64 = 2.0;

#[derive(Debug, Clone, Copy)]
struct Kinematics {
    position_ned_m: Option<Vector3<f64>>,
    velocity_ned_mps: Vector3<f64>,
}

/// Brings one vehicle's channels to common instants.
///
/// Every IMU sample (or the mean of samples less than 10 ms apart) makes one measurement. It stands at the instant at
/// which the sensor really felt it (its stamp less the sensor's delay). Attitude, velocity and position are
/// interpolated to that instant, rotor commands averaged over the time since the last one; a measurement waits for
/// them up to a horizon and then goes with what there is, each with its age.
#[derive(Debug)]
pub struct Aligner {
    vehicle: Arc<Vehicle>,
    rotor_bank: RotorBank,
    outputs_of_rotors: [usize; MAX_ROTORS],

    source: Option<(ImuSource, Stamp)>,
    pending: Option<Pending>,
    ready: History<Imu, 64>,
    attitude: History<UnitQuaternion<f64>, 64>,
    kinematics: History<Kinematics, 64>,
    outputs: History<[f64; MAX_ROTORS], 64>,
    magnetometer: Latest<MagField>,
    gnss: Latest<GnssFix>,
    barometer: Latest<Barometer>,
    other_imus: [Latest<Imu>; 2],
    global_position: Latest<Vector3<f64>>,
    /// The first three-dimensional fix.
    origin: Option<LocalOrigin>,
    rpm: Option<(Stamp, [f64; MAX_ROTORS])>,
    voltage: Option<(Stamp, f64)>,
    mass: Option<(Stamp, f64)>,
    gate: Gate,

    last: Option<Measurement>,
    broken: Option<Discontinuity>,
    newest_imu: Option<Stamp>,
}

impl Aligner {
    pub fn new(vehicle: Arc<Vehicle>) -> Self {
        let mut outputs_of_rotors = [0; MAX_ROTORS];
        for (o, r) in outputs_of_rotors.iter_mut().zip(&vehicle.rotors) {
            *o = r.output;
        }
        Self {
            vehicle,
            rotor_bank: RotorBank::new(),
            outputs_of_rotors,
            source: None,
            pending: None,
            ready: History::default(),
            attitude: History::default(),
            kinematics: History::default(),
            outputs: History::default(),
            magnetometer: Latest::default(),
            gnss: Latest::default(),
            barometer: Latest::default(),
            other_imus: [Latest::default(), Latest::default()],
            global_position: Latest::default(),
            origin: None,
            rpm: None,
            voltage: None,
            mass: None,
            gate: Gate::default(),
            last: None,
            broken: Some(Discontinuity::First),
            newest_imu: None,
        }
    }

    /// Rotor `rotor` (0-based) is driven by output `output` (0-based): from the autopilot's own parameters.
    pub fn map_rotor(&mut self, rotor: usize, output: usize) {
        if let Some(o) = self.outputs_of_rotors.get_mut(rotor) {
            *o = output;
        }
    }

    pub fn gate(&self) -> Gate {
        self.gate
    }

    /// Drops all history: the vehicle restarted.
    pub fn restart(&mut self) {
        let outputs_of_rotors = self.outputs_of_rotors;
        *self = Self::new(Arc::clone(&self.vehicle));
        self.outputs_of_rotors = outputs_of_rotors;
        self.broken = Some(Discontinuity::Reboot);
    }

    /// The autopilot says that its estimate jumped.
    pub fn estimator_reset(&mut self) {
        self.broken.get_or_insert(Discontinuity::EstimatorReset);
    }

    pub fn push(&mut self, sample: Sample) {
        let t = sample.stamp;
        match sample.kind {
            SampleKind::Imu { source, accel_frd_mps2, rate_frd_rads } => {
                let other = match source {
                    ImuSource::Second => 0,
                    ImuSource::Third => 1,
                    ImuSource::Scaled | ImuSource::HighRes => {
                        if self.accept_source(source, t) {
                            self.push_imu(t, accel_frd_mps2, rate_frd_rads);
                        }
                        return;
                    }
                };
                let felt = t.plus_secs(-self.vehicle.sensors.gyro_delay_s);
                self.other_imus[other].push(felt, Imu { accel_frd_mps2, rate_frd_rads });
            }
            SampleKind::Mag(field) => self.magnetometer.push(t, field),
            SampleKind::Attitude { body_to_ned } => self.attitude.push(t, body_to_ned),
            SampleKind::LocalPosition { position_ned_m, velocity_ned_mps } => {
                self.kinematics.push(t, Kinematics { position_ned_m: Some(position_ned_m), velocity_ned_mps })
            }
            SampleKind::Velocity { velocity_ned_mps } => {
                self.kinematics.push(t, Kinematics { position_ned_m: None, velocity_ned_mps });
            }
            SampleKind::GlobalPosition { latitude_deg, longitude_deg, altitude_m } => {
                if let Some(origin) = &self.origin {
                    self.global_position.push(t, origin.ned_m(latitude_deg, longitude_deg, altitude_m));
                }
            }
            SampleKind::Actuators { outputs } => self.outputs.push(t, outputs),
            SampleKind::RotorRpm { rpm } => self.push_rpm(t, rpm),
            SampleKind::Battery { voltage_v } => self.voltage = Some((t, voltage_v)),
            SampleKind::Mass { mass_kg } => self.mass = Some((t, mass_kg)),
            SampleKind::Pressure { pressure_pa } => self.barometer.push(t, Barometer::from_pressure(pressure_pa)),
            SampleKind::Armed(armed) => self.gate.armed = Some(armed),
            SampleKind::InAir(in_air) => self.gate.in_air = in_air,
            SampleKind::Gnss(fix) => self.push_gnss(t, fix),
        }
    }

    /// Places a fix relative to the first three-dimensional one.
    fn push_gnss(&mut self, t: Stamp, mut fix: GnssFix) {
        if fix.fix_type >= FixType::ThreeD {
            let origin = self
                .origin
                .get_or_insert_with(|| LocalOrigin::new(fix.latitude_deg, fix.longitude_deg, fix.altitude_m));
            fix.position_ned_m = Some(origin.ned_m(fix.latitude_deg, fix.longitude_deg, fix.altitude_m));
        }
        self.gnss.push(t, fix);
    }

    /// Rotor speeds come four at a time: a message fills its four and leaves the others.
    fn push_rpm(&mut self, t: Stamp, rpm: [f64; MAX_ROTORS]) {
        let (at, held) = self.rpm.get_or_insert((t, [f64::NAN; MAX_ROTORS]));
        *at = t;
        for (h, x) in held.iter_mut().zip(rpm).filter(|(_, x)| x.is_finite()) {
            *h = x;
        }
    }

    /// One sensor often arrives through several messages: only the best that is alive is used.
    fn accept_source(&mut self, source: ImuSource, t: Stamp) -> bool {
        match self.source {
            Some((current, seen)) if source < current && t - seen < SOURCE_TIMEOUT_S => false,
            _ => {
                self.source = Some((source, t));
                true
            }
        }
    }

    fn push_imu(&mut self, t: Stamp, accel: Vector3<f64>, rate: Vector3<f64>) {
        if self.newest_imu.is_some_and(|n| t <= n) {
            return;
        }
        self.newest_imu = Some(t);
        match &mut self.pending {
            Some(p) if t - p.first < MIN_PERIOD_S => p.add(t, accel, rate),
            _ => {
                self.flush_pending();
                self.pending = Some(Pending::new(t, accel, rate));
            }
        }
    }

    fn flush_pending(&mut self) {
        if let Some(p) = self.pending.take() {
            let (stamp, imu) = p.mean();
            self.ready.push(stamp.plus_secs(-self.vehicle.sensors.gyro_delay_s), imu);
        }
    }

    /// The next measurement, once everything it waits for has come or the horizon has passed. Call until `None`.
    pub fn poll(&mut self) -> Option<Measurement> {
        let newest_imu = self.newest_imu?;
        if self.pending.as_ref().is_some_and(|p| newest_imu - p.first >= MIN_PERIOD_S) || self.imu_is_slow() {
            self.flush_pending();
        }
        let after = self.last.map(|m| m.stamp);
        let (stamp, imu) = self.ready.iter().find(|(s, _)| after.is_none_or(|a| *s - a >= MIN_SPACING_S))?;
        let waited = newest_imu - stamp;
        if waited < HORIZON_S && !self.others_have_reached(stamp) {
            return None;
        }
        let m = self.assemble(stamp, imu);
        self.last = Some(m);
        Some(m)
    }

    /// True when IMU samples come so far apart that none can join the pending one.
    fn imu_is_slow(&self) -> bool {
        match (self.pending.as_ref(), self.ready.newest()) {
            (Some(p), Some((s, _))) => p.first - s > 1.5 * MIN_PERIOD_S,
            _ => false,
        }
    }

    fn others_have_reached(&self, t: Stamp) -> bool {
        let reached = |newest: Option<Stamp>| newest.is_none_or(|n| n >= t || t - n > STALE_S);
        reached(self.attitude.newest().map(|x| x.0))
            && reached(self.kinematics.newest().map(|x| x.0))
            && reached(self.outputs.newest().map(|x| x.0.plus_secs(self.vehicle.dynamics.delay_s)))
    }

    fn assemble(&mut self, stamp: Stamp, imu: Imu) -> Measurement {
        let mut m = Measurement::new(stamp, imu);
        m.gate = self.gate;
        m.attitude = self.attitude_at(stamp, imu.rate_frd_rads);
        if let Some(Aged { value: k, age_s }) = self.kinematics_at(stamp) {
            m.velocity_ned_mps = Some(Aged { value: k.velocity_ned_mps, age_s });
            m.position_ned_m = k.position_ned_m.map(|value| Aged { value, age_s });
        }
        m.dt_s = self.last.as_ref().map_or(0.0, |l| stamp - l.stamp);
        let fresh = |s: Stamp, limit: f64| (stamp - s < limit).then_some(stamp - s);
        m.rotor_rpm = self.rpm.and_then(|(s, value)| Some(Aged { value, age_s: fresh(s, STALE_S)? }));
        // told when it changes, and true until told otherwise
        m.mass_kg = self.mass.map(|(s, value)| Aged { value, age_s: stamp - s });
        // these change slowly: half a minute old is as good as new
        m.voltage_v = self.voltage.and_then(|(s, value)| Some(Aged { value, age_s: fresh(s, 30.0)? }));
        let pressure = self.barometer.at(stamp, DENSITY_S);
        m.air_density_kgm3 = pressure.map(|b| Aged { value: air_density_kgm3(b.value.pressure_pa), age_s: b.age_s });
        m.barometer = pressure.filter(|b| b.new || b.age_s < HELD_S);
        m.magnetometer = self.magnetometer.at(stamp, HELD_S);
        m.gnss = self.gnss.at(stamp, HELD_S);
        m.global_position_ned_m = self.global_position.at(stamp, HELD_S);
        for (to, from) in m.other_imus.iter_mut().zip(&mut self.other_imus) {
            *to = from.at(stamp, HELD_S);
        }

        m.discontinuity = self.broken.take();
        if m.dt_s > GAP_S {
            m.discontinuity.get_or_insert(Discontinuity::Gap);
        }
        if m.discontinuity.is_none() && self.last.as_ref().is_some_and(|l| jumped(l, &m)) {
            m.discontinuity = Some(Discontinuity::EstimatorReset);
        }
        if m.discontinuity.is_some() {
            m.dt_s = 0.0;
            self.rotor_bank.reset();
        }
        m.actuation = self.actuation(&m);
        m
    }

    fn attitude_at(&self, t: Stamp, rate: Vector3<f64>) -> Option<Aged<UnitQuaternion<f64>>> {
        match self.attitude.at(t)? {
            Lookup::Between(a, b, s) => {
                // `slerp` fails for opposite quaternions only, which are 180° apart
                Some(Aged { value: a.try_slerp(&b, s, 1e-9).unwrap_or(b), age_s: 0.0 })
            }
            Lookup::After(q, dt) if dt < STALE_S => {
                Some(Aged { value: q * UnitQuaternion::from_scaled_axis(rate * dt), age_s: dt })
            }
            Lookup::Before(q, dt) if dt < STALE_S => Some(Aged { value: q, age_s: -dt }),
            Lookup::After(..) | Lookup::Before(..) => None,
        }
    }

    fn kinematics_at(&self, t: Stamp) -> Option<Aged<Kinematics>> {
        match self.kinematics.at(t)? {
            Lookup::Between(a, b, s) => {
                let value = Kinematics {
                    velocity_ned_mps: a.velocity_ned_mps.lerp(&b.velocity_ned_mps, s),
                    position_ned_m: a.position_ned_m.zip(b.position_ned_m).map(|(p, q)| p.lerp(&q, s)),
                };
                Some(Aged { value, age_s: 0.0 })
            }
            Lookup::After(k, dt) if dt < STALE_S => Some(Aged { value: k, age_s: dt }),
            Lookup::Before(k, dt) if dt < STALE_S => Some(Aged { value: k, age_s: -dt }),
            Lookup::After(..) | Lookup::Before(..) => None,
        }
    }

    /// Channels whose newest sample is missing or older than a second at the newest IMU sample.
    pub fn missing(&self, channel: Channel) -> bool {
        let Some(now) = self.newest_imu else { return true };
        let stale = |s: Option<Stamp>| s.is_none_or(|s| now - s > STALE_S);
        match channel {
            Channel::Imu => false,
            Channel::Attitude => stale(self.attitude.newest().map(|x| x.0)),
            Channel::Velocity => stale(self.kinematics.newest().map(|x| x.0)),
            Channel::Actuators => stale(self.outputs.newest().map(|x| x.0)),
            Channel::Magnetometer => stale(self.magnetometer.newest()),
            Channel::Rpm => stale(self.rpm.map(|x| x.0)),
            Channel::Gnss => stale(self.gnss.newest()),
            Channel::Battery => self.voltage.is_none(),
            Channel::Pressure => self.barometer.newest().is_none(),
        }
    }
}

#[cfg(test)]
mod tests;
