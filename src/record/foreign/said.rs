//! What both autopilots' logs are told as.

use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Encoder, FrameRef};
use mavlink_core::MessageData;

/// HIGHRES_IMU's flags for what is new in it.
const INERTIAL: u16 = 0x3F;
const FIELD: u16 = 0x1C0;
const PRESSURE: u16 = 0x200;

/// MAV_MODE_FLAG_SAFETY_ARMED.
const ARMED: u8 = 128;
const US_PER_MS: u64 = 1_000;

/// The vehicle that speaks, and the sensors that go into one message with the next inertial sample.
pub(super) struct Said {
    encoder: Encoder,
    field_gauss: Option<[f32; 3]>,
    pressure_hpa: Option<f32>,
}

impl Default for Said {
    fn default() -> Self {
        Self { encoder: Encoder::new(1, 1), field_gauss: None, pressure_hpa: None }
    }
}

pub(super) type Give<'a> = dyn FnMut(FrameRef<'_>) + 'a;

impl Said {
    pub fn give(&mut self, message: &impl MessageData, give: &mut Give<'_>) {
        give(self.encoder.encode(message).as_ref());
    }

    pub fn field(&mut self, gauss: [f64; 3]) {
        self.field_gauss = Some(gauss.map(|x| x as f32));
    }

    pub fn pressure(&mut self, pa: f64) {
        self.pressure_hpa = Some((pa * 0.01) as f32);
    }

    pub fn imu(&mut self, boot_us: u64, accel_mps2: [f64; 3], rate_rads: [f64; 3], give: &mut Give<'_>) {
        let [xacc, yacc, zacc] = accel_mps2.map(|x| x as f32);
        let [xgyro, ygyro, zgyro] = rate_rads.map(|x| x as f32);
        let (field, pressure) = (self.field_gauss.take(), self.pressure_hpa.take());
        let [xmag, ymag, zmag] = field.unwrap_or_default();
        let updated = INERTIAL | field.map_or(0, |_| FIELD) | pressure.map_or(0, |_| PRESSURE);
        let message = mav::HIGHRES_IMU_DATA {
            time_usec: boot_us,
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            xmag,
            ymag,
            zmag,
            abs_pressure: pressure.unwrap_or(0.0),
            fields_updated: mav::HighresImuUpdatedFlags::from_bits_retain(updated),
            ..Default::default()
        };
        self.give(&message, give);
    }

    pub fn heartbeat(&mut self, armed: bool, kind: mav::MavType, autopilot: mav::MavAutopilot, give: &mut Give<'_>) {
        let base_mode = mav::MavModeFlag::from_bits_retain(if armed { ARMED } else { 0 });
        self.give(&mav::HEARTBEAT_DATA { mavtype: kind, autopilot, base_mode, ..Default::default() }, give);
    }

    pub fn landed(&mut self, landed: bool, give: &mut Give<'_>) {
        use mav::MavLandedState::{MAV_LANDED_STATE_IN_AIR, MAV_LANDED_STATE_ON_GROUND};
        let landed_state = if landed { MAV_LANDED_STATE_ON_GROUND } else { MAV_LANDED_STATE_IN_AIR };
        self.give(&mav::EXTENDED_SYS_STATE_DATA { landed_state, ..Default::default() }, give);
    }

    pub fn attitude(&mut self, boot_us: u64, q: [f64; 4], give: &mut Give<'_>) {
        let [q1, q2, q3, q4] = q.map(|x| x as f32);
        let message = mav::ATTITUDE_QUATERNION_DATA { time_boot_ms: ms(boot_us), q1, q2, q3, q4, ..Default::default() };
        self.give(&message, give);
    }

    pub fn local_position(&mut self, boot_us: u64, position: [f64; 3], velocity: [f64; 3], give: &mut Give<'_>) {
        let [x, y, z] = position.map(|x| x as f32);
        let [vx, vy, vz] = velocity.map(|x| x as f32);
        self.give(&mav::LOCAL_POSITION_NED_DATA { time_boot_ms: ms(boot_us), x, y, z, vx, vy, vz }, give);
    }

    pub fn battery(&mut self, volt: f64, give: &mut Give<'_>) {
        let mut voltages = [u16::MAX; 10];
        voltages[0] = (volt * 1e3) as u16;
        self.give(&mav::BATTERY_STATUS_DATA { voltages, ..Default::default() }, give);
    }

    /// Position in degrees and metres, speed over ground in m/s, course in degrees.
    pub fn fix(&mut self, boot_us: u64, fix_type: u8, place: [f64; 3], speed: f64, course: f64, give: &mut Give<'_>) {
        let [latitude, longitude, altitude] = place;
        let fix_type = match fix_type {
            0 | 1 => mav::GpsFixType::GPS_FIX_TYPE_NO_FIX,
            2 => mav::GpsFixType::GPS_FIX_TYPE_2D_FIX,
            3 => mav::GpsFixType::GPS_FIX_TYPE_3D_FIX,
            4 => mav::GpsFixType::GPS_FIX_TYPE_DGPS,
            5 => mav::GpsFixType::GPS_FIX_TYPE_RTK_FLOAT,
            _ => mav::GpsFixType::GPS_FIX_TYPE_RTK_FIXED,
        };
        let message = mav::GPS_RAW_INT_DATA {
            time_usec: boot_us,
            fix_type,
            lat: (latitude * 1e7).round() as i32,
            lon: (longitude * 1e7).round() as i32,
            alt: (altitude * 1e3) as i32,
            eph: u16::MAX,
            epv: u16::MAX,
            vel: (speed * 1e2) as u16,
            cog: (course.rem_euclid(360.0) * 1e2) as u16,
            satellites_visible: u8::MAX,
            ..Default::default()
        };
        self.give(&message, give);
    }
}

/// MAVLink's boot time wraps after 49 days, as here.
pub(super) fn ms(boot_us: u64) -> u32 {
    (boot_us / US_PER_MS) as u32
}
