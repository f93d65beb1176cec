//! What is said to one live vehicle and heard from it: stream requests, time questions, and what it is.

// REQUEST_DATA_STREAM is superseded, and all that some autopilots obey.
#![allow(deprecated)]

use super::pairing::{Ask, Finding, Pairing};
use super::router::Origin;
use super::status::Decision;
use crate::pipeline::VehicleId;
use crate::signal::Stamp;
use crate::telemetry::VehicleClock;
use crate::telemetry::requests::{
    Autopilot, GET_MESSAGE_INTERVAL, Need, Notice, Request, SET_MESSAGE_INTERVAL, StreamRequester,
};
use crate::telemetry::timesync::{ClockOffset, TimesyncClient};
use crate::vehicle::Vehicle;
use crate::wire::dialect::ardupilotmega::{
    COMMAND_LONG_DATA, MavCmd, MavDataStream, PARAM_REQUEST_READ_DATA, REQUEST_DATA_STREAM_DATA, TIMESYNC_DATA,
};
use crate::wire::{Check, FrameRef};
use mavlink_core::types::CharArray;
use num_traits::FromPrimitive;
use std::sync::Arc;

const HEARTBEAT: u32 = 0;
const SYSTEM_TIME: u32 = 2;
const ATTITUDE: u32 = 30;
const ATTITUDE_QUATERNION: u32 = 31;
const LOCAL_POSITION_NED: u32 = 32;
const COMMAND_ACK: u32 = 77;
const TIMESYNC: u32 = 111;
const MESSAGE_INTERVAL: u32 = 244;

/// Time between two looks at what is due, ms.
const POLL_EVERY_MS: u64 = 50;

/// An end where a vehicle was silent for so long no longer leads to it, ms.
const SILENCE_MS: u64 = 3_000;

/// One moment on both clocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Now {
    pub(super) unix_us: u64,
    pub(super) steady_ms: u64,
}

impl Now {
    fn unix_ns(self) -> i64 {
        i64::try_from(self.unix_us).unwrap_or(i64::MAX).saturating_mul(1_000)
    }
}

/// A message for the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Question {
    Command(COMMAND_LONG_DATA),
    Stream(REQUEST_DATA_STREAM_DATA),
    Parameter(PARAM_REQUEST_READ_DATA),
    Time(TIMESYNC_DATA),
}

/// What the operator is told of the conversation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Word {
    Info(String),
    Warning(String),
}

/// The conversation with one vehicle on a live link.
#[derive(Debug)]
pub(super) struct Dialogue {
    vehicle: VehicleId,
    /// Our component id, in the vehicle's system.
    component: u8,
    needs: Vec<Need>,
    /// Where questions go: an end where the vehicle is heard, kept until it is silent there. Each of its ports has
    /// streams of its own.
    pub(super) origin: Origin,
    origin_heard_ms: u64,
    streams: Option<StreamRequester>,
    model: Option<Arc<Vehicle>>,
    pairing: Option<Pairing>,
    time: TimesyncClient,
    /// The vehicle's own question for the time, addressed to us and not answered yet: when it was sent, on its clock.
    asked_us_at_ns: Option<i64>,
    boot: VehicleClock,
    polled_ms: u64,
}

impl Dialogue {
    /// With a vehicle that is estimated with this model.
    pub(super) fn new(
        vehicle: VehicleId,
        component: u8,
        needs: Vec<Need>,
        model: Option<Arc<Vehicle>>,
        origin: Origin,
    ) -> Self {
        Self {
            vehicle,
            component,
            needs,
            origin,
            origin_heard_ms: 0,
            streams: None,
            model,
            pairing: None,
            time: TimesyncClient::new(),
            asked_us_at_ns: None,
            boot: VehicleClock::default(),
            polled_ms: 0,
        }
    }

    /// How the vehicle's clock relates to ours, once it answered.
    pub(super) fn clock_offset(&self) -> Option<ClockOffset> {
        self.time.offset()
    }

    /// Was the vehicle asked for anything that is to be put back?
    pub(super) fn owes(&self) -> bool {
        self.streams.as_ref().is_some_and(|streams| streams.restore().next().is_some())
    }

    /// What is said on leaving: every message that was asked for goes back to the interval that it had.
    pub(super) fn farewell(&self) -> Vec<Question> {
        let restored = self.streams.iter().flat_map(StreamRequester::restore);
        restored.filter_map(|request| self.question(request)).collect()
    }

    /// What was found and decided so far, for the operator.
    pub(super) fn decisions(&mut self, now: Now) -> Vec<Decision> {
        let mut all = Vec::new();
        let mut add = |subject: &str, good: bool, text: String| {
            all.push(Decision { subject: subject.to_owned(), good, text });
        };
        if let Some(pairing) = &self.pairing {
            let (known, wanted) = pairing.progress();
            add("firmware", true, pairing.firmware());
            add("parameters", known > 0 || wanted == 0, format!("{known} of {wanted} read"));
            if let Some(Finding::Read { airframe, .. }) = pairing.finding() {
                let count = airframe.places.len();
                add("airframe", true, format!("{count} rotors: {}", airframe.geometry_origin));
                add("thrust curve", true, airframe.curve_origin.clone());
                add("outputs", true, airframe.mapping_origin.clone());
            }
            for word in pairing.words() {
                match word {
                    Word::Info(text) => add("model", true, text),
                    Word::Warning(text) => add("model", false, text),
                }
            }
        }
        if let Some(offset) = self.time.offset() {
            let (s, ms) = (offset.ours_minus_theirs_ns as f64 * 1e-9, offset.uncertainty_ns as f64 * 1e-6);
            add("clock", true, format!("ours is {s:.3} s ahead, known to {ms:.1} ms"));
        }
        if let Some(streams) = &mut self.streams {
            for d in streams.decisions(now.steady_ms) {
                let subject = d.channel.map_or_else(|| "landed state".to_owned(), |channel| channel.to_string());
                let text = format!("{:.1} Hz of {:.0} Hz: {}", d.measured_hz, d.wanted_hz, d.course);
                add(&subject, d.enough, text);
            }
            let pace = streams.pace();
            let text =
                if pace < 1.0 { format!("carries {:.0} % of it", 100.0 * pace) } else { "carries it all".into() };
            add("link", pace >= 1.0, text);
        }
        all
    }

    fn question(&self, request: Request) -> Option<Question> {
        let (target_system, target_component) = (self.vehicle.system, self.vehicle.component);
        // ids have 24 bits, which f32 holds exactly
        let command = |command, message_id: u32, param2| {
            Question::Command(COMMAND_LONG_DATA {
                param1: message_id as f32,
                param2,
                command,
                target_system,
                target_component,
                ..COMMAND_LONG_DATA::DEFAULT
            })
        };
        Some(match request {
            Request::TellInterval { message_id } => command(MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, message_id, 0.0),
            Request::MessageInterval { message_id, interval_us } => {
                command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, message_id, interval_us)
            }
            Request::DataStream { stream_id, rate_hz } => Question::Stream(REQUEST_DATA_STREAM_DATA {
                req_message_rate: rate_hz,
                target_system,
                target_component,
                req_stream_id: MavDataStream::from_u8(stream_id)?,
                start_stop: u8::from(rate_hz > 0),
            }),
        })
    }

    /// Takes in a frame of the vehicle's autopilot.
    pub(super) fn heard(&mut self, frame: FrameRef<'_>, origin: Origin, now: Now) {
        if origin == self.origin || now.steady_ms.saturating_sub(self.origin_heard_ms) > SILENCE_MS {
            (self.origin, self.origin_heard_ms) = (origin, now.steady_ms);
        }
        if frame.check() != Check::Verified {
            return;
        }
        let fields = frame.fields();
        match frame.message_id() {
            HEARTBEAT if self.streams.is_none() => {
                if let Some(autopilot) = Autopilot::from_mav(fields.u8(5)) {
                    self.streams = Some(StreamRequester::new(autopilot, &self.needs, now.steady_ms));
                    self.pairing = Some(Pairing::new(fields.u8(5), self.model.clone()));
                }
            }
            SYSTEM_TIME => self.boot_time(fields.u32(8), now),
            ATTITUDE | ATTITUDE_QUATERNION | LOCAL_POSITION_NED => self.boot_time(fields.u32(0), now),
            COMMAND_ACK => {
                // before MAVLink 2 an answer named nobody
                let for_us = match (fields.u8(8), fields.u8(9)) {
                    (0, _) => true,
                    (system, component) => system == self.vehicle.system && [0, self.component].contains(&component),
                };
                let command = fields.u16(0);
                if let (GET_MESSAGE_INTERVAL | SET_MESSAGE_INTERVAL, true, Some(streams)) =
                    (command, for_us, &mut self.streams)
                {
                    streams.command_ack(command, fields.u8(2), now.steady_ms);
                }
            }
            MESSAGE_INTERVAL => {
                if let Some(streams) = &mut self.streams {
                    streams.interval_told(fields.u16(4).into(), fields.i32(0));
                }
            }
            // a question to everybody is for others to answer: two answers would confuse an autopilot
            TIMESYNC if fields.i64(0) == 0 => {
                let for_us = (fields.u8(16), fields.u8(17)) == (self.vehicle.system, self.component);
                self.asked_us_at_ns = for_us.then(|| fields.i64(8));
            }
            TIMESYNC => {
                // after a reboot there may be no other stamp until streams are asked for again
                if let Ok(boot_ms) = u32::try_from(fields.i64(0) / 1_000_000) {
                    self.boot_time(boot_ms, now);
                }
                self.time.answer(now.unix_ns(), fields.i64(0), fields.i64(8));
            }
            _ => {
                // what we asked for is no sign of a parameter transfer
                if self.pairing.as_mut().is_some_and(|pairing| pairing.heard(frame)) {
                    return;
                }
            }
        }
        if let Some(streams) = &mut self.streams {
            streams.heard(frame.message_id(), now.steady_ms);
        }
    }

    fn boot_time(&mut self, boot_ms: u32, now: Now) {
        if self.boot.observe(Stamp::from_millis(boot_ms.into()), now.unix_us).is_some() {
            self.time.reset();
            if let Some(streams) = &mut self.streams {
                streams.rebooted(now.steady_ms);
            }
            if let Some(pairing) = &mut self.pairing {
                pairing.restart();
            }
        }
    }

    /// What is to be asked now. To be called after every frame; looks at its clock itself.
    pub(super) fn poll(&mut self, now: Now, say: &mut dyn FnMut(Word)) -> [Option<Question>; 3] {
        if let Some(ts1) = self.asked_us_at_ns.take() {
            let (target_system, target_component) = (self.vehicle.system, self.vehicle.component);
            let told = TIMESYNC_DATA { tc1: now.unix_ns(), ts1, target_system, target_component };
            return [Some(Question::Time(told)), None, None];
        }
        if self.streams.is_none() || now.steady_ms.saturating_sub(self.polled_ms) < POLL_EVERY_MS {
            return [None, None, None];
        }
        self.polled_ms = now.steady_ms;
        let (target_system, target_component) = (self.vehicle.system, self.vehicle.component);
        let notice = &mut |notice: Notice| {
            let text = notice.to_string();
            say(if matches!(notice, Notice::Met { .. }) { Word::Info(text) } else { Word::Warning(text) });
        };
        let request = self.streams.as_mut().and_then(|streams| streams.poll(now.steady_ms, notice));
        let request = request.and_then(|request| self.question(request));
        let nature = self.pairing.as_mut().and_then(|pairing| match pairing.poll(now.steady_ms) {
            (Some(Ask::Version), _) => Some(Question::Command(COMMAND_LONG_DATA {
                param1: 148.0,
                command: MavCmd::MAV_CMD_REQUEST_MESSAGE,
                target_system,
                target_component,
                ..COMMAND_LONG_DATA::DEFAULT
            })),
            (Some(Ask::Parameter(name)), _) => {
                let mut param_id = [0; 16];
                param_id.iter_mut().zip(name.bytes()).for_each(|(to, from)| *to = from);
                Some(Question::Parameter(PARAM_REQUEST_READ_DATA {
                    // by name
                    param_index: -1,
                    target_system,
                    target_component,
                    param_id: CharArray::new(param_id),
                }))
            }
            (None, Some(_)) => {
                pairing.words().into_iter().for_each(&mut *say);
                None
            }
            (None, None) => None,
        });
        let time = self.time.poll(now.unix_ns());
        let time = time.map(|ts1| Question::Time(TIMESYNC_DATA { tc1: 0, ts1, target_system, target_component }));
        [nature, request, time]
    }
}

#[cfg(test)]
mod tests;
