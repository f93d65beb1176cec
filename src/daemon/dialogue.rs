//! What is said to one live vehicle and heard from it: stream requests, time questions, and which output drives which
//! rotor.

// REQUEST_DATA_STREAM is superseded, and all that some autopilots obey.
#![allow(deprecated)]

use super::router::Origin;
use crate::pipeline::VehicleId;
use crate::signal::Stamp;
use crate::telemetry::VehicleClock;
use crate::telemetry::parameters::{ParameterReader, ROTOR_OUTPUTS};
use crate::telemetry::requests::{Autopilot, Need, Notice, Request, SET_MESSAGE_INTERVAL, StreamRequester};
use crate::telemetry::timesync::{ClockOffset, TimesyncClient};
use crate::wire::dialect::ardupilotmega::{
    COMMAND_LONG_DATA, MavCmd, MavDataStream, PARAM_REQUEST_READ_DATA, REQUEST_DATA_STREAM_DATA, TIMESYNC_DATA,
};
use crate::wire::{Check, FrameRef};
use mavlink_core::types::CharArray;
use num_traits::FromPrimitive;

const HEARTBEAT: u32 = 0;
const SYSTEM_TIME: u32 = 2;
const PARAM_VALUE: u32 = 22;
const ATTITUDE: u32 = 30;
const COMMAND_ACK: u32 = 77;
const TIMESYNC: u32 = 111;

/// Time between two looks at what is due, ms.
const POLL_EVERY_MS: u64 = 50;

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

/// The conversation with one vehicle on a live link.
#[derive(Debug)]
pub(super) struct Dialogue {
    vehicle: VehicleId,
    /// Our component id, in the vehicle's system.
    component: u8,
    needs: Vec<Need>,
    /// Where the vehicle was last heard, and where questions go.
    pub(super) origin: Origin,
    streams: Option<StreamRequester>,
    /// ArduPilot only: PX4's output messages are in rotor order.
    parameters: Option<ParameterReader>,
    time: TimesyncClient,
    /// The vehicle's own question for the time, addressed to us and not answered yet: when it was sent, on its clock.
    asked_us_at_ns: Option<i64>,
    boot: VehicleClock,
    polled_ms: u64,
}

impl Dialogue {
    pub(super) fn new(vehicle: VehicleId, component: u8, needs: Vec<Need>, origin: Origin) -> Self {
        Self {
            vehicle,
            component,
            needs,
            origin,
            streams: None,
            parameters: None,
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

    /// Has the vehicle granted anything that is to be given back?
    pub(super) fn owes(&self) -> bool {
        self.streams.as_ref().is_some_and(|streams| streams.granted().next().is_some())
    }

    /// What is said on leaving: every message that was asked for goes back to its default interval.
    pub(super) fn farewell(&self) -> Vec<Question> {
        let granted = self.streams.iter().flat_map(StreamRequester::granted);
        granted.map(|message_id| self.interval(message_id, 0.0)).collect()
    }

    fn interval(&self, message_id: u32, interval_us: f32) -> Question {
        Question::Command(COMMAND_LONG_DATA {
            // ids have 24 bits, which f32 holds exactly
            param1: message_id as f32,
            param2: interval_us,
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            target_system: self.vehicle.system,
            target_component: self.vehicle.component,
            ..COMMAND_LONG_DATA::DEFAULT
        })
    }

    /// Takes in a frame of the vehicle's autopilot.
    pub(super) fn heard(&mut self, frame: FrameRef<'_>, origin: Origin, now: Now) {
        self.origin = origin;
        if frame.check() != Check::Verified {
            return;
        }
        let fields = frame.fields();
        match frame.message_id() {
            HEARTBEAT if self.streams.is_none() => {
                if let Some(autopilot) = Autopilot::from_mav(fields.u8(5)) {
                    self.streams = Some(StreamRequester::new(autopilot, &self.needs, now.steady_ms));
                    let mapped = autopilot == Autopilot::ArduPilot;
                    self.parameters = mapped.then(|| ParameterReader::new(&ROTOR_OUTPUTS));
                }
            }
            SYSTEM_TIME => self.boot_time(fields.u32(8), now),
            ATTITUDE => self.boot_time(fields.u32(0), now),
            COMMAND_ACK => {
                // before MAVLink 2 an answer named nobody
                let for_us = match (fields.u8(8), fields.u8(9)) {
                    (0, _) => true,
                    (system, component) => system == self.vehicle.system && [0, self.component].contains(&component),
                };
                if let (SET_MESSAGE_INTERVAL, true, Some(streams)) = (fields.u16(0), for_us, &mut self.streams) {
                    streams.command_ack(fields.u8(2), now.steady_ms);
                }
            }
            PARAM_VALUE => {
                // what we asked for is no sign of a parameter transfer
                let name = fields.text(8, 16).unwrap_or_default();
                if self.parameters.as_mut().is_some_and(|parameters| parameters.heard(name)) {
                    return;
                }
            }
            // a question to everybody is for others to answer: two answers would confuse an autopilot
            TIMESYNC if fields.i64(0) == 0 => {
                let for_us = (fields.u8(16), fields.u8(17)) == (self.vehicle.system, self.component);
                self.asked_us_at_ns = for_us.then(|| fields.i64(8));
            }
            TIMESYNC => {
                self.time.answer(now.unix_ns(), fields.i64(0), fields.i64(8));
            }
            _ => {}
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
            if let Some(parameters) = &mut self.parameters {
                *parameters = ParameterReader::new(&ROTOR_OUTPUTS);
            }
        }
    }

    /// What is to be asked now. To be called after every frame; looks at its clock itself.
    pub(super) fn poll(&mut self, now: Now, notice: &mut dyn FnMut(Notice)) -> [Option<Question>; 3] {
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
        let request = self.streams.as_mut().and_then(|streams| streams.poll(now.steady_ms, notice));
        let request = request.and_then(|request| match request {
            Request::MessageInterval { message_id, interval_us } => Some(self.interval(message_id, interval_us)),
            Request::DataStream { stream_id, rate_hz } => MavDataStream::from_u8(stream_id).map(|req_stream_id| {
                Question::Stream(REQUEST_DATA_STREAM_DATA {
                    req_message_rate: rate_hz,
                    target_system,
                    target_component,
                    req_stream_id,
                    start_stop: 1,
                })
            }),
        });
        let parameter = self.parameters.as_mut().and_then(|parameters| parameters.poll(now.steady_ms)).map(|name| {
            let mut param_id = [0; 16];
            param_id.iter_mut().zip(name.bytes()).for_each(|(to, from)| *to = from);
            Question::Parameter(PARAM_REQUEST_READ_DATA {
                // by name
                param_index: -1,
                target_system,
                target_component,
                param_id: CharArray::new(param_id),
            })
        });
        let time = self.time.poll(now.unix_ns());
        let time = time.map(|ts1| Question::Time(TIMESYNC_DATA { tc1: 0, ts1, target_system, target_component }));
        [parameter, request, time]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::daemon::router::LinkId;
    use crate::signal::Channel;
    use crate::wire::dialect::ardupilotmega::{
        ATTITUDE_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavResult, PARAM_VALUE_DATA,
    };
    use crate::wire::{Encoder, FrameBuf};
    use mavlink_core::MessageData;

    const VEHICLE: VehicleId = VehicleId { system: 3, component: 1 };
    const HERE: Origin = Origin { link: LinkId(0), peer: None };

    struct Scene {
        dialogue: Dialogue,
        vehicle: Encoder,
        ms: u64,
        asked: Vec<Question>,
    }

    impl Scene {
        fn new() -> Self {
            Self::of(MavAutopilot::MAV_AUTOPILOT_PX4)
        }

        fn of(autopilot: MavAutopilot) -> Self {
            let needs = vec![Need::at_default_rate(Channel::Gnss)];
            let mut scene = Self {
                dialogue: Dialogue::new(VEHICLE, 191, needs, HERE),
                vehicle: Encoder::new(3, 1),
                ms: 10_000,
                asked: Vec::new(),
            };
            scene.says(&HEARTBEAT_DATA { autopilot, ..HEARTBEAT_DATA::DEFAULT });
            scene
        }

        fn now(&self) -> Now {
            Now { unix_us: 1_700_000_000_000_000 + self.ms * 1_000, steady_ms: self.ms }
        }

        fn says<M: MessageData>(&mut self, message: &M) {
            let frame: FrameBuf = self.vehicle.encode(message);
            let now = self.now();
            self.dialogue.heard(frame.as_ref(), HERE, now);
            let questions = self.dialogue.poll(now, &mut |_| {});
            self.asked.extend(questions.into_iter().flatten());
        }

        /// Attitude at 10 Hz from a vehicle that booted at `booted_ms`, for so long.
        fn flies(&mut self, ms: u64, booted_ms: u64) {
            for _ in 0..ms / 100 {
                self.ms += 100;
                let time_boot_ms = (self.ms - booted_ms) as u32;
                self.says(&ATTITUDE_DATA { time_boot_ms, ..ATTITUDE_DATA::DEFAULT });
            }
        }

        fn commands(&self) -> Vec<&COMMAND_LONG_DATA> {
            self.asked.iter().filter_map(|q| if let Question::Command(c) = q { Some(c) } else { None }).collect()
        }
    }

    #[test]
    fn a_question_for_our_time_is_answered_at_once_and_those_for_others_are_not() {
        let mut scene = Scene::new();
        let ask = |target_system, target_component| TIMESYNC_DATA { tc1: 0, ts1: 77, target_system, target_component };
        scene.asked.clear();
        scene.says(&ask(0, 0));
        scene.says(&ask(3, 190));
        assert_eq!(scene.asked, []);
        scene.says(&ask(3, 191));
        let told = TIMESYNC_DATA { tc1: scene.now().unix_ns(), ts1: 77, target_system: 3, target_component: 1 };
        assert_eq!(scene.asked, [Question::Time(told)]);
    }

    #[test]
    fn requests_are_addressed_and_answers_to_others_ignored() {
        let mut scene = Scene::new();
        scene.flies(3_600, 0);
        let command = scene.commands()[0].clone();
        assert_eq!((command.target_system, command.target_component), (3, 1));
        assert_eq!((command.param1, command.param2), (24.0, 200_000.0));

        let mut answer = COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            result: MavResult::MAV_RESULT_DENIED,
            target_system: 255,
            target_component: 190,
            ..COMMAND_ACK_DATA::DEFAULT
        };
        scene.says(&answer);
        scene.flies(600, 0);
        assert_eq!(scene.commands().len(), 1, "a ground station was refused, not we: still waiting");
        (answer.target_system, answer.target_component) = (3, 191);
        scene.says(&answer);
        scene.flies(200, 0);
        assert_eq!(scene.commands().len(), 2, "on to the landed state");
    }

    #[test]
    fn what_was_granted_is_given_back() {
        let mut scene = Scene::new();
        scene.flies(3_600, 0);
        assert!(!scene.dialogue.owes() && scene.dialogue.farewell().is_empty(), "asked is not yet granted");
        scene.says(&COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            result: MavResult::MAV_RESULT_ACCEPTED,
            target_system: 3,
            target_component: 191,
            ..COMMAND_ACK_DATA::DEFAULT
        });
        assert!(scene.dialogue.owes());
        let farewell = scene.dialogue.farewell();
        let [Question::Command(command)] = &farewell[..] else { panic!("{farewell:?}") };
        assert_eq!((command.param1, command.param2, command.target_system), (24.0, 0.0, 3));
    }

    #[test]
    fn time_is_asked_and_a_reboot_starts_everything_anew() {
        let mut scene = Scene::new();
        let answer = |scene: &mut Scene, booted_ms: u64| {
            let asked =
                scene.asked.iter().rev().find_map(|q| if let Question::Time(t) = q { Some(t.ts1) } else { None });
            let tc1 = ((scene.ms - booted_ms) * 1_000_000) as i64;
            scene.says(&TIMESYNC_DATA { tc1, ts1: asked.expect("asked"), ..TIMESYNC_DATA::DEFAULT });
        };
        scene.flies(100, 4_000);
        answer(&mut scene, 4_000);
        let offset = scene.dialogue.clock_offset().expect("answered");
        let error = (offset.ours_minus_theirs_ns - 1_700_000_004_000_000_000).abs();
        assert!(error <= offset.uncertainty_ns && offset.uncertainty_ns < 60_000_000, "{error} of {offset:?}");

        scene.flies(6_000, 4_000);
        let before = scene.commands().len();
        assert!(before > 0);
        let rebooted = scene.ms;
        scene.flies(100, rebooted);
        assert_eq!(scene.dialogue.clock_offset(), None);
        scene.flies(4_000, rebooted);
        assert!(scene.commands().len() > before, "asked again");
    }

    #[test]
    fn ardupilot_is_asked_which_output_drives_which_rotor() {
        let mut scene = Scene::of(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
        for _ in 0..30 {
            scene.flies(100, 0);
            let asked =
                scene.asked.iter().rev().find_map(|q| if let Question::Parameter(p) = q { Some(p) } else { None });
            let param_id = asked.expect("asked").param_id;
            scene.says(&PARAM_VALUE_DATA { param_id, param_value: 33.0, ..PARAM_VALUE_DATA::DEFAULT });
        }
        let asked: Vec<_> = scene
            .asked
            .iter()
            .filter_map(|q| if let Question::Parameter(p) = q { p.param_id.to_str().ok() } else { None })
            .collect();
        assert_eq!(asked, ROTOR_OUTPUTS);
        scene.flies(1_000, 0);
        assert!(!scene.commands().is_empty(), "the answers do not hold up the stream requests");
    }

    #[test]
    fn nothing_is_asked_before_the_autopilot_is_known() {
        let mut dialogue = Dialogue::new(VEHICLE, 191, vec![Need::at_default_rate(Channel::Imu)], HERE);
        for steady_ms in (0..20_000).step_by(100) {
            let now = Now { unix_us: steady_ms * 1_000, steady_ms };
            let frame = Encoder::new(3, 1).encode(&ATTITUDE_DATA::DEFAULT);
            dialogue.heard(frame.as_ref(), HERE, now);
            assert_eq!(dialogue.poll(now, &mut |_| {}), [None, None, None]);
        }
    }
}
