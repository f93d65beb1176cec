//! What the simulated autopilot does with frames it receives.

use super::Stack;
use super::catalog::{CATALOG, Habit, find};
use super::state::{Answer, Feed, habit};
use crate::sim::SimVehicle;
use crate::sim::control::{Flight, Leg};
use crate::wire::FrameRef;
use crate::wire::dialect::ardupilotmega as mav;
use nalgebra::Vector3;
use num_traits::FromPrimitive;

type Verdict = mav::MavResult;

/// A command with its parameters, from COMMAND_LONG or COMMAND_INT.
struct Command {
    id: u32,
    params: [f32; 7],
}

impl Feed {
    /// Takes in one frame. Answers go out after the next loop.
    pub fn receive(&mut self, frame: FrameRef<'_>, vehicle: &mut SimVehicle) {
        let for_us = |system: u8| system == 0 || system == self.config.system;
        if frame.target().is_some_and(|(system, component)| !for_us(system) || component > 1) {
            return;
        }
        let f = frame.fields();
        match frame.message_id() {
            // TIMESYNC: a request has tc1 = 0
            111 if f.i64(0) == 0 => self.tell_time(f.i64(8), frame.system_id(), frame.component_id()),
            111 => self.answered_ns = Some(f.i64(8)),
            11 => self.set_mode(f.u32(0), vehicle),
            20 => self.read_parameter(f.i16(0), f.text(4, 16)),
            21 => self.params.begin_list(),
            23 => self.set_parameter(f.f32(0), f.text(6, 16)),
            43 => self.no_mission(frame),
            66 => self.request_data_stream(f.u16(0), f.u8(4), f.u8(5) != 0),
            75 => {
                let params = [f.f32(0), f.f32(4), f.f32(8), f.f32(12), 0.0, 0.0, f.f32(24)];
                self.command(&Command { id: f.u16(28).into(), params }, frame, vehicle);
            }
            76 => {
                let params = std::array::from_fn(|i| f.f32(4 * i));
                self.command(&Command { id: f.u16(28).into(), params }, frame, vehicle);
            }
            _ => {}
        }
    }

    fn command(&mut self, c: &Command, frame: FrameRef<'_>, vehicle: &mut SimVehicle) {
        let verdict = self.obey(c, vehicle);
        // a command that the dialect does not know cannot be named in an acknowledgement
        let Some(command) = mav::MavCmd::from_u32(c.id) else { return };
        let ack = mav::COMMAND_ACK_DATA {
            command,
            result: verdict,
            target_system: frame.system_id(),
            target_component: frame.component_id(),
            ..Default::default()
        };
        if let Some(frame) = self.writer.put(&ack) {
            self.answer(match self.config.stack {
                Stack::ArduPilot => Answer::Ready(Box::new(frame)),
                Stack::Px4 => Answer::Slow(Box::new(frame)),
            });
        }
    }

    fn obey(&mut self, c: &Command, vehicle: &mut SimVehicle) -> Verdict {
        let [p1, p2, .., p7] = c.params;
        match c.id {
            // SET_MESSAGE_INTERVAL: message id, µs
            511 => self.set_message_interval(p1, p2),
            // GET_MESSAGE_INTERVAL
            510 => self.tell_interval(p1),
            // REQUEST_MESSAGE
            512 => self.request_message(p1),
            // REQUEST_AUTOPILOT_CAPABILITIES, the older way
            520 => self.tell_version(),
            400 => self.arm(p1 == 1.0, p2 == 21196.0, vehicle),
            22 => take_off(p7, self.config.stack, vehicle),
            21 => land(vehicle),
            // DO_SET_MODE: custom mode in the second parameter (ArduPilot)
            176 => {
                if self.config.stack == Stack::ArduPilot && p2 == 9.0 {
                    return land(vehicle);
                }
                Verdict::MAV_RESULT_ACCEPTED
            }
            // PREFLIGHT_REBOOT_SHUTDOWN: only on the ground
            246 if p1 == 1.0 => match vehicle.now().flight {
                Flight::Disarmed => {
                    self.reboot();
                    Verdict::MAV_RESULT_ACCEPTED
                }
                _ => Verdict::MAV_RESULT_DENIED,
            },
            // EXTERNAL_WIND_ESTIMATE
            43004 if self.config.stack == Stack::ArduPilot => Verdict::MAV_RESULT_ACCEPTED,
            _ => Verdict::MAV_RESULT_UNSUPPORTED,
        }
    }

    fn set_message_interval(&mut self, id: f32, interval_us: f32) -> Verdict {
        if self.config.refuse_intervals {
            return Verdict::MAV_RESULT_UNSUPPORTED;
        }
        let stack = self.config.stack;
        let known = find(id as u32).and_then(|i| CATALOG.get(i).map(|s| (i, s)));
        let Some((index, stream)) = known.filter(|(_, s)| habit(stack, s) != Habit::Never) else {
            if stack == Stack::ArduPilot {
                self.say(&format!("No ap_message for mavlink id ({id})"));
            }
            return Verdict::MAV_RESULT_DENIED;
        };
        match habit(stack, stream) {
            Habit::Silent => {}
            Habit::Unasked(hz) if interval_us == 0.0 => self.schedule.set_hz(index, hz),
            // ArduPilot's default is that of the message's group; what is in none has no default
            _ if interval_us == 0.0 && stack == Stack::ArduPilot && stream.group.is_none() => {
                return Verdict::MAV_RESULT_FAILED;
            }
            // 0 asks for the default, which is silence; −1 stops
            _ if interval_us <= 0.0 => self.schedule.set_interval_us(index, 0),
            _ => self.schedule.set_interval_us(index, interval_us as u64),
        }
        Verdict::MAV_RESULT_ACCEPTED
    }

    /// ArduPilot tells −1 of what it does not send now and 0 of what it does not have; PX4 tells 0 of both.
    fn tell_interval(&mut self, id: f32) -> Verdict {
        let stack = self.config.stack;
        let known = find(id as u32).filter(|&i| CATALOG.get(i).is_some_and(|s| habit(stack, s) != Habit::Never));
        let interval_us = match known.map(|i| self.schedule.interval_us(i)) {
            None => 0,
            Some(0) if stack == Stack::ArduPilot => -1,
            Some(us) => i32::try_from(us).unwrap_or(i32::MAX),
        };
        let message = mav::MESSAGE_INTERVAL_DATA { message_id: id as u16, interval_us };
        if let Some(frame) = self.writer.put(&message) {
            self.answer(Answer::Ready(Box::new(frame)));
        }
        match (known, stack) {
            (None, Stack::ArduPilot) => Verdict::MAV_RESULT_FAILED,
            _ => Verdict::MAV_RESULT_ACCEPTED,
        }
    }

    /// A line on the ground station's console.
    fn say(&mut self, text: &str) {
        let message = mav::STATUSTEXT_DATA {
            severity: mav::MavSeverity::MAV_SEVERITY_INFO,
            text: text.into(),
            ..Default::default()
        };
        if let Some(frame) = self.writer.put(&message) {
            self.answer(Answer::Ready(Box::new(frame)));
        }
    }

    fn request_message(&mut self, id: f32) -> Verdict {
        if id == 148.0 {
            return self.tell_version();
        }
        match find(id as u32).filter(|i| CATALOG.get(*i).is_some_and(|s| habit(self.config.stack, s) != Habit::Never)) {
            Some(index) => {
                self.answer(Answer::Once(index));
                Verdict::MAV_RESULT_ACCEPTED
            }
            None => Verdict::MAV_RESULT_DENIED,
        }
    }

    fn tell_version(&mut self) -> Verdict {
        use mav::MavProtocolCapability as Can;
        let common = Can::MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
            | Can::MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | Can::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | Can::MAV_PROTOCOL_CAPABILITY_MAVLINK2;
        let (capabilities, version) = match self.config.stack {
            Stack::ArduPilot => (common | Can::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST, 0x0406_03FF),
            Stack::Px4 => (common | Can::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE, 0x0111_00FF),
        };
        let message = mav::AUTOPILOT_VERSION_DATA {
            capabilities,
            flight_sw_version: version,
            uid: u64::from(self.config.system),
            ..Default::default()
        };
        if let Some(frame) = self.writer.put(&message) {
            self.answer(match self.config.stack {
                Stack::ArduPilot => Answer::Ready(Box::new(frame)),
                Stack::Px4 => Answer::Slow(Box::new(frame)),
            });
        }
        Verdict::MAV_RESULT_ACCEPTED
    }

    fn arm(&mut self, arm: bool, force: bool, vehicle: &mut SimVehicle) -> Verdict {
        if arm {
            vehicle.arm();
        } else if vehicle.now().truth.on_ground || force {
            vehicle.pilot().disarm();
        } else {
            return Verdict::MAV_RESULT_DENIED;
        }
        Verdict::MAV_RESULT_ACCEPTED
    }

    fn set_mode(&mut self, custom_mode: u32, vehicle: &mut SimVehicle) {
        let wants_land = match self.config.stack {
            Stack::ArduPilot => custom_mode == 9,
            Stack::Px4 => custom_mode >> 16 == 0x0604,
        };
        if wants_land {
            land(vehicle);
        }
    }

    fn tell_time(&mut self, ts1: i64, system: u8, component: u8) {
        let message = mav::TIMESYNC_DATA {
            tc1: (self.now.sent_us * 1000) as i64,
            ts1,
            target_system: system,
            target_component: component,
        };
        if let Some(frame) = self.writer.put(&message) {
            self.answer(Answer::Ready(Box::new(frame)));
        }
    }

    fn read_parameter(&mut self, index: i16, name: Option<&str>) {
        let found = match usize::try_from(index) {
            Ok(index) => Some(index),
            Err(_) => name.and_then(|n| self.params.find(n)),
        };
        if let Some(frame) = found.and_then(|i| self.parameter(i)) {
            self.answer_parameter(frame);
        }
    }

    fn set_parameter(&mut self, value: f32, name: Option<&str>) {
        let Some(index) = name.and_then(|n| self.params.find(n)) else { return };
        self.params.set(index, value);
        if let Some(frame) = self.parameter(index) {
            self.answer_parameter(frame);
        }
    }

    fn answer_parameter(&mut self, frame: crate::wire::FrameBuf) {
        self.answer(match self.config.stack {
            Stack::ArduPilot => Answer::Ready(Box::new(frame)),
            Stack::Px4 => Answer::Slow(Box::new(frame)),
        });
    }

    fn no_mission(&mut self, frame: FrameRef<'_>) {
        let message = mav::MISSION_COUNT_DATA {
            count: 0,
            target_system: frame.system_id(),
            target_component: frame.component_id(),
            ..Default::default()
        };
        if let Some(frame) = self.writer.put(&message) {
            self.answer(Answer::Ready(Box::new(frame)));
        }
    }

    /// ArduPilot's streams by groups; PX4 does not know this message.
    fn request_data_stream(&mut self, hz: u16, group: u8, start: bool) {
        if self.config.stack == Stack::Px4 {
            return;
        }
        let hz = if start { f64::from(hz.min(50)) } else { 0.0 };
        for (index, stream) in CATALOG.iter().enumerate() {
            if stream.group.is_some_and(|g| group == 0 || group == g) {
                self.schedule.set_hz(index, hz);
            }
        }
    }
}

fn take_off(height_m: f32, stack: Stack, vehicle: &mut SimVehicle) -> Verdict {
    let armed = vehicle.now().flight.armed();
    if !armed && stack == Stack::ArduPilot {
        return Verdict::MAV_RESULT_FAILED;
    }
    if vehicle.now().flight == Flight::Flying || vehicle.now().flight == Flight::Landing {
        return Verdict::MAV_RESULT_TEMPORARILY_REJECTED;
    }
    // PX4 takes NaN for its own default
    let height_m = if height_m.is_finite() && height_m > 0.5 { f64::from(height_m) } else { 2.5 };
    vehicle.pilot().order([Leg::Takeoff { height_m }, Leg::Hover { seconds: f64::INFINITY }]);
    Verdict::MAV_RESULT_ACCEPTED
}

fn land(vehicle: &mut SimVehicle) -> Verdict {
    match vehicle.now().flight {
        Flight::Disarmed => Verdict::MAV_RESULT_DENIED,
        _ => {
            let stop = Leg::Velocity { velocity_ned_mps: Vector3::zeros(), seconds: 1.0 };
            vehicle.pilot().order([stop, Leg::Land]);
            Verdict::MAV_RESULT_ACCEPTED
        }
    }
}
