use super::common::{
    SCALARS, bound_arrays, debug_vect, fault_mask, heartbeat, named_value, wind, wind_cov, wrench_array,
};
use super::limiter::Limiter;
use super::own::{ObserverCounts, fault_status, observer_status, state_bounds, wind_estimate, wrench_estimate};
use super::text::status_text;
use super::{OutputSettings, Rates};
use crate::pipeline::{FaultMask, ObserverReport, Severity, Snapshot, VehicleId};
use crate::signal::{Stamp, Verdict};
use crate::wire::dialect::ardupilotmega::MavSeverity;
use crate::wire::{Encoder, FrameRef};
use mavlink_core::MessageData;

/// Where finished frames go.
pub type Send<'a> = dyn FnMut(FrameRef<'_>) + 'a;

/// What one link is told about all vehicles: rates, sequence numbers and what was said before.
#[derive(Debug, Clone)]
pub struct LinkOutputs {
    settings: OutputSettings,
    numbering: Numbering,
    vehicles: Vec<VehicleOutputs>,
    last_text_id: u16,
}

impl LinkOutputs {
    pub fn new(settings: OutputSettings) -> Self {
        let numbering = Numbering { component: settings.component, sequences: [0; 256] };
        Self { settings, numbering, vehicles: Vec::new(), last_text_id: 0 }
    }

    pub fn settings(&self) -> OutputSettings {
        self.settings
    }

    /// Other settings from now on. The component stays: others know us by it.
    pub fn adopt(&mut self, settings: OutputSettings) {
        self.settings = OutputSettings { component: self.settings.component, ..settings };
        for vehicle in &mut self.vehicles {
            vehicle.heartbeat = Limiter::new(settings.heartbeat);
            vehicle.limiters = Limiters::new(&settings.rates);
        }
    }

    /// One message of our component in the name of `system`, whatever the rates. For requests and time questions.
    pub fn message<M: MessageData>(&mut self, system: u8, message: &M, send: &mut Send<'_>) {
        self.numbering.send(system, message, send);
    }

    /// A frame of the vehicle arrived at `now_us`: time for our heartbeat, perhaps.
    ///
    /// We speak in the name of its system, so we fall silent with it.
    pub fn heard(&mut self, vehicle: VehicleId, now_us: u64, send: &mut Send<'_>) {
        if self.vehicle(vehicle).heartbeat.pass(now_us) {
            self.numbering.send(vehicle.system, &heartbeat(), send);
        }
    }

    /// Text for the operator. Meant for state changes; nothing limits its rate.
    pub fn text(&mut self, vehicle: VehicleId, severity: Severity, text: &str, send: &mut Send<'_>) {
        if !self.settings.status_text {
            return;
        }
        // never zero, which means "not chunked"
        self.last_text_id = self.last_text_id % u16::MAX + 1;
        let id = self.last_text_id;
        let severity = match severity {
            Severity::Warning => MavSeverity::MAV_SEVERITY_WARNING,
            Severity::Notice => MavSeverity::MAV_SEVERITY_NOTICE,
            Severity::Info => MavSeverity::MAV_SEVERITY_INFO,
        };
        status_text(severity, text, id, |chunk| self.numbering.send(vehicle.system, &chunk, send));
    }

    /// Everything that the snapshot gives and whose time has come. Does not allocate once the vehicle is known.
    pub fn snapshot(&mut self, snapshot: &Snapshot<'_>, send: &mut Send<'_>) {
        let (now, stamp, system) = (snapshot.received_unix_us, snapshot.stamp, snapshot.vehicle.system);
        let index = self.index(snapshot.vehicle);
        let (vehicle, numbering) = (&mut self.vehicles[index], &mut self.numbering);
        let due = &mut vehicle.limiters;

        if let Some(wrench) = &snapshot.wrench {
            if due.wrench_estimate.pass(now) {
                numbering.send(system, &wrench_estimate(wrench, stamp), send);
            }
            if due.debug_vect.pass(now) {
                numbering.send(system, &debug_vect("WR_F", &wrench.force_ned_n, stamp), send);
                numbering.send(system, &debug_vect("WR_T", &wrench.torque_frd_nm, stamp), send);
            }
        }
        if let Some(estimate) = &snapshot.wind {
            if due.wind_estimate.pass(now) {
                numbering.send(system, &wind_estimate(estimate, stamp), send);
            }
            if due.wind_cov.pass(now) {
                numbering.send(system, &wind_cov(estimate, stamp), send);
            }
            if due.wind.pass(now) {
                numbering.send(system, &wind(estimate), send);
            }
        }
        if (snapshot.wrench.is_some() || snapshot.wind.is_some()) && due.wrench_array.pass(now) {
            numbering.send(system, &wrench_array(snapshot), send);
        }
        if due.bound_arrays.pass(now) {
            for array in bound_arrays(snapshot).iter().flatten() {
                numbering.send(system, array, send);
            }
        }
        if due.named_values.pass(now) {
            // bursts of names get lost where an autopilot passes them on, so one at a time
            let turns = (0..SCALARS.len()).map(|k| (vehicle.next_scalar + k) % SCALARS.len());
            let found = turns.filter_map(|turn| Some((turn, named_value(SCALARS.get(turn)?, snapshot)?))).next();
            if let Some((turn, message)) = found {
                vehicle.next_scalar = turn + 1;
                numbering.send(system, &message, send);
            }
        }
        let faults = FaultsSent::of(snapshot);
        if std::mem::replace(&mut vehicle.faults, faults) != faults {
            due.fault_status.hasten();
        }
        if due.fault_status.pass(now) {
            numbering.send(system, &fault_status(snapshot), send);
            numbering.send(system, &fault_mask(snapshot), send);
        }
        vehicle.tallies.resize(snapshot.observers.len(), Tally::default());
        for (report, tally) in snapshot.observers.iter().zip(&mut vehicle.tallies) {
            tally.note(report.estimate.verdict);
        }
        if due.state_bounds.pass(now) {
            for report in snapshot.observers.iter() {
                state_bounds(&report, stamp, |message| numbering.send(system, &message, send));
            }
        }
        if due.observer_status.pass(now) {
            for (report, tally) in snapshot.observers.iter().zip(&mut vehicle.tallies) {
                numbering.send(system, &observer_status(&report, tally.counts(&report, stamp), stamp), send);
            }
        }
    }

    fn vehicle(&mut self, id: VehicleId) -> &mut VehicleOutputs {
        let index = self.index(id);
        &mut self.vehicles[index]
    }

    /// Where the vehicle is in `vehicles`; always valid, as vehicles are only ever added.
    fn index(&mut self, id: VehicleId) -> usize {
        self.vehicles.iter().position(|v| v.id == id).unwrap_or_else(|| {
            self.vehicles.push(VehicleOutputs::new(id, &self.settings));
            self.vehicles.len() - 1
        })
    }
}

/// Sequence numbers of our component in each system: a receiver of this link sees no gap.
#[derive(Debug, Clone)]
struct Numbering {
    component: u8,
    sequences: [u8; 256],
}

impl Numbering {
    fn send<M: MessageData>(&mut self, system: u8, message: &M, send: &mut Send<'_>) {
        let sequence = &mut self.sequences[usize::from(system)];
        let mut encoder = Encoder { system, component: self.component, sequence: *sequence };
        let frame = encoder.encode(message);
        *sequence = encoder.sequence;
        send(frame.as_ref());
    }
}

#[derive(Debug, Clone)]
struct VehicleOutputs {
    id: VehicleId,
    heartbeat: Limiter,
    limiters: Limiters,
    next_scalar: usize,
    faults: FaultsSent,
    tallies: Vec<Tally>,
}

impl VehicleOutputs {
    fn new(id: VehicleId, settings: &OutputSettings) -> Self {
        Self {
            id,
            heartbeat: Limiter::new(settings.heartbeat),
            limiters: Limiters::new(&settings.rates),
            next_scalar: 0,
            faults: FaultsSent::default(),
            tallies: Vec::new(),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Limiters {
    debug_vect: Limiter,
    wrench_array: Limiter,
    bound_arrays: Limiter,
    named_values: Limiter,
    wind_cov: Limiter,
    wind: Limiter,
    wrench_estimate: Limiter,
    wind_estimate: Limiter,
    state_bounds: Limiter,
    fault_status: Limiter,
    observer_status: Limiter,
}

impl Limiters {
    fn new(rates: &Rates) -> Self {
        Self {
            debug_vect: Limiter::new(rates.debug_vect),
            wrench_array: Limiter::new(rates.wrench_array),
            bound_arrays: Limiter::new(rates.bound_arrays),
            named_values: Limiter::new(rates.named_values),
            wind_cov: Limiter::new(rates.wind_cov),
            wind: Limiter::new(rates.wind),
            wrench_estimate: Limiter::new(rates.wrench_estimate),
            wind_estimate: Limiter::new(rates.wind_estimate),
            state_bounds: Limiter::new(rates.state_bounds),
            fault_status: Limiter::new(rates.fault_status),
            observer_status: Limiter::new(rates.observer_status),
        }
    }
}

/// The faults last sent: a change of any of these is sent at once.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct FaultsSent {
    active: FaultMask,
    candidates: FaultMask,
    onset: Option<Stamp>,
}

impl FaultsSent {
    fn of(snapshot: &Snapshot<'_>) -> Self {
        Self {
            active: snapshot.faults,
            candidates: snapshot.fault_candidates,
            onset: snapshot.newest_fault.map(|f| f.onset),
        }
    }
}

/// What OBSERVER_STATUS counts over many snapshots.
#[derive(Debug, Clone, Copy, Default)]
struct Tally {
    violated: bool,
    violations: u32,
    last_sent: Option<(Stamp, u64)>,
}

impl Tally {
    fn note(&mut self, verdict: Verdict) {
        let violated = verdict == Verdict::AssumptionViolated;
        if violated && !self.violated {
            self.violations = self.violations.saturating_add(1);
        }
        self.violated = violated;
    }

    /// Violations so far, and the step rate since the last status.
    fn counts(&mut self, report: &ObserverReport<'_>, stamp: Stamp) -> ObserverCounts {
        let rate_hz = match self.last_sent {
            Some((then, steps)) if stamp > then => report.steps.saturating_sub(steps) as f64 / (stamp - then),
            _ => 0.0,
        };
        self.last_sent = Some((stamp, report.steps));
        ObserverCounts { violations: self.violations, rate_hz }
    }
}
