use super::fault::{Active, Fault};
use super::field::Field;
use super::fixes::Fixes;
use super::height::Height;
use super::inertial::Pair;
use super::monitor::Monitor;
use super::rotors::Rotors;
use super::weight::Weight;
use crate::signal::{Measurement, Residual};
use crate::vehicle::Vehicle;

/// Judging begins this long after take-off and after every break of continuity, s.
const QUIET_S: f64 = 3.0;
/// The most faults at a time.
const MOST: usize = 8;

/// All detectors of one vehicle.
///
/// Isolation is by elimination: a lost rotor upsets everything else, so nothing else is judged until it has cleared; a
/// rotor that pulls less looks like weight, so weight is judged only while no rotor is at fault. Allocates nothing
/// after it is made.
#[derive(Debug, Clone)]
pub struct FaultBank {
    vehicle: Vehicle,
    pair: Pair,
    fixes: Fixes,
    height: Height,
    field: Field,
    rotors: Rotors,
    weight: Weight,
    flying_s: f64,
    active: [Option<Active>; MOST],
}

impl FaultBank {
    pub fn new(vehicle: &Vehicle) -> Self {
        Self {
            vehicle: vehicle.clone(),
            pair: Pair::new(vehicle),
            fixes: Fixes::new(),
            height: Height::new(),
            field: Field::new(),
            rotors: Rotors::new(vehicle),
            weight: Weight::new(vehicle),
            flying_s: 0.0,
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
            self.weight.restart();
            self.active = [None; MOST];
            return;
        }
        self.rotors.step(m);
        if !self.rotors.lost() {
            self.pair.step(m);
            self.fixes.step(m);
            self.height.step(m);
            self.field.step(m);
        }
        match self.rotors.told() {
            Some(_) => self.weight.restart(),
            None => self.weight.step(m),
        }
        self.tell();
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

    fn tell(&mut self) {
        let mut n = 0;
        let mut active = [None; MOST];
        let mut add = |fault, monitor: &Monitor, residual: Residual| {
            if let (Some(onset), Some(place)) = (monitor.onset(), active.get_mut(n)) {
                *place = Some(Active { fault, onset, magnitude: residual.value });
                n += 1;
            }
        };
        if let Some((i, monitor, residual)) = self.rotors.told() {
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
            let (monitor, residual) = self.field.told();
            add(Fault::Magnetometer, monitor, residual);
            let (monitor, residual) = self.weight.told();
            add(Fault::Payload, monitor, residual);
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
        told(self.field.told().1);
        told(self.weight.told().1);
        self.rotors.residuals(told);
    }

    /// One bit for each fault that is present, as in MAVOBSERVER_FAULT.
    pub fn bits(&self) -> u32 {
        self.active().fold(0, |bits, a| bits | a.fault.bit())
    }
}
