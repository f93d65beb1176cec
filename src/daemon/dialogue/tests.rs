use super::*;
use crate::daemon::router::LinkId;
use crate::signal::Channel;
use crate::wire::dialect::ardupilotmega::{
    ATTITUDE_DATA, AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MESSAGE_INTERVAL_DATA, MavAutopilot,
    MavParamType, MavResult, PARAM_VALUE_DATA,
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
            dialogue: Dialogue::new(VEHICLE, 191, needs, None, HERE),
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

    /// Commands about streams.
    fn streams(&self) -> Vec<&COMMAND_LONG_DATA> {
        let commands = self.asked.iter().filter_map(|q| if let Question::Command(c) = q { Some(c) } else { None });
        commands.filter(|c| c.command != MavCmd::MAV_CMD_REQUEST_MESSAGE).collect()
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

/// The answer of the vehicle to a command of ours.
fn answered(command: MavCmd, result: MavResult) -> COMMAND_ACK_DATA {
    COMMAND_ACK_DATA { command, result, target_system: 3, target_component: 191, ..COMMAND_ACK_DATA::DEFAULT }
}

#[test]
fn requests_are_addressed_and_answers_to_others_ignored() {
    let (tell, set) = (MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);
    let mut scene = Scene::new();
    scene.flies(3_600, 0);
    let command = scene.streams()[0].clone();
    assert_eq!((command.target_system, command.target_component), (3, 1));
    assert_eq!((command.command, command.param1), (tell, 24.0));
    scene.says(&MESSAGE_INTERVAL_DATA { interval_us: 0, message_id: 24 });
    scene.says(&answered(tell, MavResult::MAV_RESULT_ACCEPTED));
    scene.flies(200, 0);
    let command = scene.streams()[1].clone();
    assert_eq!((command.command, command.param1, command.param2), (set, 24.0, 200_000.0));

    let mut answer = answered(set, MavResult::MAV_RESULT_DENIED);
    (answer.target_system, answer.target_component) = (255, 190);
    scene.says(&answer);
    scene.flies(600, 0);
    assert_eq!(scene.streams().len(), 2, "a ground station was refused, not we: still waiting");
    scene.says(&answered(set, MavResult::MAV_RESULT_DENIED));
    scene.flies(200, 0);
    assert_eq!(scene.streams().len(), 3, "on to the landed state");
}

#[test]
fn what_was_asked_for_is_given_back() {
    let mut scene = Scene::new();
    scene.flies(3_600, 0);
    assert!(!scene.dialogue.owes() && scene.dialogue.farewell().is_empty(), "nothing is changed yet");
    scene.says(&MESSAGE_INTERVAL_DATA { interval_us: 1_000_000, message_id: 24 });
    scene.flies(200, 0);
    // the answer may be lost: what was asked for may run
    assert!(scene.dialogue.owes());
    let farewell = scene.dialogue.farewell();
    let [Question::Command(command)] = &farewell[..] else { panic!("{farewell:?}") };
    assert_eq!((command.param1, command.param2, command.target_system), (24.0, 1_000_000.0, 3));
}

#[test]
fn time_is_asked_and_a_reboot_starts_everything_anew() {
    let mut scene = Scene::new();
    let answer = |scene: &mut Scene, booted_ms: u64| {
        let asked = scene.asked.iter().rev().find_map(|q| if let Question::Time(t) = q { Some(t.ts1) } else { None });
        let tc1 = ((scene.ms - booted_ms) * 1_000_000) as i64;
        scene.says(&TIMESYNC_DATA { tc1, ts1: asked.expect("asked"), ..TIMESYNC_DATA::DEFAULT });
    };
    scene.flies(100, 4_000);
    answer(&mut scene, 4_000);
    let offset = scene.dialogue.clock_offset().expect("answered");
    let error = (offset.ours_minus_theirs_ns - 1_700_000_004_000_000_000).abs();
    assert!(error <= offset.uncertainty_ns && offset.uncertainty_ns < 60_000_000, "{error} of {offset:?}");

    scene.flies(6_000, 4_000);
    let before = scene.streams().len();
    assert!(before > 0);
    let rebooted = scene.ms;
    scene.flies(100, rebooted);
    assert_eq!(scene.dialogue.clock_offset(), None);
    scene.flies(4_000, rebooted);
    assert!(scene.streams().len() > before, "asked again");
}

#[test]
fn ardupilot_is_asked_which_output_drives_which_rotor() {
    let mut scene = Scene::of(MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA);
    scene.says(&AUTOPILOT_VERSION_DATA::DEFAULT);
    for _ in 0..40 {
        scene.flies(100, 0);
        let asked = scene.asked.iter().rev().find_map(|q| if let Question::Parameter(p) = q { Some(p) } else { None });
        let param_id = asked.expect("asked").param_id;
        let param_type = MavParamType::MAV_PARAM_TYPE_INT16;
        scene.says(&PARAM_VALUE_DATA { param_id, param_value: 1.0, param_type, ..PARAM_VALUE_DATA::DEFAULT });
    }
    let asked: Vec<_> = scene
        .asked
        .iter()
        .filter_map(|q| if let Question::Parameter(p) = q { p.param_id.to_str().ok() } else { None })
        .collect();
    assert!(asked.contains(&"SERVO16_FUNCTION") && asked.contains(&"FRAME_CLASS"), "{asked:?}");
    assert!(scene.dialogue.decisions(scene.now()).iter().any(|d| d.text == "23 of 23 read"));
    scene.flies(1_000, 0);
    assert!(!scene.streams().is_empty(), "the answers do not hold up the stream requests");
}

#[test]
fn nothing_is_asked_before_the_autopilot_is_known() {
    let mut dialogue = Dialogue::new(VEHICLE, 191, vec![Need::at_default_rate(Channel::Imu)], None, HERE);
    for steady_ms in (0..20_000).step_by(100) {
        let now = Now { unix_us: steady_ms * 1_000, steady_ms };
        let frame = Encoder::new(3, 1).encode(&ATTITUDE_DATA::DEFAULT);
        dialogue.heard(frame.as_ref(), HERE, now);
        assert_eq!(dialogue.poll(now, &mut |_| {}), [None, None, None]);
    }
}
