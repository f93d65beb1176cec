use super::chain::Chain;
use super::notices::Notices;
use super::slot::{Clock, Slot};
use super::snapshot::{Snapshot, VehicleId};
use crate::faults::FaultSettings;
use crate::observers::{self, BuildError, Options};
use crate::signal::Measurement;
use crate::vehicle::Vehicle;
use crate::wire::FrameRef;
use std::collections::BTreeMap;
use std::sync::Arc;

/// MAV_AUTOPILOT_INVALID: the component is no flight controller.
const AUTOPILOT_INVALID: u8 = 8;

/// One observer to run on every vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct ObserverSetting {
    pub name: String,
    pub options: Options,
    /// A vehicle that it cannot serve is an error; else it is left out there.
    pub required: bool,
    /// It is kept, with its options, and does not run.
    pub paused: bool,
}

impl ObserverSetting {
    /// An observer that was asked for by name, with its defaults.
    pub fn named(name: &str) -> Self {
        Self { name: name.to_owned(), options: Options::default(), required: true, paused: false }
    }

    /// The observers that run when none is named: all that are quick to build and cheap to step, where the vehicle's
    /// file has what they live on.
    pub fn standard() -> Vec<Self> {
        let all = observers::REGISTRY.iter().filter(|r| r.standard);
        all.map(|r| Self { required: false, ..Self::named(r.name) }).collect()
    }
}

/// What a fleet is made of.
#[derive(Debug, Clone)]
pub struct FleetSettings {
    /// The model of every vehicle that has none of its own.
    pub vehicle: Arc<Vehicle>,
    /// Models by MAVLink system id.
    pub by_system: BTreeMap<u8, Arc<Vehicle>>,
    pub observers: Vec<ObserverSetting>,
    pub faults: FaultSettings,
}

impl FleetSettings {
    /// The standard observers with their defaults, for one vehicle model.
    pub fn standard(vehicle: Arc<Vehicle>) -> Self {
        Self {
            vehicle,
            by_system: BTreeMap::new(),
            observers: ObserverSetting::standard(),
            faults: FaultSettings::default(),
        }
    }
}

/// What may be changed while a fleet runs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tuning {
    pub observers: Vec<ObserverSetting>,
    pub faults: FaultSettings,
}

/// What a heartbeat says of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VehicleKind {
    /// MAV_AUTOPILOT: 3 ArduPilot, 12 PX4.
    pub autopilot: u8,
    /// MAV_TYPE.
    pub mav_type: u8,
}

impl VehicleKind {
    /// Is this a multirotor, the only kind that the models describe? (MAV_TYPE quad, coaxial, hexa, octo, tri, dodeca,
    /// deca)
    pub fn is_multirotor(self) -> bool {
        matches!(self.mav_type, 2 | 3 | 13 | 14 | 15 | 29 | 35)
    }

    /// What it is, in words, with its article.
    pub fn name(self) -> &'static str {
        match self.mav_type {
            _ if self.is_multirotor() => "a multirotor",
            1 => "a fixed wing",
            4 => "a helicopter",
            10 => "a rover",
            11 => "a boat",
            12 => "a submarine",
            19..=25 => "a VTOL",
            _ => "no multirotor",
        }
    }
}

/// How much a notice matters; the values are MAV_SEVERITY's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    Warning = 4,
    Notice = 5,
    Info = 6,
}

/// What comes out of a fleet.
pub enum Event<'a> {
    /// A vehicle was heard of for the first time.
    NewVehicle { vehicle: VehicleId, kind: VehicleKind },
    /// One measurement was worked through.
    Snapshot(&'a Snapshot<'a>, &'a Measurement),
    /// Something changed that a person should know. Sent once a change, never every step.
    Notice { vehicle: VehicleId, severity: Severity, text: &'a str },
}

struct Member {
    kind: VehicleKind,
    /// `None` for what is no multirotor.
    chain: Option<Chain>,
    notices: Notices,
}

/// All vehicles on the links, each with its own state: nothing one does reaches another.
pub struct Fleet {
    /// The model of every vehicle that has none of its own.
    standard: Model,
    by_system: BTreeMap<u8, Model>,
    tuning: Tuning,
    members: BTreeMap<VehicleId, Member>,
    clock: Option<Clock>,
}

impl Fleet {
    /// Builds each observer once for each vehicle model: a design that fails does so here, and a vehicle that turns up
    /// in the middle of the traffic holds nothing up.
    ///
    /// # Errors
    /// [`BuildError`] for unknown observers or options, and for designs that do not exist.
    pub fn new(settings: FleetSettings) -> Result<Self, BuildError> {
        let tuning = Tuning { observers: settings.observers, faults: settings.faults };
        let model = |vehicle: &Arc<Vehicle>| Model::new(vehicle, &tuning, &[]);
        let by_system = settings.by_system.iter().map(|(id, vehicle)| Ok((*id, model(vehicle)?)));
        Ok(Self {
            standard: model(&settings.vehicle)?,
            by_system: by_system.collect::<Result<_, BuildError>>()?,
            tuning,
            members: BTreeMap::new(),
            clock: None,
        })
    }

    /// How the observers run now.
    pub fn tuning(&self) -> &Tuning {
        &self.tuning
    }

    /// Runs the observers in another way from now on. Those whose settings stay go on as they are, the others begin
    /// anew; the detectors of faults do if their settings change. May design, which takes up to a second.
    ///
    /// # Errors
    /// [`BuildError`], and nothing is changed.
    pub fn tune(&mut self, tuning: Tuning) -> Result<(), BuildError> {
        let other = |model: &Model| Model::new(&model.vehicle, &tuning, &model.slots);
        let standard = other(&self.standard)?;
        let by_system = self.by_system.iter().map(|(id, model)| Ok((*id, other(model)?)));
        self.by_system = by_system.collect::<Result<_, BuildError>>()?;
        self.standard = standard;
        let faults = (tuning.faults != self.tuning.faults).then_some(tuning.faults);
        for (id, member) in &mut self.members {
            let model = self.by_system.get(&id.system).unwrap_or(&self.standard);
            if let Some(chain) = &mut member.chain {
                chain.tune(&model.slots, faults);
            }
        }
        self.tuning = tuning;
        Ok(())
    }

    /// Measures what the steps of the observers cost by this clock. Estimates do not depend on it.
    pub fn timed(mut self, clock: Clock) -> Self {
        self.clock = Some(clock);
        self
    }

    /// Why observers were left out, for each vehicle model.
    pub fn left_out(&self) -> impl Iterator<Item = &str> {
        let models = std::iter::once(&self.standard).chain(self.by_system.values());
        models.flat_map(|m| m.left_out.iter().map(String::as_str))
    }

    /// Takes in one frame of any system, received at `received_unix_us` (µs since 1970).
    pub fn frame(&mut self, frame: FrameRef<'_>, received_unix_us: u64, sink: &mut dyn FnMut(Event<'_>)) {
        let id = VehicleId { system: frame.system_id(), component: frame.component_id() };
        if frame.message_id() == 0 {
            self.heartbeat(id, frame, sink);
        }
        let Some(member) = self.members.get_mut(&id) else { return };
        let Member { chain: Some(chain), notices, .. } = member else { return };
        chain.frame(frame, received_unix_us, &mut |chain, snapshot, m| {
            sink(Event::Snapshot(snapshot, m));
            notices.after_step(chain, snapshot, m, &mut |severity, text| {
                sink(Event::Notice { vehicle: id, severity, text });
            });
        });
    }

    fn heartbeat(&mut self, id: VehicleId, frame: FrameRef<'_>, sink: &mut dyn FnMut(Event<'_>)) {
        let f = frame.fields();
        let kind = VehicleKind { autopilot: f.u8(5), mav_type: f.u8(4) };
        if kind.autopilot == AUTOPILOT_INVALID || self.members.contains_key(&id) {
            return;
        }
        sink(Event::NewVehicle { vehicle: id, kind });
        let model = self.by_system.get(&id.system).unwrap_or(&self.standard);
        let chain = kind.is_multirotor().then(|| model.chain(id, self.clock));
        if chain.is_none() {
            let text = format!("vehicle {id} is {}: only multirotors are estimated", kind.name());
            sink(Event::Notice { vehicle: id, severity: Severity::Notice, text: &text });
        }
        self.members.insert(id, Member { kind, chain, notices: Notices::default() });
    }

    pub fn vehicles(&self) -> impl Iterator<Item = (VehicleId, VehicleKind, Option<&Chain>)> {
        self.members.iter().map(|(id, m)| (*id, m.kind, m.chain.as_ref()))
    }

    /// Drops one vehicle's state, after an error in its chain; its next heartbeat starts it anew.
    pub fn forget(&mut self, id: VehicleId) {
        self.members.remove(&id);
    }
}

/// A vehicle model with its observers, designed.
struct Model {
    vehicle: Arc<Vehicle>,
    /// In the order of their ids.
    slots: Vec<Slot>,
    faults: FaultSettings,
    left_out: Vec<String>,
}

impl Model {
    /// Designs what is not among `known`.
    fn new(vehicle: &Arc<Vehicle>, tuning: &Tuning, known: &[Slot]) -> Result<Self, BuildError> {
        let (mut slots, mut left_out) = (Vec::new(), Vec::new());
        for o in tuning.observers.iter().filter(|o| !o.paused) {
            let registration = observers::find(&o.name)?;
            if let Some(same) = known.iter().find(|s| s.is(registration, &o.options)) {
                slots.push(same.fresh());
                continue;
            }
            match observers::build(&o.name, vehicle, o.options.clone()) {
                Ok(observer) => slots.push(Slot::new(registration, o.options.clone(), observer)),
                Err(e @ BuildError::Unsuited { .. }) if !o.required => {
                    left_out.push(format!("vehicle `{}`: {e}", vehicle.name));
                }
                Err(e) => return Err(e),
            }
        }
        slots.sort_by_key(|s| s.registration.id);
        Ok(Self { vehicle: Arc::clone(vehicle), slots, faults: tuning.faults, left_out })
    }

    /// A chain for one vehicle of this model.
    fn chain(&self, id: VehicleId, clock: Option<Clock>) -> Chain {
        Chain::new(id, Arc::clone(&self.vehicle), self.slots.iter().map(Slot::fresh).collect(), self.faults, clock)
    }
}
