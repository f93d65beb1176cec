use super::slot::{Clock, Slot, joint};
use super::snapshot::{FaultDetail, FaultMask, ObserverReport, Snapshot, VehicleId, WindEstimate, WrenchEstimate};
use crate::faults::{FaultBank, FaultSettings};
use crate::signal::{Channel, Guarantee, Measurement, Verdict};
use crate::telemetry::{Aligner, Decoded, Decoder};
use crate::vehicle::{SEA_LEVEL_KGM3, Vehicle};
use crate::wind::{Flow, ForceInterval, WindObserver};
use crate::wire::FrameRef;
use nalgebra::{UnitQuaternion, Vector3};
use std::sync::Arc;

/// Faults under which the assumptions of force and wind do not hold: all but those of barometer and GNSS position.
const BREAKS_BOUNDS: u32 = !(1 << 15 | 1 << 16);

/// One vehicle from frames to snapshots.
pub struct Chain {
    id: VehicleId,
    vehicle: Arc<Vehicle>,
    decoder: Decoder,
    aligner: Aligner,
    /// In the order of their ids, whatever the order in the config.
    slots: Vec<Slot>,
    faults: FaultBank,
    wind: WindObserver,
    clock: Option<Clock>,
}

impl Chain {
    pub(super) fn new(
        id: VehicleId,
        vehicle: Arc<Vehicle>,
        slots: Vec<Slot>,
        faults: FaultSettings,
        clock: Option<Clock>,
    ) -> Self {
        Self {
            id,
            decoder: Decoder::new(vehicle.actuators.source),
            aligner: Aligner::new(Arc::clone(&vehicle)),
            faults: FaultBank::new(&vehicle, faults),
            vehicle,
            slots,
            wind: WindObserver::default(),
            clock,
        }
    }

    /// Runs these observers from now on: those that run already with the same options go on.
    pub(super) fn tune(&mut self, slots: &[Slot], faults: Option<FaultSettings>) {
        let mut before = std::mem::take(&mut self.slots);
        self.slots = slots
            .iter()
            .map(|new| match before.iter().position(|s| s.is(new.registration, &new.options)) {
                Some(same) => before.swap_remove(same),
                None => new.fresh(),
            })
            .collect();
        if let Some(faults) = faults {
            self.faults = FaultBank::new(&self.vehicle, faults);
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
        for residual in self.slots.iter().flat_map(|slot| slot.observer.residuals()) {
            self.faults.contradicted(residual, m.stamp);
        }
        self.faults.step(m);
        let mut wrench = self.slots.iter().find_map(Slot::wrench);
        // a sensor or rotor that is found at fault is one of those that the bound rests on
        if let Some(wrench) = wrench.as_mut().filter(|_| self.faults.bits() & BREAKS_BOUNDS != 0) {
            wrench.guarantee = Guarantee::None;
        }
        let wind = self.wind(m, wrench.as_ref());
        let snapshot = Snapshot {
            vehicle: self.id,
            stamp: m.stamp,
            received_unix_us,
            wrench,
            wind,
            faults: FaultMask(self.faults.bits()),
            fault_candidates: FaultMask(self.faults.candidates()),
            newest_fault: self.newest_fault(),
            verdict: joint(self.slots.iter().map(|s| s.observer.estimate().verdict)),
            observers: Reports(&self.slots),
        };
        sink(self, &snapshot, m);
    }

    fn newest_fault(&self) -> Option<FaultDetail> {
        let newest = self.faults.active().max_by_key(|a| a.onset)?;
        let mask = FaultMask(newest.fault.bit() | newest.or);
        Some(FaultDetail { mask, onset: newest.onset, magnitude: newest.magnitude, guarantee: newest.guarantee })
    }

    fn wind(&mut self, m: &Measurement, wrench: Option<&WrenchEstimate>) -> Option<WindEstimate> {
        if m.discontinuity.is_some() {
            self.wind.reset();
        }
        let Some((flow, wrench)) = wrench.and_then(|w| Some((self.flow(m, w)?, w))) else {
            self.wind.reset();
            return None;
        };
        let wind = self.wind.step(&self.vehicle, &flow, m.dt_s)?;
        let finite = wind.half_width_mps.iter().all(|h| h.is_finite());
        Some(WindEstimate {
            velocity_ned_mps: wind.velocity_ned_mps,
            half_width_mps: wind.half_width_mps,
            guarantee: if finite { wrench.guarantee } else { Guarantee::None },
            verdict: match wrench.verdict {
                Verdict::Consistent if wind.turning => Verdict::Settling,
                verdict => verdict,
            },
        })
    }

    fn flow(&self, m: &Measurement, wrench: &WrenchEstimate) -> Option<Flow> {
        let autopilot = m.attitude?.value;
        let rotation = autopilot.to_rotation_matrix().into_inner();
        // while the data contradict what is declared, neither bound is to be trusted more than the other
        let force = (wrench.verdict == Verdict::Consistent).then(|| ForceInterval {
            value_frd_n: rotation.tr_mul(&wrench.force_ned_n),
            half_width_frd_n: rotation.abs().tr_mul(&wrench.force_half_width_n),
        });
        let (body_to_ned, yaw_rad) = self.heading(autopilot);
        Some(Flow {
            imu: m.imu,
            body_to_ned,
            yaw_rad,
            velocity_ned_mps: m.velocity_ned_mps?.value,
            gnss_velocity_mps: m.gnss.and_then(|fix| fix.fresh()).and_then(|fix| fix.ground_velocity_mps),
            actuation: m.actuation?.value,
            density_kgm3: m
                .air_density_kgm3
                .map(|d| d.value)
                .or(self.vehicle.thrust.density_ref_kgm3)
                .unwrap_or(SEA_LEVEL_KGM3),
            force,
        })
    }

    /// The attitude with the best heading there is, and how far that may be off, rad.
    ///
    /// Where the autopilot's heading is declared to be poor, an observer that finds its own from raw sensors replaces
    /// it. The bound keeps resting on what is declared of the autopilot's, unless that observer guarantees a better one:
    /// the true heading is within the declared error of the autopilot's, so it is within that and the difference of the
    /// two of the other.
    fn heading(&self, autopilot: UnitQuaternion<f64>) -> (UnitQuaternion<f64>, f64) {
        let declared = self.vehicle.noise.yaw_rad;
        let own = self.slots.iter().find_map(Slot::heading);
        match own.filter(|h| h.likely_error_rad < declared) {
            None => (autopilot, declared),
            Some(h) => {
                let turn = wrap(h.yaw_rad - autopilot.euler_angles().2);
                let rested = declared + turn.abs();
                let bound = h.guaranteed_rad.map_or(rested, |own| own.min(rested));
                (UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn) * autopilot, bound)
            }
        }
    }
}

/// An angle brought into −π..π.
fn wrap(angle: f64) -> f64 {
    angle.sin().atan2(angle.cos())
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
