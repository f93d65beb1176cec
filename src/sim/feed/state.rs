use super::Stack;
use super::catalog::{CATALOG, Habit};
use super::params::Params;
use super::schedule::Schedule;
use super::view::{Latest, View};
use super::writer::Writer;
use crate::signal::MAX_ROTORS;
use crate::sim::SimVehicle;
use crate::sim::dynamics::pressure_pa;
use crate::sim::random::{Part, Random};
use crate::sim::scenario::Home;
use crate::sim::sensors::Readings;
use crate::vehicle::{Actuators, Vehicle};
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{FrameBuf, FrameRef};
use std::collections::{BTreeMap, VecDeque};

/// Which MAVLink a link speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MavlinkGeneration {
    V1,
    V2,
}

/// How one vehicle talks.
#[derive(Debug, Clone)]
pub struct FeedConfig {
    pub stack: Stack,
    pub system: u8,
    pub home: Home,
    /// Streams running from the start, Hz by message name, beside those the stack sends unasked.
    pub streams: BTreeMap<String, f64>,
    pub generation: MavlinkGeneration,
    /// Time since boot when the simulation starts, s.
    pub boot_offset_s: f64,
    /// Wall clock when the simulation starts, µs since 1970.
    pub unix_start_us: u64,
    /// Refuses SET_MESSAGE_INTERVAL, as old firmware does: only REQUEST_DATA_STREAM is left.
    pub refuse_intervals: bool,
    pub seed: u64,
}

/// Answers kept until the next loop; more are dropped.
const ANSWERS: usize = 64;
/// PX4 sends these through a slower path: up to so many other frames overtake them.
const OVERTAKEN_BY: usize = 14;

/// Where frames go: wall clock of the instant of sending (µs since 1970), and the frame.
pub type Send<'a> = &'a mut dyn FnMut(u64, FrameRef<'_>);

/// The MAVLink side of one simulated autopilot.
#[derive(Debug)]
pub struct Feed {
    pub(super) config: FeedConfig,
    pub(super) writer: Writer,
    pub(super) schedule: Schedule,
    pub(super) params: Params,
    pub(super) answers: VecDeque<Answer>,
    /// PX4's frames on the slow path, with the number of frames that still overtake each.
    overtaken: VecDeque<(usize, FrameBuf)>,
    actuators: Actuators,
    rotor_of_output: [Option<u8>; 16],
    rotor_count: usize,
    latest: Latest,
    random: Random,
    /// Simulation time at which the autopilot booted, µs; negative when before the start.
    booted_us: i64,
    pub(super) now: Clock,
    next_timesync_us: u64,
    /// What the newest answer to a request for the time repeats of it.
    pub(super) answered_ns: Option<i64>,
    dropped: u64,
}

/// The clocks of one loop.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Clock {
    pub boot_us: u64,
    pub sent_us: u64,
    pub unix_us: u64,
}

/// Something to send besides the streams.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Answer {
    Ready(Box<FrameBuf>),
    /// Goes out by PX4's slow path.
    Slow(Box<FrameBuf>),
    /// One message of the catalogue, once.
    Once(usize),
}

impl Feed {
    /// For a vehicle (as its autopilot knows it) whose sensors have first read `first`.
    pub fn new(config: FeedConfig, vehicle: &Vehicle, first: &Readings) -> Self {
        let mut rotor_of_output = [None; 16];
        for (i, rotor) in vehicle.rotors.iter().enumerate() {
            if let Some(slot) = rotor_of_output.get_mut(rotor.output) {
                *slot = u8::try_from(i).ok();
            }
        }
        let stack = config.stack;
        let unasked = |s: &super::catalog::Stream| match habit(stack, s) {
            Habit::Unasked(hz) => config.streams.get(s.name).copied().unwrap_or(hz),
            Habit::Asked => config.streams.get(s.name).copied().unwrap_or(0.0),
            Habit::Never | Habit::Silent => 0.0,
        };
        Self {
            writer: Writer::new(config.system, config.generation),
            schedule: Schedule::new(unasked),
            params: Params::new(stack, config.system, vehicle),
            answers: VecDeque::with_capacity(ANSWERS),
            overtaken: VecDeque::with_capacity(ANSWERS),
            actuators: vehicle.actuators,
            rotor_of_output,
            rotor_count: vehicle.rotors.len(),
            latest: Latest {
                mag_gauss: first.mag_frd_gauss.unwrap_or_default(),
                pressure_pa: first.pressure_pa.unwrap_or_else(|| pressure_pa(config.home.altitude_m)),
                fix: first.gnss,
                rpm: first.rotor_rpm.unwrap_or([0.0; MAX_ROTORS]),
                charge_as: 0.0,
            },
            random: Random::new(config.seed, config.system, Part::Link),
            booted_us: -((config.boot_offset_s * 1e6) as i64),
            now: Clock::default(),
            next_timesync_us: 0,
            answered_ns: None,
            dropped: 0,
            config,
        }
    }

    /// Answers that did not fit in the queue.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Boot time of the last loop, s.
    pub fn boot_s(&self) -> f64 {
        self.now.boot_us as f64 * 1e-6
    }

    /// Wall clock of the last loop, µs since 1970.
    pub fn unix_us(&self) -> u64 {
        self.now.unix_us
    }

    /// Takes in what the vehicle did in its last loop and sends every frame that is due.
    pub fn after_loop(&mut self, vehicle: &SimVehicle, send: Send<'_>) {
        self.observe(vehicle);
        self.send_answers(vehicle, send);
        self.send_parameter(send);
        self.ask_for_time(send);
        let slowdown = match self.params.in_transfer() {
            true => self.config.stack.slowdown_in_transfer(),
            false => 1,
        };
        for index in 0..CATALOG.len() {
            if self.schedule.due(index, self.now.boot_us, slowdown) {
                self.send_stream(index, vehicle, send);
            }
        }
    }

    fn observe(&mut self, vehicle: &SimVehicle) {
        let moment = vehicle.now();
        let r = &moment.readings;
        let l = &mut self.latest;
        l.mag_gauss = r.mag_frd_gauss.unwrap_or(l.mag_gauss);
        l.pressure_pa = r.pressure_pa.unwrap_or(l.pressure_pa);
        l.rpm = r.rotor_rpm.unwrap_or(l.rpm);
        l.fix = match (&r.gnss, &l.fix) {
            (Some(fix), _) => Some(*fix),
            // a receiver that hears nothing says so after a while
            (None, Some(old)) if moment.truth.stamp - old.stamp > 2.0 => None,
            (None, old) => *old,
        };
        l.charge_as += r.current_a * vehicle.loop_s();
        let since_start_us = moment.truth.stamp.nanos() / 1000;
        let boot_us = (since_start_us - self.booted_us).max(0) as u64;
        // ArduPilot's scheduler gets to the sending a fraction of a millisecond after its loop began
        let sent_us = boot_us + 150 + self.random.below(250) as u64;
        let unix_us = self.config.unix_start_us + since_start_us.max(0) as u64;
        self.now = Clock { boot_us, sent_us, unix_us };
    }

    fn send_stream(&mut self, index: usize, vehicle: &SimVehicle, send: Send<'_>) {
        let Some(stream) = CATALOG.get(index) else { return };
        let view = View {
            stack: self.config.stack,
            moment: vehicle.now(),
            latest: &self.latest,
            home: &self.config.home,
            actuators: &self.actuators,
            rotor_of_output: &self.rotor_of_output,
            rotor_count: self.rotor_count,
            sent_us: self.now.sent_us,
            loop_us: self.now.boot_us,
            unix_us: self.now.unix_us,
            innovations: vehicle.estimator().innovations(),
            resets: vehicle.estimator().reset_count(),
            biases: vehicle.estimator().biases(),
        };
        let Some(frame) = (stream.make)(&view, &mut self.writer) else { return };
        if self.config.stack == Stack::Px4 && stream.name == "MISSION_CURRENT" {
            self.slow(frame);
        } else {
            self.send_frame(&frame, send);
        }
    }

    fn send_answers(&mut self, vehicle: &SimVehicle, send: Send<'_>) {
        while let Some(answer) = self.answers.pop_front() {
            match answer {
                Answer::Ready(frame) => self.send_frame(&frame, send),
                Answer::Slow(frame) => self.slow(*frame),
                Answer::Once(index) => self.send_stream(index, vehicle, send),
            }
        }
    }

    fn send_parameter(&mut self, send: Send<'_>) {
        if let Some(index) = self.params.next(self.now.boot_us)
            && let Some(frame) = self.parameter(index)
        {
            match self.config.stack {
                Stack::ArduPilot => self.send_frame(&frame, send),
                Stack::Px4 => self.slow(frame),
            }
        }
    }

    fn ask_for_time(&mut self, send: Send<'_>) {
        if self.now.boot_us < self.next_timesync_us {
            return;
        }
        self.next_timesync_us = self.now.boot_us + (1e6 / self.config.stack.timesync_hz()) as u64;
        self.probe((0, 0), send);
    }

    /// Asks one station (system, component; 0 for any) for its time. Its answer repeats the number that this gives, and
    /// tells that it has received everything sent before.
    pub fn probe(&mut self, (target_system, target_component): (u8, u8), send: Send<'_>) -> i64 {
        let ts1 = (self.now.sent_us * 1000) as i64;
        if let Some(frame) = self.writer.put(&mav::TIMESYNC_DATA { tc1: 0, ts1, target_system, target_component }) {
            self.send_frame(&frame, send);
        }
        ts1
    }

    /// What the newest answer to a request for the time repeats of it.
    pub fn answered(&self) -> Option<i64> {
        self.answered_ns
    }

    /// Puts a frame on PX4's slow path: its sequence number is already taken.
    fn slow(&mut self, frame: FrameBuf) {
        let by = 1 + self.random.below(OVERTAKEN_BY);
        if self.overtaken.len() < ANSWERS {
            self.overtaken.push_back((by, frame));
        } else {
            self.dropped += 1;
        }
    }

    fn send_frame(&mut self, frame: &FrameBuf, send: Send<'_>) {
        send(self.now.unix_us, frame.as_ref());
        for (left, _) in &mut self.overtaken {
            *left = left.saturating_sub(1);
        }
        while self.overtaken.front().is_some_and(|(left, _)| *left == 0) {
            if let Some((_, late)) = self.overtaken.pop_front() {
                send(self.now.unix_us, late.as_ref());
            }
        }
    }

    pub(super) fn answer(&mut self, answer: Answer) {
        if self.answers.len() < ANSWERS {
            self.answers.push_back(answer);
        } else {
            self.dropped += 1;
        }
    }

    /// Restarts the boot clock and forgets every request, as a reboot does.
    pub fn reboot(&mut self) {
        self.booted_us += self.now.boot_us as i64;
        let (stack, streams) = (self.config.stack, &self.config.streams);
        for (index, stream) in CATALOG.iter().enumerate() {
            let hz = match habit(stack, stream) {
                Habit::Unasked(hz) => streams.get(stream.name).copied().unwrap_or(hz),
                _ => 0.0,
            };
            self.schedule.set_hz(index, hz);
        }
        self.schedule.restart();
        self.answers.clear();
        self.overtaken.clear();
        self.next_timesync_us = 0;
    }

    /// PARAM_VALUE of one parameter.
    pub(super) fn parameter(&mut self, index: usize) -> Option<FrameBuf> {
        use super::params::Kind;
        let param = self.params.get(index)?;
        let message = mav::PARAM_VALUE_DATA {
            param_id: param.name.as_str().into(),
            param_value: self.params.wire_value(param),
            param_type: match param.kind {
                Kind::Int8 => mav::MavParamType::MAV_PARAM_TYPE_INT8,
                Kind::Int16 => mav::MavParamType::MAV_PARAM_TYPE_INT16,
                Kind::Int32 => mav::MavParamType::MAV_PARAM_TYPE_INT32,
                Kind::Real => mav::MavParamType::MAV_PARAM_TYPE_REAL32,
            },
            param_count: self.params.count(),
            param_index: index as u16,
        };
        self.writer.put(&message)
    }
}

/// What a stack does with a stream.
pub(super) fn habit(stack: Stack, stream: &super::catalog::Stream) -> Habit {
    match stack {
        Stack::ArduPilot => stream.ardupilot,
        Stack::Px4 => stream.px4,
    }
}
