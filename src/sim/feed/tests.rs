//! The feed against the recorded habits of the stacks: rates, stamps, quantisation, answers.

use super::*;
use crate::sim::control::Leg;
use crate::sim::scenario::Home;
use crate::sim::{FlightPlan, SimVehicle};
use crate::vehicle::resolve;
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Encoder, FrameBuf, FrameRef, decode};
use mavlink_core::MessageData;
use std::collections::BTreeMap;

struct Station {
    vehicle: SimVehicle,
    feed: Feed,
    encoder: Encoder,
    heard: Vec<FrameBuf>,
}

fn config(stack: Stack) -> FeedConfig {
    FeedConfig {
        stack,
        system: 1,
        home: Home { latitude_deg: -35.363, longitude_deg: 149.165, altitude_m: 584.0, heading_deg: 0.0 },
        streams: BTreeMap::new(),
        generation: MavlinkGeneration::V2,
        boot_offset_s: 0.0,
        unix_start_us: 1_700_000_000_000_000,
        refuse_intervals: false,
        seed: 1,
    }
}

impl Station {
    fn new(config: FeedConfig) -> Self {
        let vehicle = match config.stack {
            Stack::ArduPilot => "arducopter-sitl",
            Stack::Px4 => "px4-sih",
        };
        Self::with(config, vehicle)
    }

    fn with(config: FeedConfig, vehicle: &str) -> Self {
        let vehicle = resolve(vehicle).unwrap();
        let (step_s, steps_per_loop) = config.stack.timing();
        let plan = FlightPlan { step_s, steps_per_loop, ..FlightPlan::calm(vehicle.clone(), 1) };
        let flying = SimVehicle::new(&plan).unwrap();
        Self {
            feed: Feed::new(config, &vehicle, &flying.now().readings),
            vehicle: flying,
            encoder: Encoder::new(255, 190),
            heard: Vec::new(),
        }
    }

    fn run(&mut self, seconds: f64) {
        let end = self.vehicle.now().truth.stamp.secs() + seconds - 1e-6;
        while self.vehicle.now().truth.stamp.secs() < end {
            self.vehicle.advance();
            self.feed.after_loop(&self.vehicle, &mut |_, frame| self.heard.push(frame.into()));
        }
    }

    fn tell<M: MessageData>(&mut self, message: &M) {
        let frame = self.encoder.encode(message);
        self.feed.receive(frame.as_ref(), &mut self.vehicle);
    }

    fn command(&mut self, command: mav::MavCmd, params: [f32; 7]) -> mav::MavResult {
        let [param1, param2, param3, param4, param5, param6, param7] = params;
        self.tell(&mav::COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command,
            target_system: 1,
            target_component: 1,
            confirmation: 0,
        });
        self.heard.clear();
        self.run(0.2);
        self.all::<mav::COMMAND_ACK_DATA>().pop().expect("every known command is acknowledged").result
    }

    fn ask(&mut self, id: u32, hz: f32) -> mav::MavResult {
        let interval = 1e6 / hz;
        self.command(mav::MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [id as f32, interval, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    fn all<M: MessageData>(&self) -> Vec<M> {
        self.heard.iter().filter_map(|f| decode(f.as_ref())).collect()
    }

    fn count(&self, id: u32) -> usize {
        self.heard.iter().filter(|f| f.as_ref().message_id() == id).count()
    }
}

#[test]
fn ardupilot_is_silent_until_asked_and_then_keeps_the_rates() {
    let mut s = Station::new(config(Stack::ArduPilot));
    s.run(10.0);
    let names: std::collections::BTreeSet<_> = s.heard.iter().filter_map(|f| f.as_ref().message_name()).collect();
    assert_eq!(names.into_iter().collect::<Vec<_>>(), ["HEARTBEAT", "TIMESYNC"]);
    assert_eq!(s.ask(27, 50.0), mav::MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(s.ask(24, 5.0), mav::MavResult::MAV_RESULT_ACCEPTED);
    s.heard.clear();
    s.run(10.0);
    assert_eq!((s.count(27), s.count(24), s.count(0)), (500, 50, 10));
}

#[test]
fn px4_talks_unasked_on_its_grid() {
    let mut s = Station::new(config(Stack::Px4));
    s.run(10.0);
    // the rates of PX4's onboard link, met only as well as its 4 ms loop allows
    for (id, hz) in [(30, 100), (31, 50), (105, 50), (32, 30), (36, 10), (24, 8), (0, 1)] {
        let n = s.count(id);
        assert!(n.abs_diff(hz * 10) <= hz, "message {id}: {n} in 10 s, expected {}", hz * 10);
    }
    let stamps: Vec<_> = s.all::<mav::ATTITUDE_DATA>().iter().map(|a| a.time_boot_ms).collect();
    assert!(stamps.iter().all(|t| t % 4 == 0));
    let steps: std::collections::BTreeSet<_> = stamps.windows(2).map(|w| w[1] - w[0]).collect();
    assert_eq!(steps.into_iter().collect::<Vec<_>>(), [8, 12], "100 Hz alternates on a 4 ms grid");
}

#[test]
fn integers_are_cut_off_and_stamps_are_the_sending_instant() {
    let mut c = config(Stack::ArduPilot);
    c.streams = [("RAW_IMU".to_owned(), 50.0), ("SIM_STATE".to_owned(), 50.0)].into();
    let mut s = Station::new(c);
    s.run(2.0);
    let imu = s.all::<mav::RAW_IMU_DATA>();
    // at rest: −1000 mG or a whisker beside it, 585 mG of field
    assert!(imu.iter().all(|m| (m.zacc + 1000).abs() < 30 && m.xacc.abs() < 30));
    let field = imu.iter().map(|m| f64::from(m.xmag).hypot(m.ymag.into()).hypot(m.zmag.into())).sum::<f64>();
    assert!((field / imu.len() as f64 - 585.0).abs() < 3.0);
    assert!(imu.iter().all(|m| (150..400).contains(&(m.time_usec % 2_500))), "a little after the loop");
    assert_eq!(view::cut(-0.9), 0);
    assert_eq!(view::cut(1e9), i16::MAX);
}

#[test]
fn what_a_stack_does_not_know_is_refused_and_silence_is_acknowledged() {
    let mut ardupilot = Station::new(config(Stack::ArduPilot));
    assert_eq!(ardupilot.ask(375, 50.0), mav::MavResult::MAV_RESULT_DENIED);
    assert_eq!(ardupilot.ask(9999, 50.0), mav::MavResult::MAV_RESULT_DENIED);
    let mut px4 = Station::new(config(Stack::Px4));
    assert_eq!(px4.ask(291, 10.0), mav::MavResult::MAV_RESULT_ACCEPTED);
    px4.run(2.0);
    assert_eq!(px4.count(291), 0);
}

#[test]
#[allow(deprecated)] // so is the firmware that needs it
fn old_firmware_refuses_intervals_but_gives_groups() {
    let mut c = config(Stack::ArduPilot);
    c.refuse_intervals = true;
    let mut s = Station::new(c);
    assert_eq!(s.ask(27, 50.0), mav::MavResult::MAV_RESULT_UNSUPPORTED);
    s.tell(&mav::REQUEST_DATA_STREAM_DATA {
        req_message_rate: 10,
        target_system: 1,
        target_component: 1,
        req_stream_id: mav::MavDataStream::MAV_DATA_STREAM_RAW_SENSORS,
        start_stop: 1,
    });
    s.heard.clear();
    s.run(5.0);
    assert_eq!((s.count(27), s.count(116), s.count(30)), (50, 50, 0));
}

#[test]
fn parameters_list_completely_while_ardupilot_slows_down() {
    let mut c = config(Stack::ArduPilot);
    c.streams = [("ATTITUDE".to_owned(), 40.0)].into();
    let mut s = Station::new(c);
    s.tell(&mav::PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 });
    s.run(0.25);
    let during = s.count(30);
    s.run(3.0);
    let values = s.all::<mav::PARAM_VALUE_DATA>();
    assert_eq!(values.len(), usize::from(values[0].param_count));
    assert!(values.iter().enumerate().all(|(i, v)| usize::from(v.param_index) == i));
    assert!((2..=4).contains(&during), "10 Hz for a quarter of a second, not 40: {during}");
    s.heard.clear();
    s.run(1.0);
    assert_eq!(s.count(30), 40);
}

#[test]
fn parameters_are_read_and_set_by_name() {
    let mut s = Station::new(config(Stack::Px4));
    let read = |name: &str| mav::PARAM_REQUEST_READ_DATA {
        param_index: -1,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
    };
    s.tell(&read("CA_ROTOR_COUNT"));
    s.run(1.0);
    let value = s.all::<mav::PARAM_VALUE_DATA>().pop().unwrap();
    assert_eq!(value.param_value.to_bits(), 4, "integers travel as bytes");
    s.tell(&mav::PARAM_SET_DATA {
        param_value: 0.4,
        target_system: 1,
        target_component: 1,
        param_id: "THR_MDL_FAC".into(),
        param_type: mav::MavParamType::MAV_PARAM_TYPE_REAL32,
    });
    s.heard.clear();
    s.run(1.0);
    assert_eq!(s.all::<mav::PARAM_VALUE_DATA>().pop().unwrap().param_value, 0.4);
}

#[test]
fn px4s_slow_path_is_overtaken() {
    let mut s = Station::new(config(Stack::Px4));
    s.ask(375, 100.0);
    let sequences: Vec<u8> = s.heard.iter().map(|f| f.as_ref().sequence()).collect();
    assert!(sequences.windows(2).any(|w| w[1] != w[0].wrapping_add(1)), "an acknowledgement comes late");
    let mut sorted: Vec<u8> = sequences.clone();
    sorted.sort_by_key(|x| x.wrapping_sub(sequences[0].wrapping_sub(60)));
    assert!(sorted.windows(2).all(|w| w[1] == w[0].wrapping_add(1)), "and nothing is lost");
}

#[test]
fn time_is_told_and_asked_for() {
    let mut s = Station::new(config(Stack::ArduPilot));
    s.run(1.0);
    s.heard.clear();
    s.tell(&mav::TIMESYNC_DATA { tc1: 0, ts1: 123_456, target_system: 0, target_component: 0 });
    s.run(0.01);
    let told = s.all::<mav::TIMESYNC_DATA>().into_iter().find(|t| t.tc1 != 0).unwrap();
    assert_eq!((told.ts1, told.target_system), (123_456, 255));
    assert!((told.tc1 - 1_000_000_000).abs() < 5_000_000);
}

#[test]
fn a_ground_station_flies_it() {
    let mut s = Station::new(config(Stack::ArduPilot));
    use mav::MavCmd::*;
    let takeoff = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 8.0];
    assert_eq!(s.command(MAV_CMD_NAV_TAKEOFF, takeoff), mav::MavResult::MAV_RESULT_FAILED, "not armed");
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(s.command(MAV_CMD_COMPONENT_ARM_DISARM, arm), mav::MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(s.command(MAV_CMD_NAV_TAKEOFF, takeoff), mav::MavResult::MAV_RESULT_ACCEPTED);
    s.run(15.0);
    assert!((s.vehicle.now().truth.position_ned_m.z + 8.0).abs() < 0.6);
    assert_eq!(s.command(MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]), mav::MavResult::MAV_RESULT_DENIED, "it flies");
    assert_eq!(s.command(MAV_CMD_NAV_LAND, [0.0; 7]), mav::MavResult::MAV_RESULT_ACCEPTED);
    s.run(30.0);
    assert!(!s.vehicle.now().flight.armed() && s.vehicle.now().truth.on_ground);
}

#[test]
fn a_hexarotor_says_what_it_is_and_fills_six_outputs() {
    for stack in [Stack::ArduPilot, Stack::Px4] {
        let mut c = config(stack);
        c.streams = ["SERVO_OUTPUT_RAW", "ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "ACTUATOR_OUTPUT_STATUS"]
            .map(|name| (name.to_owned(), 10.0))
            .into();
        let mut s = Station::with(c, "arducopter-hexa");
        s.vehicle.arm();
        s.vehicle.pilot().order([Leg::Takeoff { height_m: 10.0 }, Leg::Hover { seconds: 60.0 }]);
        s.run(20.0);
        assert!((s.vehicle.now().truth.position_ned_m.z + 10.0).abs() < 0.5);
        let heartbeat = s.all::<mav::HEARTBEAT_DATA>().pop().unwrap();
        assert_eq!(heartbeat.mavtype, mav::MavType::MAV_TYPE_HEXAROTOR);
        let out = s.all::<mav::SERVO_OUTPUT_RAW_DATA>().pop().unwrap();
        let six = [out.servo1_raw, out.servo2_raw, out.servo3_raw, out.servo4_raw, out.servo5_raw, out.servo6_raw];
        assert!(six.iter().all(|o| (1500..1700).contains(o)), "{six:?}");
        let parameter = |name: &str| s.feed.params.get(s.feed.params.find(name).unwrap()).unwrap().value;
        match stack {
            Stack::ArduPilot => {
                assert_eq!(out.servo7_raw, 0);
                // as recorded from the quad: all frames hover at the same share of full speed
                let rpm = s.all::<mav::ESC_TELEMETRY_5_TO_8_DATA>().pop().unwrap().rpm;
                assert!((6300..6900).contains(&rpm[0]) && (6300..6900).contains(&rpm[1]) && rpm[2] == 0, "{rpm:?}");
                assert_eq!(["FRAME_CLASS", "SERVO6_FUNCTION", "SERVO7_FUNCTION"].map(parameter), [2.0, 38.0, 0.0]);
            }
            Stack::Px4 => {
                assert_eq!(["CA_ROTOR_COUNT", "MAV_TYPE", "PWM_MAIN_FUNC6"].map(parameter), [6.0, 13.0, 106.0]);
                // right, left, front left, rear right, front right, rear left; counter-clockwise is positive
                let place = |axis| [0, 1, 2, 3, 4, 5].map(|i| parameter(&format!("CA_ROTOR{i}_{axis}")).signum());
                assert_eq!(place("PY"), [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]);
                assert_eq!(place("KM"), [-1.0, 1.0, -1.0, 1.0, 1.0, -1.0]);
            }
        }
    }
}

#[test]
fn a_reboot_restarts_the_clock_and_forgets_the_streams() {
    let mut s = Station::new(config(Stack::ArduPilot));
    s.ask(30, 50.0);
    s.run(5.0);
    let before = s.all::<mav::ATTITUDE_DATA>().pop().unwrap().time_boot_ms;
    let reboot = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    // the acknowledgement itself is lost with the reboot's own queue, or comes: either is real
    s.tell(&mav::COMMAND_LONG_DATA {
        param1: reboot[0],
        command: mav::MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    s.heard.clear();
    s.run(2.0);
    assert_eq!(s.count(30), 0);
    s.ask(30, 50.0);
    s.run(1.0);
    assert!(s.all::<mav::ATTITUDE_DATA>()[0].time_boot_ms < before);
}

#[test]
fn the_servo_stamp_wraps() {
    let mut c = config(Stack::ArduPilot);
    c.boot_offset_s = 4_294.0;
    c.streams = [("SERVO_OUTPUT_RAW".to_owned(), 50.0)].into();
    let mut s = Station::new(c);
    s.run(2.0);
    let stamps: Vec<u32> = s.all::<mav::SERVO_OUTPUT_RAW_DATA>().iter().map(|m| m.time_usec).collect();
    assert_eq!(stamps.windows(2).filter(|w| w[1] < w[0]).count(), 1);
}

#[test]
fn outputs_are_pulses_of_the_command_and_rest_when_disarmed() {
    let mut c = config(Stack::ArduPilot);
    c.streams = [("SERVO_OUTPUT_RAW".to_owned(), 50.0)].into();
    let mut s = Station::new(c);
    s.run(0.5);
    let rest = s.all::<mav::SERVO_OUTPUT_RAW_DATA>().pop().unwrap();
    assert_eq!([rest.servo1_raw, rest.servo4_raw, rest.servo5_raw], [1000, 1000, 0]);
    s.vehicle.arm();
    s.vehicle.pilot().order([Leg::Takeoff { height_m: 10.0 }, Leg::Hover { seconds: 60.0 }]);
    s.run(25.0);
    let hover = s.all::<mav::SERVO_OUTPUT_RAW_DATA>().pop().unwrap();
    let mean =
        [hover.servo1_raw, hover.servo2_raw, hover.servo3_raw, hover.servo4_raw].map(f64::from).iter().sum::<f64>()
            / 4.0;
    // 1150 + 800·.551 on a full battery; a little more on one that sags
    assert!((1588.0..1610.0).contains(&mean), "{mean}");
}

#[test]
fn mavlink_1_leaves_out_what_it_cannot_carry() {
    let mut c = config(Stack::Px4);
    c.generation = MavlinkGeneration::V1;
    let mut s = Station::new(c);
    s.run(2.0);
    let versions: Vec<_> = s.heard.iter().map(|f| f.as_ref().version()).collect();
    assert!(versions.iter().all(|v| *v == mavlink_core::MavlinkVersion::V1));
    assert_eq!(s.count(331), 0);
    assert!(s.count(30) > 150);
}

#[test]
fn frames_for_others_are_left_alone() {
    let mut s = Station::new(config(Stack::ArduPilot));
    s.run(0.5);
    s.heard.clear();
    let mut other = Encoder::new(255, 190);
    let list = other.encode(&mav::PARAM_REQUEST_LIST_DATA { target_system: 2, target_component: 1 });
    let frame: FrameRef<'_> = list.as_ref();
    s.feed.receive(frame, &mut s.vehicle);
    s.run(1.0);
    assert_eq!(s.count(22), 0);
}
