use super::slot::{Clock, Slot, joint};
use super::snapshot::{FaultMask, ObserverReport, Snapshot, VehicleId, WindEstimate, WrenchEstimate};
use crate::faults::FaultBank;
use crate::signal::{Channel, Guarantee, Measurement, Verdict};
use crate::telemetry::{Aligner, Decoded, Decoder};
use crate::vehicle::{SEA_LEVEL_KGM3, Vehicle};
use crate::wind::{Flow, ForceInterval, Wind, wind_from_force};
use crate::wire::FrameRef;
use std::sync::Arc;

/// One vehicle from frames to snapshots.
pub struct Chain {
    id: VehicleId,
    vehicle: Arc<Vehicle>,
    decoder: Decoder,
    aligner: Aligner,
    /// In the order of their ids, whatever the order in the config.
    slots: Vec<Slot>,
    faults: FaultBank,
    clock: Option<Clock>,
}

impl Chain {
    pub(super) fn new(id: VehicleId, vehicle: Arc<Vehicle>, slots: Vec<Slot>, clock: Option<Clock>) -> Self {
        Self {
            id,
            decoder: Decoder::new(vehicle.actuators.source),
            aligner: Aligner::new(Arc::clone(&vehicle)),
            faults: FaultBank::new(&vehicle),
            vehicle,
            slots,
            clock,
        }
    }

    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Steps that failed and reset their observer.
    pub fn failures(&self) -> u64 {
        self.slots.iter().map(|s| s.failures).sum()
    }

    /// The channels of these that do not arrive.
    pub fn missing<'a>(&'a self, needs: &'a [Channel]) -> impl Iterator<Item = Channel> + 'a {
        needs.iter().copied().filter(|c| self.aligner.missing(*c))
    }

    /// The detectors of faults.
    pub fn faults(&self) -> &FaultBank {
        &self.faults
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
            slot.step(m, &self.aligner, self.clock);
        }
        self.faults.step(m);
        let wrench = self.slots.iter().find_map(Slot::wrench);
        let wind = wrench.as_ref().and_then(|w| self.wind(m, w));
        let snapshot = Snapshot {
            vehicle: self.id,
            stamp: m.stamp,
            received_unix_us,
            wrench,
            wind,
            faults: FaultMask(self.faults.bits()),
            verdict: joint(self.slots.iter().map(|s| s.observer.estimate().verdict)),
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
        Some(WindEstimate { velocity_ned_mps, half_width_mps, guarantee, verdict: wrench.verdict })
    }
}

/// The observers of a snapshot, in the order of their ids, without copying them.
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
            // whole nanoseconds; saturates
            step_ns: s.mean_ns as u32,
            missing: s.missing,
        })
    }
}
