use super::fault::{Active, Fault};
use super::field::Field;
use super::fixes::Fixes;
use super::height::Height;
use super::inertial::Pair;
use super::monitor::Monitor;
use super::rotors::Rotors;
use super::speed::Speed;
use super::weight::Weight;
use crate::signal::{Measurement, Residual};
use crate::vehicle::Vehicle;

/// Judging begins this long after take-off and after every break of continuity, s.
const QUIET_S: f64 = 3.0;
/// An estimator that was led astray needs this long to find back, s.
const AFTERMATH_S: f64 = 4.0;
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
    pair: Pair,
    fixes: Fixes,
    height: Height,
    field: Field,
    rotors: Rotors,
    speed: Speed,
    weight: Weight,
    flying_s: f64,
    /// For this long neither the vehicle's own attitude nor its own motion is to be trusted, s.
    turned_s: f64,
    doubtful_s: f64,
    active: [Option<Active>; MOST],
}

impl FaultBank {
    pub fn new(vehicle: &Vehicle) -> Self {
        let per_hour = 0.001;
        Self {
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
            Some(First | Gap | Reboot) => *self = Self::new(&self.vehicle),
        }
    }

    /// The rotor at fault. Its speed names it beyond doubt; torque is quicker, and sees a broken blade.
    fn rotor(&self) -> Option<(u8, &Monitor, Residual)> {
        let by_speed = self.speed.told().map(|(i, monitor, residual)| (i as u8, monitor, residual));
        by_speed.or_else(|| self.rotors.told())
    }

    fn tell(&mut self) {
        let mut n = 0;
        let mut active = [None; MOST];
        let mut add = |fault, monitor: &Monitor, residual: Residual| {
            if let (Some(onset), Some(place)) = (monitor.onset(), active.get_mut(n)) {
                *place = Some(Active { fault, onset, magnitude: residual.value });
                n += 1;
            }
        };
        if let Some((i, monitor, residual)) = self.rotor() {
            add(Fault::Rotor(i), monitor, residual);
        }
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
        if let (Some((onset, magnitude)), Some(place)) = (self.weight.told(), active.get_mut(n)) {
            *place = Some(Active { fault: Fault::Payload, onset, magnitude });
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
        self.active().fold(0, |bits, a| bits | a.fault.bit())
    }
}
