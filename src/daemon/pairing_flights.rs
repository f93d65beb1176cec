//! Conversations with simulated autopilots over radios of every kind, in simulated time.

use super::dialogue::{Dialogue, Now, Question, Word};
use super::router::{LinkId, Origin};
use super::status::Decision;
use crate::document::Document;
use crate::pipeline::{Event, Fleet, FleetSettings, VehicleId};
use crate::signal::Channel;
use crate::sim::{Run, RunOptions, scenario};
use crate::telemetry::requests::Need;
use crate::vehicle::{Vehicle, resolve};
use crate::wire::dialect::ardupilotmega::STATUSTEXT_DATA;
use crate::wire::{self, Encoder, FrameBuf, decode};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::sync::Arc;

const HERE: Origin = Origin { link: LinkId(0), peer: None };
const UNIX_START_US: u64 = 1_767_225_600_000_000;

/// One direction of a link: what it carries a second, what it loses, and what waits for it.
struct Radio {
    bytes_per_s: f64,
    loss: f64,
    free_at_s: f64,
    on_the_way: VecDeque<(f64, Vec<u8>)>,
    random: ChaCha8Rng,
}

impl Radio {
    /// Bytes that wait at most: the buffer of a serial port.
    const BUFFER: f64 = 2_048.0;

    fn new(bytes_per_s: f64, loss: f64, seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed);
        Self { bytes_per_s, loss, free_at_s: 0.0, on_the_way: VecDeque::new(), random }
    }

    fn send(&mut self, bytes: &[u8], now_s: f64) {
        let waits_s = (self.free_at_s - now_s).max(0.0);
        if waits_s * self.bytes_per_s > Self::BUFFER {
            return;
        }
        self.free_at_s = now_s + waits_s + bytes.len() as f64 / self.bytes_per_s;
        if !self.random.random_bool(self.loss) {
            self.on_the_way.push_back((self.free_at_s, bytes.to_vec()));
        }
    }

    fn arrived(&mut self, now_s: f64) -> Option<Vec<u8>> {
        let due = self.on_the_way.front().is_some_and(|(at, _)| *at <= now_s);
        due.then(|| self.on_the_way.pop_front()).flatten().map(|(_, bytes)| bytes)
    }
}

struct Flight {
    run: Run,
    /// `None` once we have left.
    dialogue: Option<Dialogue>,
    fleet: Option<Fleet>,
    ours: Encoder,
    down: Radio,
    up: Radio,
    /// How often each message arrived since the counts were cleared.
    heard: BTreeMap<u32, u32>,
    /// Steps of each observer since then.
    steps: BTreeMap<&'static str, u32>,
    wind_ned_mps: Option<Vector3<f64>>,
    /// What the autopilot wrote on the console.
    console: Vec<String>,
    words: Vec<Word>,
    asked: Vec<Question>,
}

impl Flight {
    fn new(text: &str, bytes_per_s: f64, loss: f64) -> Self {
        let scenario = scenario::parse(&Document::new("flight", text), Path::new("")).expect("a scenario");
        let options = RunOptions { unix_start_us: UNIX_START_US, ..RunOptions::default() };
        let run = Run::new(&scenario, &options).expect("flies");
        let model: Arc<Vehicle> = Arc::new(resolve("arducopter-sitl").expect("a preset"));
        let fast = [Channel::Imu, Channel::Attitude, Channel::Velocity, Channel::Actuators];
        let slow = [Channel::Gnss, Channel::Magnetometer, Channel::Pressure];
        let needs = fast.into_iter().chain(slow).map(Need::at_default_rate).collect();
        let vehicle = VehicleId { system: 1, component: 1 };
        Self {
            run,
            dialogue: Some(Dialogue::new(vehicle, 191, needs, Some(model), HERE)),
            fleet: None,
            ours: Encoder::new(1, 191),
            down: Radio::new(bytes_per_s, loss, 1),
            up: Radio::new(bytes_per_s, loss, 2),
            heard: BTreeMap::new(),
            steps: BTreeMap::new(),
            wind_ned_mps: None,
            console: Vec::new(),
            words: Vec::new(),
            asked: Vec::new(),
        }
    }

    fn estimated(mut self) -> Self {
        let model = Arc::new(resolve("arducopter-sitl").expect("a preset"));
        self.fleet = Some(Fleet::new(FleetSettings::standard(model)).expect("designs"));
        self
    }

    fn now(&self) -> Now {
        let s = self.run.now_s();
        Now { unix_us: UNIX_START_US + (s * 1e6) as u64, steady_ms: (s * 1e3) as u64 }
    }

    fn fly(&mut self, seconds: f64) {
        let end = self.run.now_s() + seconds;
        while self.run.now_s() < end {
            let now_s = self.run.now_s();
            let down = &mut self.down;
            self.run.advance(&mut |received| down.send(received.bytes, now_s));
            while let Some(bytes) = self.up.arrived(now_s) {
                wire::datagram(&bytes).for_each(|event| {
                    if let wire::Event::Frame(frame) = event {
                        self.run.receive(frame);
                    }
                });
            }
            while let Some(bytes) = self.down.arrived(now_s) {
                let Some(wire::Event::Frame(frame)) = wire::datagram(&bytes).next() else { panic!("one whole frame") };
                self.hear(&FrameBuf::from(frame));
            }
        }
    }

    fn hear(&mut self, frame: &FrameBuf) {
        let (frame, now) = (frame.as_ref(), self.now());
        *self.heard.entry(frame.message_id()).or_default() += 1;
        if let Some(text) = decode::<STATUSTEXT_DATA>(frame) {
            self.console.push(text.text.to_str().expect("text").to_owned());
        }
        let (steps, wind) = (&mut self.steps, &mut self.wind_ned_mps);
        if let Some(fleet) = &mut self.fleet {
            fleet.frame(frame, now.unix_us, &mut |event| {
                let Event::Snapshot(snapshot, _) = event else { return };
                snapshot.observers.iter().for_each(|report| *steps.entry(report.name).or_default() += 1);
                *wind = snapshot.wind.map(|w| w.velocity_ned_mps).or(*wind);
            });
        }
        let Some(dialogue) = &mut self.dialogue else { return };
        dialogue.heard(frame, HERE, now);
        let words = &mut self.words;
        let questions = dialogue.poll(now, &mut |word| words.push(word));
        questions.into_iter().flatten().for_each(|question| self.ask(question));
    }

    fn ask(&mut self, question: Question) {
        let frame = match &question {
            Question::Command(message) => self.ours.encode(message),
            Question::Stream(message) => self.ours.encode(message),
            Question::Parameter(message) => self.ours.encode(message),
            Question::Time(message) => self.ours.encode(message),
        };
        self.up.send(frame.bytes(), self.run.now_s());
        self.asked.push(question);
    }

    /// Says goodbye; what the vehicle sends from then on is only counted.
    fn leave(&mut self) {
        let farewell = self.dialogue.take().expect("not yet gone").farewell();
        farewell.into_iter().for_each(|question| self.ask(question));
    }

    fn clear(&mut self) {
        self.heard.clear();
        self.steps.clear();
    }

    fn decisions(&mut self) -> Vec<Decision> {
        let now = self.now();
        self.dialogue.as_mut().expect("not yet gone").decisions(now)
    }

    fn decided(&mut self, subject: &str) -> Decision {
        let all = self.decisions();
        all.iter().find(|d| d.subject == subject).unwrap_or_else(|| panic!("no {subject} in {all:#?}")).clone()
    }

    fn warnings(&self) -> Vec<&Word> {
        self.words.iter().filter(|word| matches!(word, Word::Warning(_))).collect()
    }
}

const FAST_LINK: f64 = 1e6;

fn hover(more: &str) -> String {
    format!(
        "name = 'pair'\ndescription = 'a hover'\nvehicle = 'arducopter-sitl'\nsensors = 'ardupilot-sitl'\n\
         duration_s = 1000\nmission = [{{ leg = 'wait', seconds = 5 }}, {{ leg = 'takeoff', height_m = 10 }}, \
         {{ leg = 'hover', seconds = 1000 }}]\n[wind]\nsteps = [{{ at_s = 0, from_deg = 60, speed_mps = 4 }}]\n{more}"
    )
}

#[test]
fn a_silent_arducopter_feeds_every_observer_within_a_minute_and_is_left_as_it_was() {
    // what a ground station had asked for before us
    let mut flight = Flight::new(&hover("[streams]\nATTITUDE = 4\nRAW_IMU = 2\n"), FAST_LINK, 0.0).estimated();
    flight.fly(40.0);
    flight.clear();
    flight.fly(10.0);
    assert!(flight.steps.len() >= 3, "{:?}", flight.steps);
    for (observer, steps) in &flight.steps {
        assert!(*steps >= 450, "{observer} is fed at {} Hz", f64::from(*steps) / 10.0);
    }
    // 4 m/s from 60°: towards 240°
    let truth = 4.0 * Vector3::new(-(60_f64.to_radians().cos()), -(60_f64.to_radians().sin()), 0.0);
    let error = (flight.wind_ned_mps.expect("estimated") - truth).norm();
    assert!(error < 0.35, "the wind is {error:.2} m/s off");
    assert_eq!(flight.console, Vec::<String>::new(), "the autopilot complains");
    assert_eq!(flight.warnings(), Vec::<&Word>::new());
    let decisions = flight.decisions();
    assert!(decisions.iter().all(|d| d.good), "{decisions:#?}");
    assert_eq!(flight.decided("firmware").text, "ArduPilot 4.6.3");
    assert!(flight.decided("model").text.contains("agrees"));

    flight.leave();
    flight.fly(1.0);
    flight.clear();
    flight.fly(10.0);
    // heartbeat, what was there before us, and the autopilot's own question for the time
    flight.heard.remove(&111);
    assert_eq!(flight.heard.keys().copied().collect::<Vec<_>>(), [0, 27, 30], "{:?}", flight.heard);
    assert!((39..=41).contains(&flight.heard[&30]) && (19..=21).contains(&flight.heard[&27]), "{:?}", flight.heard);
    assert_eq!(flight.console, Vec::<String>::new());
}

#[test]
fn after_a_reboot_in_flight_everything_is_asked_again() {
    let mut flight = Flight::new(&hover(""), FAST_LINK, 0.0);
    flight.fly(20.0);
    flight.clear();
    flight.fly(5.0);
    assert!(flight.heard[&105] >= 240);
    flight.run.reboot();
    flight.fly(0.5);
    flight.clear();
    flight.fly(1.0);
    assert!(!flight.heard.contains_key(&105), "it has forgotten: {:?}", flight.heard);
    flight.fly(15.0);
    flight.clear();
    flight.fly(5.0);
    for message in [105, 31, 32, 36] {
        assert!(flight.heard.get(&message).is_some_and(|n| *n >= 240), "{message}: {:?}", flight.heard);
    }
    assert_eq!(flight.decided("parameters").text, "23 of 23 read");
    assert_eq!(flight.warnings(), Vec::<&Word>::new());
}

#[test]
fn a_fifth_lost_both_ways_loses_neither_parameters_nor_streams() {
    let mut flight = Flight::new(&hover(""), FAST_LINK, 0.2);
    flight.fly(60.0);
    assert_eq!(flight.decided("parameters").text, "23 of 23 read");
    assert!(flight.decided("model").text.contains("agrees"));
    flight.clear();
    flight.fly(10.0);
    for message in [31, 32, 36] {
        let came = flight.heard.get(&message).copied().unwrap_or(0);
        // four fifths of 50 Hz, less three deviations
        assert!(came >= 370, "{message} at {} Hz: {:#?}", f64::from(came) / 10.0, flight.decisions());
    }
}

#[test]
fn px4_is_left_as_it_was_too() {
    let text = hover("").replace("arducopter-sitl", "px4-sih").replace("'ardupilot-sitl'", "'px4-sih'");
    let text = text.replacen("duration_s", "autopilot = 'px4'\nduration_s", 1);
    let mut flight = Flight::new(&text, FAST_LINK, 0.0);
    flight.fly(2.0);
    flight.clear();
    flight.dialogue = None;
    flight.fly(10.0);
    let before = std::mem::take(&mut flight.heard);
    let mut flight = Flight::new(&text, FAST_LINK, 0.0);
    flight.fly(30.0);
    assert!(flight.decided("airframe").text.contains("4 rotors"));
    flight.clear();
    flight.fly(10.0);
    assert!(flight.heard[&375] >= 450, "{:?}", flight.heard);
    flight.leave();
    flight.fly(1.0);
    flight.clear();
    flight.fly(10.0);
    assert_eq!(flight.heard.keys().collect::<Vec<_>>(), before.keys().collect::<Vec<_>>());
    for (message, count) in &before {
        assert!(flight.heard[message].abs_diff(*count) <= 2, "{message}: {} for {count}", flight.heard[message]);
    }
}
