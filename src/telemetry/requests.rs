//! Asks one vehicle for the messages that the observers need, and checks that they come.
//!
//! An autopilot sends little unasked, refuses some messages, grants others and sends nothing, forgets everything at a
//! reboot and slows down when the link is full. So nothing is believed but the measured rate:
//!
//! 1. A channel that already arrives fast enough is left alone.
//! 2. Otherwise its messages are asked for, best first, with MAV_CMD_SET_MESSAGE_INTERVAL. The answer names only the
//!    command, not the message, so one command is open at a time. It is repeated, later each time, when no answer comes.
//! 3. What is refused, or granted and still silent, is asked for as the next best message, at last as a whole group
//!    with REQUEST_DATA_STREAM, which autopilots obey without an answer.
//! 4. What stays unmet is reported once, and asked for again at growing intervals. What stops coming is asked for again.
//!
//! Time is passed in as milliseconds of any steady clock. Nothing is sent from here.

use crate::signal::Channel;
use std::fmt;

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
const GOOD: f64 = 0.8;
const ENOUGH: f64 = 0.5;
const LOST: f64 = 0.4;

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
    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL (511): param1 the message, param2 the interval in µs.
    MessageInterval { message_id: u32, interval_us: f32 },
    /// REQUEST_DATA_STREAM (66): a MAV_DATA_STREAM at a rate in Hz.
    DataStream { stream_id: u8, rate_hz: u16 },
}

/// MAV_CMD_SET_MESSAGE_INTERVAL: the command whose COMMAND_ACK belongs to [`StreamRequester::command_ack`].
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

/// Why a channel does not arrive as wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The autopilot refused every message that carries it.
    Refused,
    /// No command was answered.
    Unanswered,
    /// At least one message was granted, none came.
    Silent,
    /// It was granted and comes, but too slowly: the autopilot, or the link, is at its limit.
    Slow,
}

/// What is reported, once for each change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Notice {
    Unmet { channel: Channel, wanted_hz: f64, measured_hz: f64, cause: Cause },
    Met { channel: Channel, measured_hz: f64 },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Met { channel, measured_hz } => write!(f, "{channel} arrives at {measured_hz:.1} Hz"),
            Self::Unmet { channel, wanted_hz, measured_hz, cause } => {
                write!(f, "{channel} arrives at {measured_hz:.1} Hz, {wanted_hz:.0} Hz are wanted: ")?;
                f.write_str(match cause {
                    Cause::Refused => "the autopilot refused the request",
                    Cause::Unanswered => {
                        "the autopilot does not answer requests (does the link carry both directions?)"
                    }
                    Cause::Silent => "the autopilot granted the request but sends nothing",
                    Cause::Slow => "the autopilot or the link gives no more",
                })
            }
        }
    }
}

/// What is wanted: a channel of the observers, or the landed state, which is welcome but never missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Subject {
    Channel(Channel),
    LandedState,
}

/// A message that can carry a subject, and its MAV_DATA_STREAM (0: none).
#[derive(Debug, Clone, Copy)]
struct Carrier {
    message_id: u32,
    group: u8,
}

const fn carrier(message_id: u32, group: u8) -> Carrier {
    Carrier { message_id, group }
}

const SYS_STATUS: Carrier = carrier(1, 2);
const GPS_RAW_INT: Carrier = carrier(24, 2);
const SCALED_IMU: Carrier = carrier(26, 1);
const RAW_IMU: Carrier = carrier(27, 1);
const SCALED_PRESSURE: Carrier = carrier(29, 1);
const ATTITUDE: Carrier = carrier(30, 10);
const ATTITUDE_QUATERNION: Carrier = carrier(31, 0);
const LOCAL_POSITION_NED: Carrier = carrier(32, 6);
const GLOBAL_POSITION_INT: Carrier = carrier(33, 6);
const SERVO_OUTPUT_RAW: Carrier = carrier(36, 3);
const HIGHRES_IMU: Carrier = carrier(105, 0);
const BATTERY_STATUS: Carrier = carrier(147, 12);
const EXTENDED_SYS_STATE: Carrier = carrier(245, 0);
const ESC_STATUS: Carrier = carrier(291, 0);
const ODOMETRY: Carrier = carrier(331, 0);
const ACTUATOR_OUTPUT_STATUS: Carrier = carrier(375, 0);
const ESC_TELEMETRY_1_TO_4: Carrier = carrier(11030, 12);

/// The messages that carry a subject, best first.
fn carriers(autopilot: Autopilot, subject: Subject) -> &'static [Carrier] {
    let Subject::Channel(channel) = subject else { return &[EXTENDED_SYS_STATE] };
    match (channel, autopilot) {
        (Channel::Imu, Autopilot::Px4) => &[HIGHRES_IMU, SCALED_IMU],
        (Channel::Imu, _) => &[HIGHRES_IMU, RAW_IMU, SCALED_IMU],
        (Channel::Attitude, _) => &[ATTITUDE_QUATERNION, ATTITUDE],
        (Channel::Velocity, Autopilot::Px4) => &[LOCAL_POSITION_NED, ODOMETRY],
        (Channel::Velocity, _) => &[LOCAL_POSITION_NED, GLOBAL_POSITION_INT],
        (Channel::Actuators, Autopilot::Px4) => &[ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW],
        (Channel::Actuators, _) => &[SERVO_OUTPUT_RAW],
        (Channel::Magnetometer, Autopilot::Px4) => &[HIGHRES_IMU],
        (Channel::Magnetometer, _) => &[RAW_IMU],
        (Channel::Gnss, _) => &[GPS_RAW_INT],
        (Channel::Rpm, Autopilot::Px4) => &[ESC_STATUS],
        (Channel::Rpm, _) => &[ESC_TELEMETRY_1_TO_4],
        (Channel::Battery, _) => &[BATTERY_STATUS, SYS_STATUS],
        (Channel::Pressure, Autopilot::Px4) => &[HIGHRES_IMU, SCALED_PRESSURE],
        (Channel::Pressure, _) => &[SCALED_PRESSURE],
    }
}

/// The messages that carry a channel of this autopilot, best first.
pub fn carried_by(autopilot: Autopilot, channel: Channel) -> impl Iterator<Item = u32> {
    carriers(autopilot, Subject::Channel(channel)).iter().map(|carrier| carrier.message_id)
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

/// One message or group that may be asked for.
#[derive(Debug)]
struct Stream {
    request: Target,
    asked: Asked,
    rate: RateMeter,
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

/// Asks one vehicle for message streams. See the [module](self).
#[derive(Debug)]
pub struct StreamRequester {
    streams: Vec<Stream>,
    wants: Vec<Want>,
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
            streams: Vec::new(),
            wants: Vec::new(),
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
            self.streams.push(Stream { request, asked: NOT_ASKED, rate: RateMeter::new(now_ms) });
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

    /// The vehicle answered a SET_MESSAGE_INTERVAL of ours with this MAV_RESULT.
    pub fn command_ack(&mut self, result: u8, now_ms: u64) {
        const ACCEPTED: u8 = 0;
        const TEMPORARILY_REJECTED: u8 = 1;
        const IN_PROGRESS: u8 = 5;
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
        }
    }

    /// The messages whose interval the vehicle granted us: what has to be given back on leaving.
    pub fn granted(&self) -> impl Iterator<Item = u32> + '_ {
        self.streams.iter().filter_map(|s| match (s.request, s.asked) {
            (Target::Message(id), Asked::Granted { .. }) => Some(id),
            _ => None,
        })
    }

    /// The vehicle rebooted and has forgotten what was asked.
    pub fn rebooted(&mut self, now_ms: u64) {
        self.judge_from_ms = now_ms + LOOK_FIRST_MS;
        self.parameter_ms = None;
        for stream in &mut self.streams {
            stream.asked = NOT_ASKED;
            stream.rate = RateMeter::new(now_ms);
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
        let may_send = !open && self.last_command_ms.is_none_or(|last| now_ms.saturating_sub(last) >= COMMAND_GAP_MS);
        let mut request = None;
        for index in 0..self.wants.len() {
            let wish = self.judge(index, now_ms, notice);
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
    fn judge(&mut self, index: usize, now_ms: u64, notice: &mut dyn FnMut(Notice)) -> Option<usize> {
        let measured_hz = self.measured_hz(index, now_ms);
        let want = &mut self.wants[index];
        match want.state {
            WantState::Met { since_ms } => {
                if measured_hz >= LOST * want.rate_hz {
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
                if measured_hz < GOOD * want.rate_hz {
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
        if measured_hz >= GOOD * want.rate_hz {
            self.settle(index, measured_hz, now_ms, notice);
            return None;
        }
        let (mut refused, mut granted) = (false, false);
        for &stream in &self.wants[index].streams {
            match self.streams[stream].asked {
                Asked::No { not_before_ms, .. } => return (now_ms >= not_before_ms).then_some(stream),
                Asked::Open { .. } => return None,
                Asked::Granted { at_ms } if now_ms.saturating_sub(at_ms) < SETTLE_MS => return None,
                Asked::Granted { .. } => {
                    let stream = &mut self.streams[stream];
                    let arrives = match stream.request {
                        Target::Message(_) => {
                            granted = true;
                            stream.rate.hz(now_ms) > 0.0
                        }
                        // a group is obeyed without an answer: what it brings shows in the messages' rates
                        Target::Group(_) => measured_hz > 0.0,
                    };
                    if arrives {
                        break;
                    }
                }
                Asked::Refused => refused = true,
                Asked::Unanswered => {}
            }
        }
        if measured_hz >= ENOUGH * self.wants[index].rate_hz {
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

    fn ask(&mut self, stream: usize, now_ms: u64) -> Request {
        // messages serve several channels: ask at the rate of the most demanding
        let wanting = self.wants.iter().filter(|w| w.streams.contains(&stream));
        let rate_hz = wanting.map(|w| w.rate_hz).fold(1.0, f64::max);
        let stream = &mut self.streams[stream];
        self.last_command_ms = Some(now_ms);
        match stream.request {
            Target::Message(message_id) => {
                let attempts = if let Asked::No { attempts, .. } = stream.asked { attempts } else { 0 };
                stream.asked = Asked::Open { since_ms: now_ms, attempt: attempts + 1 };
                Request::MessageInterval { message_id, interval_us: (1e6 / rate_hz).round() as f32 }
            }
            Target::Group(stream_id) => {
                stream.asked = Asked::Granted { at_ms: now_ms };
                Request::DataStream { stream_id, rate_hz: rate_hz.ceil() as u16 }
            }
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

/// Arrivals per second over the last whole slots.
#[derive(Debug)]
struct RateMeter {
    started_ms: u64,
    /// Slot in which `counts[0]` was counted.
    slot: u64,
    /// Newest first; `[0]` is still filling.
    counts: [u32; Self::SLOTS + 1],
}

impl RateMeter {
    const SLOTS: usize = 10;
    const SLOT_MS: u64 = 500;

    fn new(now_ms: u64) -> Self {
        Self { started_ms: now_ms, slot: now_ms / Self::SLOT_MS, counts: [0; Self::SLOTS + 1] }
    }

    fn advance(&mut self, now_ms: u64) {
        let slot = now_ms / Self::SLOT_MS;
        let length = self.counts.len();
        let moved = usize::try_from(slot.saturating_sub(self.slot)).unwrap_or(length).min(length);
        self.counts.rotate_right(moved % length);
        self.counts[..moved].fill(0);
        self.slot = self.slot.max(slot);
    }

    fn count(&mut self, now_ms: u64) {
        self.advance(now_ms);
        self.counts[0] = self.counts[0].saturating_add(1);
    }

    fn hz(&mut self, now_ms: u64) -> f64 {
        self.advance(now_ms);
        let age_ms = now_ms.saturating_sub(self.started_ms);
        let whole = (self.slot * Self::SLOT_MS).saturating_sub(self.started_ms).min(Self::SLOTS as u64 * Self::SLOT_MS);
        if whole == 0 || age_ms < Self::SLOT_MS {
            return 0.0;
        }
        f64::from(self.counts[1..].iter().sum::<u32>()) * 1e3 / whole as f64
    }
}

#[cfg(test)]
mod tests;
