//! Which messages carry which channel, by autopilot.

use super::Autopilot;
use crate::signal::Channel;

/// What is wanted: a channel of the observers, or the landed state, which is welcome but never missed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Subject {
    Channel(Channel),
    LandedState,
}

/// A message that can carry a subject, and its MAV_DATA_STREAM (0: none).
#[derive(Debug, Clone, Copy)]
pub(super) struct Carrier {
    pub message_id: u32,
    pub group: u8,
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

const ALL: [Carrier; 17] = [
    SYS_STATUS,
    GPS_RAW_INT,
    SCALED_IMU,
    RAW_IMU,
    SCALED_PRESSURE,
    ATTITUDE,
    ATTITUDE_QUATERNION,
    LOCAL_POSITION_NED,
    GLOBAL_POSITION_INT,
    SERVO_OUTPUT_RAW,
    HIGHRES_IMU,
    BATTERY_STATUS,
    EXTENDED_SYS_STATE,
    ESC_STATUS,
    ODOMETRY,
    ACTUATOR_OUTPUT_STATUS,
    ESC_TELEMETRY_1_TO_4,
];

/// The messages that carry a subject, best first.
pub(super) fn carriers(autopilot: Autopilot, subject: Subject) -> &'static [Carrier] {
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

/// The MAV_DATA_STREAM that a message belongs to.
pub(super) fn group_of(message_id: u32) -> Option<u8> {
    ALL.iter().find(|carrier| carrier.message_id == message_id && carrier.group != 0).map(|carrier| carrier.group)
}
