//! The thread on which observers run, and what becomes of their answers.

use super::batches::{Receiver, Took};
use super::clock::{Steady, unix_us};
use super::dialogue::{Dialogue, Now, Question, Word};
use super::farewell::Farewell;
use super::keeper::Keeper;
use super::recorder::{Estimates, RecorderHandle};
use super::router::{LinkId, Origin, Router};
use super::status::Board;
use crate::config::Vehicles;
use crate::observers::BuildError;
use crate::outputs::{LinkOutputs, OutputSettings};
use crate::pipeline::{Event, Fleet, Severity, Snapshot, Tuning, VehicleId};
use crate::record::session::Track;
use crate::station::{self, Answer, Change, StationSettings};
use crate::telemetry::requests::Need;
use crate::wire::{FrameBuf, FrameRef};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Duration;
use tracing::{error, info, warn};

/// After this many panics a vehicle is no longer estimated.
const MOST_PANICS: u8 = 3;
/// Time between two tables of what was decided for a vehicle, ms.
const TABLE_EVERY_MS: u64 = 1_000;
/// How long the thread sleeps when nothing comes.
const IDLE: Duration = Duration::from_secs(1);

/// Turns frames into estimates, for all vehicles. Knows no I/O and no clock.
pub trait Estimator: Send + 'static {
    /// Takes in one frame of any system; tells `sink` what follows from it.
    fn frame(&mut self, frame: FrameRef<'_>, received_unix_us: u64, sink: &mut dyn FnMut(Event<'_>));

    /// Drops all state of a vehicle, which is met anew with its next heartbeat.
    fn forget(&mut self, vehicle: VehicleId);

    /// How it estimates now.
    fn tuning(&self) -> Tuning {
        Tuning::default()
    }

    /// Estimates in another way from now on.
    ///
    /// # Errors
    /// Why it cannot; nothing is changed then.
    fn tune(&mut self, _tuning: Tuning) -> Result<(), BuildError> {
        Ok(())
    }
}

impl Estimator for Fleet {
    fn frame(&mut self, frame: FrameRef<'_>, received_unix_us: u64, sink: &mut dyn FnMut(Event<'_>)) {
        Fleet::frame(self, frame, received_unix_us, sink);
    }

    fn forget(&mut self, vehicle: VehicleId) {
        Fleet::forget(self, vehicle);
    }

    fn tuning(&self) -> Tuning {
        Fleet::tuning(self).clone()
    }

    fn tune(&mut self, tuning: Tuning) -> Result<(), BuildError> {
        Fleet::tune(self, tuning)
    }
}

/// A frame for the estimator.
#[derive(Debug)]
pub(super) struct Work {
    pub(super) frame: FrameBuf,
    pub(super) origin: Origin,
    pub(super) received_us: u64,
    /// The sender can be asked for something.
    pub(super) live: bool,
}

/// What live vehicles are asked.
#[derive(Debug, Clone)]
pub(super) struct Requests {
    pub(super) needs: Vec<Need>,
    pub(super) models: Vehicles,
}

/// Everything that runs on the estimator's thread.
pub(super) struct Worker<E> {
    estimator: E,
    voice: Voice,
    vehicles: Vec<Vehicle>,
    requests: Option<Requests>,
    component: u8,
    board: Arc<Board>,
    steady: Steady,
    farewell: Arc<Farewell>,
    /// How often each vehicle's observers panicked; most never do.
    panics: BTreeMap<VehicleId, u8>,
}

struct Vehicle {
    id: VehicleId,
    dialogue: Option<Dialogue>,
    /// When what was decided was last written down.
    table_ms: u64,
}

impl<E: Estimator> Worker<E> {
    pub(super) fn new(
        mut estimator: E,
        voice: Voice,
        requests: Option<Requests>,
        board: Arc<Board>,
        farewell: Arc<Farewell>,
    ) -> Self {
        let before = estimator.tuning();
        let kept = voice.keeper.tuning(before.clone());
        if kept != before
            && let Err(e) = estimator.tune(kept)
        {
            warn!("the observers run as configured, not by the kept parameters: {e}");
        }
        Self {
            farewell,
            estimator,
            component: voice.component(),
            voice,
            vehicles: Vec::new(),
            requests,
            board,
            steady: Steady::start(),
            panics: BTreeMap::new(),
        }
    }

    /// Works until every link is closed and the queue is empty.
    pub(super) fn run(mut self, mut queue: Receiver<Work>) {
        let mut batch = Vec::new();
        loop {
            let took = queue.take(&mut batch, IDLE);
            batch.drain(..).for_each(|work| self.take(&work));
            if self.farewell.is_due() {
                self.leave();
            }
            if took == Took::Closed {
                break;
            }
        }
    }

    fn take(&mut self, work: &Work) {
        let frame = work.frame.as_ref();
        let id = VehicleId { system: frame.system_id(), component: frame.component_id() };
        if work.live && id.component != self.component {
            self.answer(frame, work.origin);
        }
        // our own messages come back where two links lead to one network
        if id.component == self.component || self.panics.get(&id).is_some_and(|&count| count >= MOST_PANICS) {
            return;
        }
        // A panic leaves the vehicle's own state half-changed, and that is dropped below. The others are not touched
        // by this frame; outputs and vehicles are plain data that any later frame overwrites.
        let outcome = catch_unwind(AssertUnwindSafe(|| self.estimate(id, frame, work)));
        if outcome.is_err() {
            self.panicked(id);
        }
    }

    fn estimate(&mut self, id: VehicleId, frame: FrameRef<'_>, work: &Work) {
        let (voice, board, vehicles) = (&mut self.voice, &self.board, &mut self.vehicles);
        self.estimator.frame(frame, work.received_us, &mut |event| match event {
            Event::NewVehicle { vehicle, kind } => {
                info!(%vehicle, autopilot = kind.autopilot, r#type = kind.mav_type, "new vehicle");
                if kind.is_multirotor() {
                    vehicles.push(Vehicle { id: vehicle, dialogue: None, table_ms: 0 });
                    let text = concat!("mavobserver ", env!("CARGO_PKG_VERSION"), " observes this vehicle");
                    voice.text(vehicle, Severity::Info, text, work.received_us);
                }
            }
            Event::Snapshot(snapshot, _) => {
                board.snapshot(snapshot);
                voice.snapshot(snapshot);
            }
            Event::Notice { vehicle, severity, text } => {
                match severity {
                    Severity::Warning => warn!(%vehicle, "{text}"),
                    Severity::Notice | Severity::Info => info!(%vehicle, "{text}"),
                }
                voice.text(vehicle, severity, text, work.received_us);
            }
        });
        if let Some(index) = self.vehicles.iter().position(|v| v.id == id) {
            self.voice.heard(id, work.received_us);
            if work.live {
                self.converse(index, frame, work);
            }
        }
    }

    /// Stream requests and time questions for the live vehicle that sent `frame`.
    fn converse(&mut self, index: usize, frame: FrameRef<'_>, work: &Work) {
        let Some(requests) = &self.requests else { return };
        let Vehicle { id, dialogue, table_ms } = &mut self.vehicles[index];
        let dialogue = dialogue.get_or_insert_with(|| {
            let model = requests.models.of(id.system).cloned();
            Dialogue::new(*id, self.component, requests.needs.clone(), model, work.origin)
        });
        let now = Now { unix_us: work.received_us, steady_ms: self.steady.ms() };
        dialogue.heard(frame, work.origin, now);
        self.board.clock(*id, dialogue.clock_offset());
        if now.steady_ms.saturating_sub(*table_ms) >= TABLE_EVERY_MS {
            *table_ms = now.steady_ms;
            self.board.pairing(*id, dialogue.decisions(now));
        }
        // a question's time is when it leaves, not when the frame before it came
        let now = Now { unix_us: unix_us(), ..now };
        let questions = dialogue.poll(now, &mut |word| match word {
            Word::Warning(text) => warn!(vehicle = %id, "{text}"),
            Word::Info(text) => info!(vehicle = %id, "{text}"),
        });
        for question in questions.into_iter().flatten() {
            self.voice.ask(*id, &question, dialogue.origin);
        }
        if dialogue.owes() {
            self.farewell.owe();
        }
    }

    /// Answers what is asked of our component, in each vehicle's system.
    fn answer(&mut self, frame: FrameRef<'_>, origin: Origin) {
        // looked up first: hardly any frame is addressed to us
        let Some((_, component)) = frame.target().filter(|(_, c)| *c == 0 || *c == self.component) else { return };
        let now_ms = self.steady.ms();
        let mut last = None;
        for index in 0..self.vehicles.len() {
            let id = self.vehicles[index].id;
            // what everybody is asked is not answered to the vehicle itself
            let asks_all = component == 0 && frame.system_id() == id.system;
            if last != Some(id.system) && !asks_all {
                let (tuning, mut refused) = (self.estimator.tuning(), None);
                let tune = &mut |tuning: &Tuning| {
                    refused = self.estimator.tune(tuning.clone()).err();
                    refused.is_none()
                };
                self.voice.answer(id.system, frame, origin, now_ms, tuning, tune);
                if let Some(why) = refused {
                    warn!(vehicle = %id, "a parameter is refused: {why}");
                    self.voice.text(id, Severity::Warning, &format!("refused: {why}"), unix_us());
                }
            }
            last = Some(id.system);
        }
    }

    /// Gives back what the vehicles granted, and asks nothing more.
    fn leave(&mut self) {
        self.requests = None;
        for Vehicle { id, dialogue, .. } in &self.vehicles {
            let Some(dialogue) = dialogue else { continue };
            for question in dialogue.farewell() {
                self.voice.ask(*id, &question, dialogue.origin);
            }
        }
        self.farewell.said();
    }

    fn panicked(&mut self, vehicle: VehicleId) {
        let count = self.panics.entry(vehicle).or_default();
        *count = count.saturating_add(1);
        self.estimator.forget(vehicle);
        self.vehicles.retain(|v| v.id != vehicle);
        self.board.panicked(vehicle);
        if *count < MOST_PANICS {
            error!(%vehicle, "its observers failed and start anew; other vehicles are not affected");
        } else {
            error!(%vehicle, "its observers failed {MOST_PANICS} times: it is no longer estimated");
        }
    }
}

/// Our messages to every link and to the recorder, each with its own rates and numbering.
#[derive(Debug)]
pub(super) struct Voice {
    router: Arc<Router>,
    links: Vec<(LinkId, LinkOutputs)>,
    recorder: Option<(RecorderHandle, LinkOutputs)>,
    estimates: Option<Estimates>,
    component: u8,
    keeper: Keeper,
}

impl Voice {
    pub(super) fn new(
        router: Arc<Router>,
        links: Vec<(LinkId, OutputSettings)>,
        recorder: Option<RecorderHandle>,
        keeper: Keeper,
    ) -> Self {
        // the record holds what a link with the usual rates is told, also when there is no such link
        let settings = links.first().map_or_else(OutputSettings::default, |(_, settings)| *settings);
        Self {
            router,
            component: settings.component,
            links: links.into_iter().map(|(id, settings)| (id, LinkOutputs::new(settings))).collect(),
            estimates: recorder.as_ref().map(RecorderHandle::estimates),
            recorder: recorder.map(|handle| (handle, LinkOutputs::new(settings))),
            keeper,
        }
    }

    pub(super) fn component(&self) -> u8 {
        self.component
    }

    fn snapshot(&mut self, snapshot: &Snapshot<'_>) {
        self.each(snapshot.received_unix_us, |outputs, send| outputs.snapshot(snapshot, send));
        if let Some(estimates) = &mut self.estimates {
            estimates.snapshot(snapshot);
        }
    }

    fn heard(&mut self, vehicle: VehicleId, now_us: u64) {
        self.each(now_us, |outputs, send| outputs.heard(vehicle, now_us, send));
    }

    fn text(&mut self, vehicle: VehicleId, severity: Severity, text: &str, now_us: u64) {
        self.each(now_us, |outputs, send| outputs.text(vehicle, severity, text, send));
    }

    fn each(&mut self, now_us: u64, mut speak: impl FnMut(&mut LinkOutputs, &mut dyn FnMut(FrameRef<'_>))) {
        for (id, outputs) in &mut self.links {
            speak(outputs, &mut |frame| self.router.send(frame, *id));
        }
        if let Some((recorder, outputs)) = &mut self.recorder {
            speak(outputs, &mut |frame| recorder.record(Track::Sent, 0, now_us, frame));
        }
    }

    /// Answers a frame that may be addressed to us in a system, and changes what it asks to change.
    fn answer(
        &mut self,
        system: u8,
        frame: FrameRef<'_>,
        to: Origin,
        now_ms: u64,
        tuning: Tuning,
        tune: &mut dyn FnMut(&Tuning) -> bool,
    ) {
        let Some((_, outputs)) = self.links.iter_mut().find(|(id, _)| *id == to.link) else { return };
        let mut settings = StationSettings { outputs: outputs.settings(), tuning };
        let router = &self.router;
        let mut answers = Vec::new();
        let us = (system, self.component);
        let change = station::answer(frame, us, &mut settings, now_ms as u32, tune, &mut |answer| answers.push(answer));
        for answer in &answers {
            let send = &mut |frame: FrameRef<'_>| router.answer(frame, to);
            match answer {
                Answer::Parameter(message) => outputs.message(system, message, send),
                Answer::Ack(message) => outputs.message(system, message, send),
                Answer::Interval(message) => outputs.message(system, message, send),
                Answer::Information(message) => outputs.message(system, message, send),
                Answer::Version(message) => outputs.message(system, message, send),
                Answer::Ping(message) => outputs.message(system, message, send),
            }
        }
        match change {
            Some(Change::Interval(_)) => outputs.adopt(settings.outputs),
            Some(Change::Parameter(name)) => {
                if let Some((_, parameter)) = station::parameter(name) {
                    let value = parameter.get(&settings);
                    info!("parameter {name} is now {value}");
                    let recorder = self.recorder.iter_mut().map(|(_, outputs)| outputs);
                    for outputs in self.links.iter_mut().map(|(_, outputs)| outputs).chain(recorder) {
                        let mut settings = StationSettings { outputs: outputs.settings(), ..settings.clone() };
                        parameter.set(&mut settings, value);
                        outputs.adopt(settings.outputs);
                    }
                    self.keeper.keep(name, value);
                }
            }
            None => {}
        }
    }

    /// Sends a question to where the vehicle was heard.
    fn ask(&mut self, vehicle: VehicleId, question: &Question, to: Origin) {
        let say = |outputs: &mut LinkOutputs, send: &mut dyn FnMut(FrameRef<'_>)| match question {
            Question::Command(message) => outputs.message(vehicle.system, message, send),
            Question::Stream(message) => outputs.message(vehicle.system, message, send),
            Question::Parameter(message) => outputs.message(vehicle.system, message, send),
            Question::Time(message) => outputs.message(vehicle.system, message, send),
        };
        if let Some((_, outputs)) = self.links.iter_mut().find(|(id, _)| *id == to.link) {
            say(outputs, &mut |frame| self.router.answer(frame, to));
        }
        if let Some((recorder, outputs)) = &mut self.recorder {
            say(outputs, &mut |frame| recorder.record(Track::Sent, 0, unix_us(), frame));
        }
    }
}
