use super::snapshot::{FaultMask, ObserverReport, Snapshot, VehicleId, WindEstimate, WrenchEstimate};
use crate::observers::{Observer, Registration};
use crate::signal::{Channel, Guarantee, Measurement, Verdict};
use crate::telemetry::{Aligner, Decoded, Decoder};
use crate::vehicle::Vehicle;
use crate::wind::{Flow, ForceInterval, Wind, wind_from_force};
use crate::wire::FrameRef;
use nalgebra::Vector3;
use std::sync::Arc;

/// Air density when the vehicle sends no pressure, kg/m³: sea level, standard atmosphere.
const SEA_LEVEL_KGM3: f64 = 1.225;

/// One observer with its place in the registry.
pub(super) struct Slot {
    pub registration: &'static Registration,
    pub observer: Box<dyn Observer>,
    pub steps: u64,
    /// Values that make up a wrench, when the observer estimates one.
    wrench: Option<[usize; 6]>,
}

impl Slot {
    pub fn new(registration: &'static Registration, observer: Box<dyn Observer>) -> Self {
        const NAMES: [&str; 6] = ["force_n", "force_e", "force_d", "torque_x", "torque_y", "torque_z"];
        let at = NAMES.map(|name| observer.signals().iter().position(|s| s.name == name));
        let wrench = at.iter().all(Option::is_some).then(|| at.map(Option::unwrap_or_default));
        Self { registration, observer, steps: 0, wrench }
    }

    /// The same observer for another vehicle.
    pub fn fresh(&self) -> Self {
        Self::new(self.registration, self.observer.fresh())
    }

    fn wrench(&self) -> Option<WrenchEstimate> {
        let at = self.wrench?;
        let e = self.observer.estimate();
        if matches!(e.verdict, Verdict::Grounded | Verdict::Starved) {
            return None;
        }
        let pick = |from: &[f64], k: usize| Vector3::new(from[at[k]], from[at[k + 1]], from[at[k + 2]]);
        Some(WrenchEstimate {
            force_ned_n: pick(&e.values, 0),
            force_half_width_n: pick(&e.half_widths, 0),
            torque_frd_nm: pick(&e.values, 3),
            torque_half_width_nm: pick(&e.half_widths, 3),
            guarantee: e.guarantee,
            verdict: e.verdict,
        })
    }
}

/// One vehicle from frames to snapshots.
pub struct Chain {
    id: VehicleId,
    vehicle: Arc<Vehicle>,
    decoder: Decoder,
    aligner: Aligner,
    slots: Vec<Slot>,
    failures: u64,
}

impl Chain {
    pub(super) fn new(id: VehicleId, vehicle: Arc<Vehicle>, slots: Vec<Slot>) -> Self {
        Self {
            id,
            decoder: Decoder::new(vehicle.actuators.source),
            aligner: Aligner::new(Arc::clone(&vehicle)),
            vehicle,
            slots,
            failures: 0,
        }
    }

    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Steps that failed and reset their observer.
    pub fn failures(&self) -> u64 {
        self.failures
    }

    /// The channels of these that do not arrive.
    pub fn missing<'a>(&'a self, needs: &'a [Channel]) -> impl Iterator<Item = Channel> + 'a {
        needs.iter().copied().filter(|c| self.aligner.missing(*c))
    }

    pub(super) fn slots(&self) -> &[Slot] {
        &self.slots
    }

    /// Takes one frame of this vehicle's autopilot; calls `sink` with each snapshot that it completes.
    pub(super) fn frame(
        &mut self,
        frame: FrameRef<'_>,
        received_unix_us: u64,
        sink: &mut dyn FnMut(&Self, &Snapshot<'_>, &Measurement),
    ) {
        let aligner = &mut self.aligner;
        self.decoder.frame(frame, received_unix_us, &mut |d| match d {
            Decoded::Sample(s) => aligner.push(s),
            Decoded::Reboot => aligner.restart(),
            Decoded::EstimatorReset => aligner.estimator_reset(),
            Decoded::RotorOutput { rotor, output } => aligner.map_rotor(rotor, output),
        });
        while let Some(m) = self.aligner.poll() {
            self.step(&m, received_unix_us, sink);
        }
    }

    fn step(
        &mut self,
        m: &Measurement,
        received_unix_us: u64,
        sink: &mut dyn FnMut(&Self, &Snapshot<'_>, &Measurement),
    ) {
        for slot in &mut self.slots {
            slot.steps += 1;
            if slot.observer.step(m).is_err() {
                self.failures += 1;
            }
        }
        let wrench = self.slots.iter().find_map(Slot::wrench);
        let wind = wrench.as_ref().and_then(|w| self.wind(m, w));
        let verdict = self.slots.first().map_or(Verdict::Starved, |s| s.observer.estimate().verdict);
        let snapshot = Snapshot {
            vehicle: self.id,
            stamp: m.stamp,
            received_unix_us,
            wrench,
            wind,
            faults: FaultMask::default(),
            verdict,
            observers: Reports(&self.slots),
        };
        sink(self, &snapshot, m);
    }

    fn wind(&self, m: &Measurement, wrench: &WrenchEstimate) -> Option<WindEstimate> {
        let flow = Flow {
            imu: m.imu,
            body_to_ned: m.attitude?.value,
            velocity_ned_mps: m.velocity_ned_mps?.value,
            actuation: m.actuation?.value,
            density_kgm3: m
                .air_density_kgm3
                .map(|d| d.value)
                .or(self.vehicle.thrust.density_ref_kgm3)
                .unwrap_or(SEA_LEVEL_KGM3),
        };
        let force = ForceInterval {
            value_ned_n: wrench.force_ned_n,
            half_width_ned_n: wrench.force_half_width_n,
            trust_accelerometer: wrench.verdict == Verdict::Consistent,
        };
        let Wind { velocity_ned_mps, half_width_mps } = wind_from_force(&self.vehicle, &flow, &force)?;
        let guarantee = if half_width_mps.iter().all(|h| h.is_finite()) { wrench.guarantee } else { Guarantee::None };
        Some(WindEstimate { velocity_ned_mps, half_width_mps, guarantee })
    }
}

/// The observers of a snapshot, without copying them.
#[derive(Clone, Copy, Default)]
pub struct Reports<'a>(pub(super) &'a [Slot]);

impl<'a> Reports<'a> {
    pub fn len(self) -> usize {
        self.0.len()
    }

    pub fn is_empty(self) -> bool {
        self.0.is_empty()
    }

    pub fn iter(self) -> impl Iterator<Item = ObserverReport<'a>> {
        self.0.iter().map(|s| ObserverReport {
            name: s.registration.name,
            id: s.registration.id,
            signals: s.observer.signals(),
            estimate: s.observer.estimate(),
            steps: s.steps,
        })
    }
}
