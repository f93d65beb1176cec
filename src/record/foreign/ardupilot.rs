//! ArduPilot's dataflash messages as MAVLink.

use super::Row;
use super::said::{Give, Said, ms};
use crate::wire::dialect::ardupilotmega as mav;

/// Events of message EV.
const EV_ARMED: f64 = 10.0;
const EV_DISARMED: f64 = 11.0;
const EV_LANDED: f64 = 18.0;
const EV_NOT_LANDED: f64 = 28.0;
const HEARTBEAT_EVERY_US: u64 = 1_000_000;
const G: f64 = 9.80665;

#[derive(Default)]
pub(super) struct ArduPilot {
    said: Said,
    armed: bool,
    next_heartbeat_us: u64,
    has_quaternion: bool,
}

impl ArduPilot {
    pub fn row(&mut self, row: &Row<'_>, boot_us: u64, give: &mut Give<'_>) {
        let was_armed = self.armed;
        let _ = self.tell(row, boot_us, give);
        if boot_us >= self.next_heartbeat_us || was_armed != self.armed {
            self.next_heartbeat_us = boot_us + HEARTBEAT_EVERY_US;
            let kind = mav::MavType::MAV_TYPE_QUADROTOR;
            self.said.heartbeat(self.armed, kind, mav::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, give);
        }
    }

    /// `None` if a field is missing, as in logs of versions that name it differently.
    fn tell(&mut self, row: &Row<'_>, boot_us: u64, give: &mut Give<'_>) -> Option<()> {
        let n = |name: &str| row.number(name);
        let three = |a: &str, b: &str, c: &str| Some([n(a)?, n(b)?, n(c)?]);
        match (row.name(), row.instance()) {
            ("IMU", 0) => self.said.imu(boot_us, three("AccX", "AccY", "AccZ")?, three("GyrX", "GyrY", "GyrZ")?, give),
            ("IMU2", _) | ("IMU", 1) => {
                self.second_imu(boot_us, three("AccX", "AccY", "AccZ")?, three("GyrX", "GyrY", "GyrZ")?, give);
            }
            ("MAG", 0) => self.said.field(three("MagX", "MagY", "MagZ")?.map(|milligauss| milligauss * 1e-3)),
            ("BARO", 0) => self.said.pressure(n("Press")?),
            ("NKQ1" | "XKQ", 0) => {
                self.has_quaternion = true;
                self.said.attitude(boot_us, [n("Q1")?, n("Q2")?, n("Q3")?, n("Q4")?], give);
            }
            ("ATT", _) if !self.has_quaternion => {
                let [roll, pitch, yaw] = three("Roll", "Pitch", "Yaw")?.map(|degrees| degrees.to_radians() as f32);
                let message = mav::ATTITUDE_DATA { time_boot_ms: ms(boot_us), roll, pitch, yaw, ..Default::default() };
                self.said.give(&message, give);
            }
            ("NKF1" | "XKF1", 0) => {
                self.said.local_position(boot_us, three("PN", "PE", "PD")?, three("VN", "VE", "VD")?, give);
            }
            ("RCOU", _) => self.outputs(row, boot_us, give),
            ("BAT" | "CURR", 0) => self.said.battery(n("Volt")?, give),
            ("EV", _) => match n("Id")? {
                EV_ARMED => self.armed = true,
                EV_DISARMED => self.armed = false,
                EV_LANDED => self.said.landed(true, give),
                EV_NOT_LANDED => self.said.landed(false, give),
                _ => {}
            },
            ("ARM", _) => self.armed = n("ArmState")? != 0.0,
            ("GPS", 0) => {
                let place = [n("Lat")? * 1e-7, n("Lng")? * 1e-7, n("Alt")?];
                // statuses are MAVLink's fix types
                self.said.fix(boot_us, n("Status")? as u8, place, n("Spd")?, n("GCrs")?, give);
            }
            _ => {}
        }
        Some(())
    }

    fn second_imu(&mut self, boot_us: u64, accel_mps2: [f64; 3], rate_rads: [f64; 3], give: &mut Give<'_>) {
        let [xacc, yacc, zacc] = accel_mps2.map(|x| (x / G * 1e3).round() as i16);
        let [xgyro, ygyro, zgyro] = rate_rads.map(|x| (x * 1e3).round() as i16);
        let time_boot_ms = ms(boot_us);
        let message =
            mav::SCALED_IMU2_DATA { time_boot_ms, xacc, yacc, zacc, xgyro, ygyro, zgyro, ..Default::default() };
        self.said.give(&message, give);
    }

    fn outputs(&mut self, row: &Row<'_>, boot_us: u64, give: &mut Give<'_>) {
        const CHANNELS: [&str; 14] =
            ["C1", "C2", "C3", "C4", "C5", "C6", "C7", "C8", "C9", "C10", "C11", "C12", "C13", "C14"];
        let [a, b, c, d, e, f, g, h, i, j, k, l, m, n] =
            CHANNELS.map(|name| row.number(name).map_or(0, |pulse| pulse as u16));
        let message = mav::SERVO_OUTPUT_RAW_DATA {
            // 32 bits that wrap, as on the link
            time_usec: boot_us as u32,
            servo1_raw: a,
            servo2_raw: b,
            servo3_raw: c,
            servo4_raw: d,
            servo5_raw: e,
            servo6_raw: f,
            servo7_raw: g,
            servo8_raw: h,
            servo9_raw: i,
            servo10_raw: j,
            servo11_raw: k,
            servo12_raw: l,
            servo13_raw: m,
            servo14_raw: n,
            ..Default::default()
        };
        self.said.give(&message, give);
    }
}
