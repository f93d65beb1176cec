//! Frames of an ArduPilot copter that hovers in still air, 50 Hz, for tests and benchmarks that need no log.

use mavobserver::wire::dialect::ardupilotmega::{
    ATTITUDE_DATA, GPS_RAW_INT_DATA, GpsFixType, HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA, MavAutopilot, MavModeFlag,
    MavType, RAW_IMU_DATA, SERVO_OUTPUT_RAW_DATA,
};
use mavobserver::wire::{Encoder, FrameBuf};

/// `steps` steps of 20 ms, with their receive times, µs since 1970.
pub fn frames(steps: u32) -> Vec<(u64, FrameBuf)> {
    // 29.42 N on four rotors of 18.86 N: 0.35c + 0.65c² = 0.39 at c = 0.551
    const HOVER_US: u16 = 1591;
    let mut e = Encoder::new(1, 1);
    let mut out = Vec::new();
    for i in 0..steps {
        let ms = 60_000 + 20 * i;
        let received = 1_700_000_000_000_000 + u64::from(ms) * 1_000;
        if i % 50 == 0 {
            let heartbeat = HEARTBEAT_DATA {
                mavtype: MavType::MAV_TYPE_QUADROTOR,
                autopilot: MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
                ..HEARTBEAT_DATA::DEFAULT
            };
            out.push((received, e.encode(&heartbeat)));
        }
        let us = u64::from(ms) * 1_000;
        out.push((received, e.encode(&ATTITUDE_DATA { time_boot_ms: ms, ..Default::default() })));
        let position = LOCAL_POSITION_NED_DATA { time_boot_ms: ms, z: -10.0, ..Default::default() };
        out.push((received, e.encode(&position)));
        let servo = SERVO_OUTPUT_RAW_DATA {
            time_usec: us as u32,
            servo1_raw: HOVER_US,
            servo2_raw: HOVER_US,
            servo3_raw: HOVER_US,
            servo4_raw: HOVER_US,
            ..Default::default()
        };
        out.push((received, e.encode(&servo)));
        if i % 10 == 0 {
            let fix = GPS_RAW_INT_DATA {
                time_usec: us,
                fix_type: GpsFixType::GPS_FIX_TYPE_3D_FIX,
                lat: -353_632_620,
                lon: 1_491_652_370,
                alt: 594_000,
                ..Default::default()
            };
            out.push((received, e.encode(&fix)));
        }
        // the Earth's field at that place, with the nose to the north
        let (xmag, ymag, zmag) = (228, 51, -527);
        let imu = RAW_IMU_DATA { time_usec: us, zacc: -1000, xmag, ymag, zmag, ..Default::default() };
        out.push((received, e.encode(&imu)));
    }
    out
}
