//! Asks one vehicle for the messages that the observers need, and checks that they come.
//!
//! An autopilot sends little unasked, refuses some messages, grants others and sends nothing, forgets everything at a
//! reboot and slows down when the link is full. So nothing is believed but the measured rate:
//!
//! 1. A channel that already arrives fast enough is left alone.
//! 2. Otherwise its messages are asked for, best first. Before the first request for a message its interval is asked
//!    for with MAV_CMD_GET_MESSAGE_INTERVAL, so that it can be [given back](StreamRequester::restore) on leaving, and so
//!    that ArduPilot is never asked for what it does not have: it answers such a request on its console. Then comes
//!    MAV_CMD_SET_MESSAGE_INTERVAL. The answers name only the command, not the message, so one command is open at a time.
//!    It is repeated, later each time, when no answer comes.
//! 3. What is refused, or granted and still silent, is asked for as the next best message, at last as a whole group
//!    with REQUEST_DATA_STREAM, which autopilots obey without an answer.
//! 4. What stays unmet is reported once, and asked for again at growing intervals. What stops coming is asked for again.
//! 5. Where several granted messages come slower than asked, the link is full: all fast ones are asked for at the rate
//!    that it carries (see `pace`), and faster again from time to time.
//!
//! Time is passed in as milliseconds of any steady clock. Nothing is sent from here.

mod carriers;
mod decision;
mod notice;
mod pace;
mod rate;

pub use carriers::carried_by;
pub use decision::Decision;
pub use notice::{Cause, Notice};

use crate::signal::Channel;
use carriers::{Subject, carriers};
use pace::Pace;
use rate::RateMeter;

/// Nothing is judged in this first time, so that running streams are seen before any is asked for.
const LOOK_FIRST_MS: u64 = 3_500;
/// Between two commands to one vehicle.
const COMMAND_GAP_MS: u64 = 100;
/// How long an answer may take at first; doubled for each repetition.
const ANSWER_MS: u64 = 1_000;
const ATTEMPTS: u32 = 3;
/// From a granted request until its rate is judged.
const SETTLE_MS: u64 = 5_500;
/// The vehicle counts as absent after this silence: nothing is asked and nothing judged.
const ABSENT_MS: u64 = 3_000;
/// A parameter transfer slows the streams of ArduPilot down; it is over when this long no parameter came.
const PARAMETER_QUIET_MS: u64 = 2_000;
/// First and longest wait before an unmet channel is asked for again.
const FIRST_REST_MS: u64 = 10_000;
const LONGEST_REST_MS: u64 = 300_000;
/// A channel that was met for this long starts over with short rests.
const FORGIVEN_MS: u64 = 60_000;
/// Parts of the wanted rate: below `GOOD` ask; below `ENOUGH` after asking report; below `LOST` later, ask again.
const GOOD: f64 = 0.9;
const ENOUGH: f64 = 0.5;
const LOST: f64 = 0.4;
/// A frame more or less within the time over which rates are measured, Hz.
const FRAME_HZ: f64 = 0.25;

/// HEARTBEAT's `autopilot` field, as far as it changes what is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autopilot {
    ArduPilot,
    Px4,
    Other,
}

impl Autopilot {
    /// From the value of MAV_AUTOPILOT; `None` for MAV_AUTOPILOT_INVALID, which is no autopilot.
    pub fn from_mav(autopilot: u8) -> Option<Self> {
        match autopilot {
            3 => Some(Self::ArduPilot),
            8 => None,
            12 => Some(Self::Px4),
            _ => Some(Self::Other),
        }
    }
}

/// One thing to ask a vehicle for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// COMMAND_LONG with MAV_CMD_GET_MESSAGE_INTERVAL (510): param1 the message.
    TellInterval { message_id: u32 },
    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL (511): param1 the message, param2 the interval in µs.
    MessageInterval { message_id: u32, interval_us: f32 },
    /// REQUEST_DATA_STREAM (66): a MAV_DATA_STREAM at a rate in Hz.
    DataStream { stream_id: u8, rate_hz: u16 },
}

/// MAV_CMD_GET_MESSAGE_INTERVAL and MAV_CMD_SET_MESSAGE_INTERVAL: the commands whose COMMAND_ACK belongs to
/// [`StreamRequester::command_ack`].
pub const GET_MESSAGE_INTERVAL: u16 = 510;
pub const SET_MESSAGE_INTERVAL: u16 = 511;
const PARAM_VALUE: u32 = 22;

/// A channel and the rate at which the observers want it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Need {
    pub channel: Channel,
    pub rate_hz: f64,
    /// The estimates are better with it and can be had without: its absence is not reported.
    pub optional: bool,
}

impl Need {
    /// Usual rate of the channels that move an observer's state.
    pub const FAST_HZ: f64 = 50.0;

    /// The rate that serves the observers without filling a telemetry radio.
    pub fn at_default_rate(channel: Channel) -> Self {
        let rate_hz = match channel {
            Channel::Imu | Channel::Attitude | Channel::Velocity | Channel::Actuators => Self::FAST_HZ,
            Channel::Magnetometer | Channel::Rpm => 10.0,
            Channel::Gnss | Channel::Pressure => 5.0,
            Channel::Battery => 1.0,
        };
        Self { channel, rate_hz, optional: false }
    }

    /// The same channel, welcome but not needed.
    pub fn optional(self) -> Self {
        Self { optional: true, ..self }
    }
}

/// What became of the last request for a message or group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    /// Not yet, or not since it was given up; `attempts` went without an answer.
    No {
        attempts: u32,
        not_before_ms: u64,
    },
    /// The one open command.
    Open {
        since_ms: u64,
        attempt: u32,
    },
    Granted {
        at_ms: u64,
    },
    Refused,
    Unanswered,
}

const NOT_ASKED: Asked = Asked::No { attempts: 0, not_before_ms: 0 };

/// What is known of a message's interval before the first request of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Before {
    NotAsked,
    /// The one open command.
    Open {
        since_ms: u64,
    },
    /// The vehicle does not say; whether the message came all the same.
    Untold {
        came: bool,
    },
    /// In the words of MESSAGE_INTERVAL.
    Told {
        interval_us: i32,
    },
}

/// One message or group that may be asked for.
#[derive(Debug)]
struct Stream {
    request: Target,
    asked: Asked,
    before: Before,
    /// The rate of the last request that the vehicle may have obeyed, Hz; 0 where there is none.
    asked_hz: f64,
    /// It is to be asked for once more, at another pace.
    again: bool,
    rate: RateMeter,
}

impl Stream {
    fn new(request: Target, now_ms: u64) -> Self {
        let (asked, before, rate) = (NOT_ASKED, Before::NotAsked, RateMeter::new(now_ms));
        Self { request, asked, before, asked_hz: 0.0, again: false, rate }
    }

    /// Is it a message that was granted, as far as we know?
    fn runs(&self) -> bool {
        matches!((self.request, self.asked), (Target::Message(_), Asked::Granted { .. } | Asked::Unanswered))
    }

    /// Was it asked for so lately that its rate says nothing yet?
    fn unsettled(&self, now_ms: u64) -> bool {
        match self.asked {
            Asked::Open { .. } => true,
            Asked::Granted { at_ms } => self.again || now_ms.saturating_sub(at_ms) < SETTLE_MS,
            _ => matches!(self.before, Before::Open { .. }),
        }
    }

    /// The vehicle does not say at which interval it sends this.
    fn untold(&mut self, now_ms: u64) {
        if let Before::Open { .. } = self.before {
            self.before = Before::Untold { came: self.rate.hz(now_ms) > 0.0 };
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Target {
    Message(u32),
    Group(u8),
}

#[derive(Debug)]
struct Want {
    subject: Subject,
    rate_hz: f64,
    /// Nobody is told when it is missing.
    optional: bool,
    /// Indices into `streams`: messages, then groups.
    streams: Vec<usize>,
    state: WantState,
    reported: bool,
    rest_ms: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum WantState {
    Asking,
    /// Arrives well enough since then.
    Met {
        since_ms: u64,
    },
    /// Given up until then.
    Resting {
        until_ms: u64,
    },
}

fn is_good(measured_hz: f64, wanted_hz: f64) -> bool {
    measured_hz + FRAME_HZ >= GOOD * wanted_hz
}

/// Asks one vehicle for message streams. See the [module](self).
#[derive(Debug)]
pub struct StreamRequester {
    autopilot: Autopilot,
    streams: Vec<Stream>,
    wants: Vec<Want>,
    pace: Pace,
    judge_from_ms: u64,
    heard_ms: u64,
    parameter_ms: Option<u64>,
    last_command_ms: Option<u64>,
}

impl StreamRequester {
    /// A requester for a vehicle first heard at `now_ms`. Needs for the same channel count as the fastest and
    /// most urgent of them.
    pub fn new(autopilot: Autopilot, needs: &[Need], now_ms: u64) -> Self {
        let mut requester = Self {
            autopilot,
            streams: Vec::new(),
            wants: Vec::new(),
            pace: Pace::default(),
            judge_from_ms: now_ms + LOOK_FIRST_MS,
            heard_ms: now_ms,
            parameter_ms: None,
            last_command_ms: None,
        };
        for need in needs.iter().filter(|n| n.rate_hz.is_finite() && n.rate_hz > 0.0) {
            requester.want(autopilot, Subject::Channel(need.channel), need.rate_hz, need.optional, now_ms);
        }
        if !requester.wants.is_empty() {
            requester.want(autopilot, Subject::LandedState, 1.0, true, now_ms);
        }
        // the fastest first: what they get often serves the slower ones too
        requester.wants.sort_by(|a, b| b.rate_hz.total_cmp(&a.rate_hz));
        requester
    }

    fn want(&mut self, autopilot: Autopilot, subject: Subject, rate_hz: f64, optional: bool, now_ms: u64) {
        if let Some(known) = self.wants.iter_mut().find(|w| w.subject == subject) {
            known.rate_hz = known.rate_hz.max(rate_hz);
            known.optional &= optional;
            return;
        }
        let carriers = carriers(autopilot, subject);
        let mut targets: Vec<Target> = carriers.iter().map(|c| Target::Message(c.message_id)).collect();
        if autopilot != Autopilot::Px4 {
            for group in carriers.iter().map(|c| c.group).filter(|&g| g != 0) {
                if !targets.contains(&Target::Group(group)) {
                    targets.push(Target::Group(group));
                }
            }
        }
        let streams = targets.into_iter().map(|target| self.stream(target, now_ms)).collect();
        let state = WantState::Asking;
        self.wants.push(Want { subject, rate_hz, optional, streams, state, reported: false, rest_ms: FIRST_REST_MS });
    }

    fn stream(&mut self, request: Target, now_ms: u64) -> usize {
        self.streams.iter().position(|s| s.request == request).unwrap_or_else(|| {
            self.streams.push(Stream::new(request, now_ms));
            self.streams.len() - 1
        })
    }

    /// A message of the vehicle's autopilot arrived.
    pub fn heard(&mut self, message_id: u32, now_ms: u64) {
        if now_ms.saturating_sub(self.heard_ms) > ABSENT_MS {
            // back after a silence: measure afresh before judging
            self.judge_from_ms = now_ms + LOOK_FIRST_MS;
            self.streams.iter_mut().for_each(|s| s.rate = RateMeter::new(now_ms));
        }
        self.heard_ms = now_ms;
        if message_id == PARAM_VALUE {
            self.parameter_ms = Some(now_ms);
        }
        for stream in &mut self.streams {
            if stream.request == Target::Message(message_id) {
                stream.rate.count(now_ms);
            }
        }
    }

    /// The vehicle answered a command of ours, [`GET_MESSAGE_INTERVAL`] or [`SET_MESSAGE_INTERVAL`], with this MAV_RESULT.
    pub fn command_ack(&mut self, command: u16, result: u8, now_ms: u64) {
        const ACCEPTED: u8 = 0;
        const TEMPORARILY_REJECTED: u8 = 1;
        const IN_PROGRESS: u8 = 5;
        if command == GET_MESSAGE_INTERVAL {
            // granted, it is told in a message of its own
            if result != ACCEPTED {
                self.streams.iter_mut().for_each(|stream| stream.untold(now_ms));
            }
            return;
        }
        for stream in &mut self.streams {
            let Asked::Open { attempt, .. } = stream.asked else { continue };
            stream.asked = match result {
                ACCEPTED => Asked::Granted { at_ms: now_ms },
                IN_PROGRESS => Asked::Open { since_ms: now_ms, attempt },
                TEMPORARILY_REJECTED if attempt < ATTEMPTS => {
                    Asked::No { attempts: attempt, not_before_ms: now_ms + ANSWER_MS * u64::from(attempt) }
                }
                _ => Asked::Refused,
            };
            if stream.asked == Asked::Refused {
                stream.asked_hz = 0.0;
            }
        }
    }

    /// MESSAGE_INTERVAL: the vehicle tells at which interval it sends a message; −1 is not at all, 0 that it has none.
    pub fn interval_told(&mut self, message_id: u32, interval_us: i32) {
        // PX4 tells 0 of every message that it does not send now
        let has_none = interval_us == 0 && self.autopilot == Autopilot::ArduPilot;
        for stream in &mut self.streams {
            if stream.request == Target::Message(message_id) && matches!(stream.before, Before::Open { .. }) {
                stream.before = Before::Told { interval_us };
                if has_none {
                    stream.asked = Asked::Refused;
                }
            }
        }
    }

    /// What puts everything back that was asked for, to be sent on leaving.
    ///
    /// What the vehicle told of a message's interval comes back; where it told nothing, the default, or silence where
    /// the message was silent before.
    pub fn restore(&self) -> impl Iterator<Item = Request> + '_ {
        const STOP: f32 = -1.0;
        const DEFAULT: f32 = 0.0;
        self.streams.iter().filter(|s| s.asked_hz > 0.0).map(|stream| {
            let px4 = self.autopilot == Autopilot::Px4;
            match stream.request {
                Target::Message(message_id) => {
                    let interval_us = match stream.before {
                        Before::Told { interval_us } if interval_us > 0 => interval_us as f32,
                        // PX4's −1 is a message sent at every update, which its commands cannot say
                        Before::Told { interval_us } if px4 && interval_us < 0 => DEFAULT,
                        Before::Told { .. } | Before::Untold { came: false } => STOP,
                        Before::Untold { came: true } | Before::NotAsked | Before::Open { .. } => DEFAULT,
                    };
                    Request::MessageInterval { message_id, interval_us }
                }
                Target::Group(stream_id) => {
                    let rate_hz = match stream.before {
                        Before::Told { interval_us } if interval_us > 0 => (1e6 / f64::from(interval_us)).round(),
                        _ => 0.0,
                    };
                    Request::DataStream { stream_id, rate_hz: rate_hz as u16 }
                }
            }
        })
    }

    /// The vehicle rebooted and has forgotten what was asked.
    pub fn rebooted(&mut self, now_ms: u64) {
        self.judge_from_ms = now_ms + LOOK_FIRST_MS;
        self.parameter_ms = None;
        self.pace = Pace::default();
        for stream in &mut self.streams {
            let request = stream.request;
            *stream = Stream::new(request, now_ms);
        }
        for want in &mut self.wants {
            want.state = WantState::Asking;
            want.rest_ms = FIRST_REST_MS;
        }
    }

    /// What is to be sent at `now_ms`, if anything; at most one request per call. Changes are told to `notice`.
    pub fn poll(&mut self, now_ms: u64, notice: &mut dyn FnMut(Notice)) -> Option<Request> {
        let absent = now_ms.saturating_sub(self.heard_ms) > ABSENT_MS;
        let parameters = self.parameter_ms.is_some_and(|at| now_ms.saturating_sub(at) < PARAMETER_QUIET_MS);
        if absent || parameters {
            // rates say nothing about what was granted now
            self.judge_from_ms = self.judge_from_ms.max(now_ms + LOOK_FIRST_MS);
            return None;
        }
        if now_ms < self.judge_from_ms {
            return None;
        }
        let open = self.expire_open(now_ms);
        self.keep_pace(now_ms, notice);
        let may_send = !open && self.last_command_ms.is_none_or(|last| now_ms.saturating_sub(last) >= COMMAND_GAP_MS);
        let mut request = None;
        if may_send && let Some(stream) = self.streams.iter().position(|stream| stream.again) {
            request = Some(self.ask(stream, now_ms));
        }
        let unsettled = self.streams.iter().any(|s| s.unsettled(now_ms));
        for index in 0..self.wants.len() {
            let wish = self.judge(index, unsettled, now_ms, notice);
            if let (Some(stream), true, None) = (wish, may_send, request) {
                request = Some(self.ask(stream, now_ms));
            }
        }
        request
    }

    /// True while a command waits for its answer; an overdue one is scheduled again or given up.
    fn expire_open(&mut self, now_ms: u64) -> bool {
        let mut open = false;
        for stream in &mut self.streams {
            if let Before::Open { since_ms } = stream.before {
                if now_ms.saturating_sub(since_ms) < ANSWER_MS {
                    open = true;
                } else {
                    stream.untold(now_ms);
                }
            }
            if let Asked::Open { since_ms, attempt } = stream.asked {
                let patience = ANSWER_MS << (attempt - 1).min(8);
                if now_ms.saturating_sub(since_ms) < patience {
                    open = true;
                } else if attempt < ATTEMPTS {
                    stream.asked = Asked::No { attempts: attempt, not_before_ms: now_ms };
                } else {
                    stream.asked = Asked::Unanswered;
                }
            }
        }
        open
    }

    /// Moves one want on; returns the stream that it would like to ask for now.
    fn judge(&mut self, index: usize, unsettled: bool, now_ms: u64, notice: &mut dyn FnMut(Notice)) -> Option<usize> {
        let measured_hz = self.measured_hz(index, now_ms);
        let want = &mut self.wants[index];
        let wanted_hz = self.pace.of(want.rate_hz);
        match want.state {
            WantState::Met { since_ms } => {
                if measured_hz >= LOST * wanted_hz {
                    if now_ms.saturating_sub(since_ms) > FORGIVEN_MS {
                        want.rest_ms = FIRST_REST_MS;
                    }
                    return None;
                }
                // it stopped: ask again, but not more often than an unmet want may
                let rest = if now_ms.saturating_sub(since_ms) > FORGIVEN_MS { 0 } else { want.rest_ms };
                want.state = WantState::Resting { until_ms: now_ms + rest };
                return None;
            }
            WantState::Resting { until_ms } => {
                if !is_good(measured_hz, wanted_hz) {
                    if now_ms >= until_ms {
                        want.rest_ms = (want.rest_ms * 2).min(LONGEST_REST_MS);
                        want.state = WantState::Asking;
                        for &stream in &want.streams {
                            if !matches!(self.streams[stream].asked, Asked::Open { .. }) {
                                self.streams[stream].asked = NOT_ASKED;
                            }
                        }
                    }
                    return None;
                }
            }
            WantState::Asking => {}
        }
        if is_good(measured_hz, wanted_hz) {
            self.settle(index, measured_hz, now_ms, notice);
            return None;
        }
        let (mut refused, mut granted) = (false, false);
        for &stream in &self.wants[index].streams {
            let comes = self.streams[stream].rate.hz(now_ms) > 0.0;
            match self.streams[stream].asked {
                Asked::No { not_before_ms, .. } => return (now_ms >= not_before_ms).then_some(stream),
                Asked::Open { .. } => return None,
                Asked::Granted { at_ms } if now_ms.saturating_sub(at_ms) < SETTLE_MS => return None,
                // the answer was lost, and it was granted
                Asked::Unanswered if comes => {
                    granted = true;
                    if unsettled {
                        return None;
                    }
                    break;
                }
                Asked::Granted { .. } => {
                    let stream = &mut self.streams[stream];
                    let arrives = match stream.request {
                        Target::Message(_) => {
                            granted = true;
                            comes
                        }
                        // a group is obeyed without an answer: what it brings shows in the messages' rates
                        Target::Group(_) => measured_hz > 0.0,
                    };
                    if arrives && unsettled {
                        // several slow ones together are the link's doing: see `keep_pace`
                        return None;
                    }
                    if arrives {
                        break;
                    }
                }
                Asked::Refused => refused = true,
                Asked::Unanswered => {}
            }
        }
        if measured_hz >= ENOUGH * wanted_hz {
            self.settle(index, measured_hz, now_ms, notice);
            return None;
        }
        let cause = match (granted, refused) {
            (true, _) if measured_hz > 0.0 => Cause::Slow,
            (true, _) => Cause::Silent,
            (false, true) => Cause::Refused,
            (false, false) => Cause::Unanswered,
        };
        let want = &mut self.wants[index];
        want.state = WantState::Resting { until_ms: now_ms + want.rest_ms };
        if let (Subject::Channel(channel), false, false) = (want.subject, want.reported, want.optional) {
            want.reported = true;
            notice(Notice::Unmet { channel, wanted_hz: want.rate_hz, measured_hz, cause });
        }
        None
    }

    fn settle(&mut self, index: usize, measured_hz: f64, now_ms: u64, notice: &mut dyn FnMut(Notice)) {
        let want = &mut self.wants[index];
        want.state = WantState::Met { since_ms: now_ms };
        if let (Subject::Channel(channel), true) = (want.subject, want.reported) {
            want.reported = false;
            notice(Notice::Met { channel, measured_hz });
        }
    }

    fn ask(&mut self, index: usize, now_ms: u64) -> Request {
        // messages serve several channels: ask at the rate of the most demanding
        let wanting = self.wants.iter().filter(|w| w.streams.contains(&index));
        let rate_hz = self.pace.of(wanting.map(|w| w.rate_hz).fold(1.0, f64::max));
        self.last_command_ms = Some(now_ms);
        let stream = &mut self.streams[index];
        match stream.request {
            // the question for the interval has room for 16 bits
            Target::Message(message_id) if stream.before == Before::NotAsked && message_id <= u16::MAX.into() => {
                stream.before = Before::Open { since_ms: now_ms };
                Request::TellInterval { message_id }
            }
            Target::Message(message_id) => {
                let attempts = if let Asked::No { attempts, .. } = stream.asked { attempts } else { 0 };
                stream.asked = Asked::Open { since_ms: now_ms, attempt: attempts + 1 };
                (stream.asked_hz, stream.again) = (rate_hz, false);
                Request::MessageInterval { message_id, interval_us: (1e6 / rate_hz).round() as f32 }
            }
            Target::Group(stream_id) => {
                if stream.before == Before::NotAsked {
                    let came_hz = self.group_hz(stream_id, now_ms);
                    let interval_us = if came_hz > 0.0 { (1e6 / came_hz) as i32 } else { -1 };
                    self.streams[index].before = Before::Told { interval_us };
                }
                let stream = &mut self.streams[index];
                stream.asked = Asked::Granted { at_ms: now_ms };
                (stream.asked_hz, stream.again) = (rate_hz, false);
                Request::DataStream { stream_id, rate_hz: rate_hz.ceil() as u16 }
            }
        }
    }

    /// The rate of the fastest message of a group that is looked at, Hz.
    fn group_hz(&mut self, group: u8, now_ms: u64) -> f64 {
        let members = self.streams.iter_mut().filter(|s| match s.request {
            Target::Message(id) => carriers::group_of(id) == Some(group),
            Target::Group(_) => false,
        });
        members.map(|s| s.rate.hz(now_ms)).fold(0.0, f64::max)
    }

    /// Slows all fast messages down to what the link carries, and tries more of it later.
    fn keep_pace(&mut self, now_ms: u64, notice: &mut dyn FnMut(Notice)) {
        if self.streams.iter().any(|s| s.unsettled(now_ms)) {
            return;
        }
        let mut observed = pace::Observed::default();
        for stream in &mut self.streams {
            if stream.runs() {
                if stream.rate.hz(now_ms) > 0.0 && pace::is_fast(stream.asked_hz) && !stream.rate.flows(now_ms) {
                    // it stopped, as all do at a reboot: that says nothing of what the link carries
                    return;
                }
                observed.add(stream.asked_hz, stream.rate.hz(now_ms));
            }
        }
        let before = self.pace.factor();
        if !self.pace.adapt(&observed, now_ms) {
            return;
        }
        for stream in &mut self.streams {
            stream.again = stream.runs() && pace::is_fast(stream.asked_hz);
        }
        if self.pace.factor() < before {
            let fastest_hz = self.wants.iter().map(|w| w.rate_hz).fold(0.0, f64::max);
            let asked_hz = self.pace.of(fastest_hz);
            notice(Notice::Slowed { wanted_hz: fastest_hz, asked_hz });
        }
    }

    /// The rate of the fastest message that carries the want, Hz.
    fn measured_hz(&mut self, index: usize, now_ms: u64) -> f64 {
        let mut fastest: f64 = 0.0;
        for &stream in &self.wants[index].streams {
            fastest = fastest.max(self.streams[stream].rate.hz(now_ms));
        }
        fastest
    }
}

#[cfg(test)]
mod tests;
