use super::fault::{Active, Fault};
use super::field::Field;
use super::fixes::Fixes;
use super::height::Height;
use super::inertial::Pair;
use super::monitor::Monitor;
use super::rotors::Rotors;
use super::settings::FaultSettings;
use super::speed::Speed;
use super::weight::Weight;
use crate::signal::{Guarantee, Measurement, Residual, Stamp};
use crate::vehicle::Vehicle;

/// Judging begins this long after take-off and after every break of continuity, s.
const QUIET_S: f64 = 3.0;
/// An estimator that was led astray needs this long to find back, s.
const AFTERMATH_S: f64 = 4.0;
/// A fault's residual may be this much slower than a guaranteed one, s.
const SLOWER_S: f64 = 0.5;
/// Outputs that can contradict at the same time: those of one observer of the whole state.
const CONTRADICTIONS: usize = 12;
/// The most faults at a time.
const MOST: usize = 8;

/// All detectors of one vehicle.
///
/// Isolation is by elimination: a lost rotor upsets everything else, so nothing else is judged until it has cleared. A
/// rotor that pulls less looks like weight, and a load beside the middle like a weak rotor: the lever between force and
/// torque tells which. A sensor that leads the vehicle's own estimator astray makes attitude and motion untrue, so what
/// is judged by those waits. What touches the ground is not judged by forces. Allocates nothing after it is made.
#[derive(Debug, Clone)]
pub struct FaultBank {
    vehicle: Vehicle,
    settings: FaultSettings,
    /// Outputs of observers that no admissible noise explained, and when last.
    contradictions: [Option<(&'static str, Stamp)>; CONTRADICTIONS],
    pair: Pair,
    fixes: Fixes,
    height: Height,
    field: Field,
    pub(super) rotors: Rotors,
    speed: Speed,
    weight: Weight,
    flying_s: f64,
    /// For this long neither the vehicle's own attitude nor its own motion is to be trusted, s.
    turned_s: f64,
    doubtful_s: f64,
    active: [Option<Active>; MOST],
}

impl FaultBank {
    pub fn new(vehicle: &Vehicle, settings: FaultSettings) -> Self {
        let per_hour = settings.each_per_hour();
        Self {
            settings,
            contradictions: [None; CONTRADICTIONS],
            vehicle: vehicle.clone(),
            pair: Pair::new(vehicle, per_hour),
            fixes: Fixes::new(per_hour),
            height: Height::new(),
            field: Field::new(per_hour),
            rotors: Rotors::new(vehicle),
            speed: Speed::new(vehicle),
            weight: Weight::new(vehicle),
            flying_s: 0.0,
            turned_s: 0.0,
            doubtful_s: 0.0,
            active: [None; MOST],
        }
    }

    pub fn step(&mut self, m: &Measurement) {
        if m.discontinuity.is_some() {
            self.forget(m);
            return;
        }
        self.flying_s = if m.gate.may_fly() { self.flying_s + m.dt_s } else { 0.0 };
        if self.flying_s < QUIET_S {
            self.rotors.restart();
            self.rotors.unload();
            self.speed.restart();
            self.weight.land();
            self.active = [None; MOST];
            return;
        }
        if self.weight.held() {
            // what stands or hangs is turned and moved by what holds it
            self.rotors.restart();
            self.speed.restart();
            self.height.restart();
        }
        self.rotors.step(m, self.weight.lacks_n());
        self.speed.step(m);
        if !self.rotors.lost() {
            self.pair.step(m);
            self.fixes.step(m);
            self.height.step(m);
            let astray = self.pair.told().iter().any(|(monitor, _)| monitor.active());
            self.turned_s = if astray { AFTERMATH_S } else { self.turned_s - m.dt_s };
            self.field.step(m, self.turned_s <= 0.0);
        }
        self.weigh(m);
        self.tell();
    }

    /// Takes in a residual of an observer, before [`Self::step`]: counted when no admissible noise explains it.
    pub fn contradicted(&mut self, residual: &Residual, stamp: Stamp) {
        if residual.guarantee != Guarantee::Guaranteed || residual.ratio() <= 1.0 {
            return;
        }
        let known = |c: &Option<(&str, Stamp)>| c.is_none_or(|(name, _)| name == residual.name);
        if let Some(place) = self.contradictions.iter_mut().find(|c| known(c)) {
            *place = Some((residual.name, stamp));
        }
    }

    fn guarantee(&self, fault: Fault, onset: Stamp, otherwise: Guarantee) -> Guarantee {
        let mut speaking = self.contradictions.iter().flatten().filter(|(name, _)| fault.shows_in(name));
        if speaking.any(|(_, at)| *at - onset > -SLOWER_S) { Guarantee::Guaranteed } else { otherwise }
    }

    /// Weight, while nothing else is wrong that would look like it.
    fn weigh(&mut self, m: &Measurement) {
        let sensors = [self.pair.told()[1].0, self.fixes.told()[0].0, self.fixes.told()[2].0, self.height.told().0];
        let doubtful = sensors.iter().any(|monitor| monitor.active());
        self.doubtful_s = if doubtful { AFTERMATH_S } else { self.doubtful_s - m.dt_s };
        if self.doubtful_s > 0.0 || self.rotor().is_some() {
            self.weight.restart();
            return;
        }
        let settled = self.weight.settled();
        self.weight.step(m, self.rotors.lacks_n());
        if !settled && self.weight.settled() {
            // beside the middle a load turns the vehicle
            self.rotors.load();
        }
    }

    /// A break in time: what was learnt of the sensors goes; a jump of the autopilot's estimate leaves faults standing.
    fn forget(&mut self, m: &Measurement) {
        use crate::signal::Discontinuity::{EstimatorReset, First, Gap, Reboot};
        match m.discontinuity {
            Some(EstimatorReset) | None => {
                self.rotors.restart();
                self.weight.restart();
            }
            Some(First | Gap | Reboot) => *self = Self::new(&self.vehicle, self.settings),
        }
    }

    /// The rotor at fault, and the bits of those that it may be instead. Its speed names it beyond doubt; torque is
    /// quicker, and sees a broken blade.
    fn rotor(&self) -> Option<(u8, u32, &Monitor, Residual)> {
        let by_speed = self.speed.told().map(|(i, monitor, residual)| (i as u8, 0, monitor, residual));
        by_speed.or_else(|| self.rotors.told())
    }

    fn tell(&mut self) {
        let mut n = 0;
        let mut active = [None; MOST];
        let mut tell = |fault: Fault, or: u32, onset: Option<Stamp>, residual: Residual| {
            if let (Some(onset), Some(place)) = (onset, active.get_mut(n)) {
                let guarantee = self.guarantee(fault, onset, residual.guarantee);
                *place = Some(Active { fault, or, onset, magnitude: residual.value, guarantee });
                n += 1;
            }
        };
        if let Some((i, or, monitor, residual)) = self.rotor() {
            tell(Fault::Rotor(i), or, monitor.onset(), residual);
        }
        if let Some((onset, value)) = self.weight.told() {
            tell(Fault::Payload, 0, Some(onset), Residual { value, ..self.weight.residual() });
        }
        let mut add = |fault, monitor: &Monitor, residual| tell(fault, 0, monitor.onset(), residual);
        if !self.rotors.lost() {
            let [gyro, accel] = self.pair.told();
            add(Fault::Gyro, gyro.0, gyro.1);
            add(Fault::Accelerometer, accel.0, accel.1);
            let [position, lost, velocity] = self.fixes.told();
            add(Fault::GnssPosition, position.0, position.1);
            if !position.0.active() {
                add(Fault::GnssPosition, lost.0, lost.1);
            }
            add(Fault::GnssVelocity, velocity.0, velocity.1);
            let (monitor, residual) = self.height.told();
            add(Fault::Barometer, monitor, residual);
            let [world, stuck] = self.field.told();
            add(Fault::Magnetometer, world.0, world.1);
            if !world.0.active() {
                add(Fault::Magnetometer, stuck.0, stuck.1);
            }
        }
        self.active = active;
    }

    /// The faults that are present.
    pub fn active(&self) -> impl Iterator<Item = &Active> {
        self.active.iter().flatten()
    }

    /// How every pair of sources lay to each other at the last step, whether or not that means a fault.
    pub fn residuals(&self, told: &mut dyn FnMut(Residual)) {
        self.pair.told().into_iter().for_each(|(_, r)| told(r));
        self.fixes.told().into_iter().for_each(|(_, r)| told(r));
        told(self.height.told().1);
        self.field.told().into_iter().for_each(|(_, r)| told(r));
        told(self.weight.residual());
        self.rotors.residuals(told);
        self.speed.residuals(told);
    }

    /// One bit for each fault that is present, as in MAVOBSERVER_FAULT.
    pub fn bits(&self) -> u32 {
        self.active().filter(|a| a.or == 0).fold(0, |bits, a| bits | a.fault.bit())
    }

    /// One bit for each fault of which one is present, where the data cannot tell which.
    pub fn candidates(&self) -> u32 {
        self.active().filter(|a| a.or != 0).fold(0, |bits, a| bits | a.fault.bit() | a.or)
    }
}
