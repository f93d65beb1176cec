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
mod judge;
mod need;
mod notice;
mod pace;
mod rate;
mod stream;
mod want;

pub use carriers::carried_by;
pub use decision::Decision;
pub use need::{Autopilot, Need, Request};
pub use notice::{Cause, Notice};

use carriers::{Subject, carriers};
use pace::Pace;
use rate::RateMeter;
use stream::{Asked, Before, Stream, Target};
use want::{Want, WantState};

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
/// First wait before an unmet channel is asked for again.
const FIRST_REST_MS: u64 = 10_000;
/// MAV_CMD_GET_MESSAGE_INTERVAL and MAV_CMD_SET_MESSAGE_INTERVAL: the commands whose COMMAND_ACK belongs to
/// [`StreamRequester::command_ack`].
pub const GET_MESSAGE_INTERVAL: u16 = 510;
pub const SET_MESSAGE_INTERVAL: u16 = 511;
const PARAM_VALUE: u32 = 22;

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
}

#[cfg(test)]
mod tests;
