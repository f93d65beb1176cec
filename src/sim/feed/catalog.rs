//! Every message the simulator streams, in the order it sends them.

use super::messages::{motion, power, raw, status, truth};
use super::view::View;
use super::writer::Writer;
use crate::wire::FrameBuf;

/// Fills and encodes one message; `None` when there is nothing to say (no fix yet, not in this generation).
pub(super) type Make = fn(&View<'_>, &mut Writer) -> Option<FrameBuf>;

/// One message that is sent again and again.
pub(super) struct Stream {
    pub id: u32,
    pub name: &'static str,
    /// ArduPilot's group for REQUEST_DATA_STREAM (MAV_DATA_STREAM); `None` when it has the message only by interval.
    pub group: Option<u8>,
    pub ardupilot: Habit,
    pub px4: Habit,
    pub make: Make,
}

/// What a stack does with a message.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Habit {
    /// Unknown to it: a request is refused.
    Never,
    /// Sent when asked.
    Asked,
    /// Sent at this rate from the start, Hz.
    Unasked(f64),
    /// A request is acknowledged, and nothing comes.
    Silent,
}

use Habit::{Asked, Never, Silent, Unasked};

const RAW_SENSORS: Option<u8> = Some(1);
const STATUS: Option<u8> = Some(2);
const RC: Option<u8> = Some(3);
const POSITION: Option<u8> = Some(6);
const EXTRA1: Option<u8> = Some(10);
const EXTRA2: Option<u8> = Some(11);
const EXTRA3: Option<u8> = Some(12);

macro_rules! streams {
    ($($id:literal $name:ident, $group:expr, $ardupilot:expr, $px4:expr, $make:path;)*) => {
        &[$(Stream { id: $id, name: stringify!($name), group: $group, ardupilot: $ardupilot, px4: $px4, make: $make }),*]
    };
}

/// Recorded rates of PX4's onboard link; ArduPilot sends only the heartbeat unasked.
#[rustfmt::skip]
pub(super) const CATALOG: &[Stream] = streams! {
    0     HEARTBEAT,               None,        Unasked(1.0), Unasked(1.0),   status::heartbeat;
    30    ATTITUDE,                EXTRA1,      Asked,        Unasked(100.0), motion::attitude;
    31    ATTITUDE_QUATERNION,     None,        Asked,        Unasked(50.0),  motion::attitude_quaternion;
    36    SERVO_OUTPUT_RAW,        RC,          Asked,        Unasked(10.0),  power::servo_output_raw;
    375   ACTUATOR_OUTPUT_STATUS,  None,        Never,        Asked,          power::actuator_output_status;
    93    HIL_ACTUATOR_CONTROLS,   None,        Never,        Asked,          power::hil_actuator_controls;
    27    RAW_IMU,                 RAW_SENSORS, Asked,        Never,          raw::raw_imu;
    26    SCALED_IMU,              None,        Never,        Asked,          raw::scaled_imu;
    116   SCALED_IMU2,             RAW_SENSORS, Asked,        Asked,          raw::scaled_imu2;
    105   HIGHRES_IMU,             None,        Asked,        Unasked(50.0),  raw::highres_imu;
    32    LOCAL_POSITION_NED,      POSITION,    Asked,        Unasked(30.0),  motion::local_position_ned;
    33    GLOBAL_POSITION_INT,     POSITION,    Asked,        Unasked(50.0),  motion::global_position_int;
    331   ODOMETRY,                None,        Never,        Unasked(30.0),  motion::odometry;
    83    ATTITUDE_TARGET,         None,        Asked,        Unasked(10.0),  motion::attitude_target;
    74    VFR_HUD,                 EXTRA2,      Asked,        Unasked(10.0),  motion::vfr_hud;
    141   ALTITUDE,                None,        Never,        Unasked(10.0),  motion::altitude;
    29    SCALED_PRESSURE,         RAW_SENSORS, Asked,        Unasked(1.0),   raw::scaled_pressure;
    24    GPS_RAW_INT,             STATUS,      Asked,        Unasked(8.0),   raw::gps_raw_int;
    11030 ESC_TELEMETRY_1_TO_4,    EXTRA3,      Asked,        Never,          power::esc_telemetry_1_to_4;
    11031 ESC_TELEMETRY_5_TO_8,    EXTRA3,      Asked,        Never,          power::esc_telemetry_5_to_8;
    226   RPM,                     EXTRA3,      Asked,        Never,          power::rpm;
    291   ESC_STATUS,              None,        Never,        Silent,         status::nothing;
    147   BATTERY_STATUS,          EXTRA3,      Asked,        Unasked(0.5),   power::battery_status;
    1     SYS_STATUS,              STATUS,      Asked,        Unasked(5.0),   status::sys_status;
    2     SYSTEM_TIME,             EXTRA3,      Asked,        Unasked(1.0),   status::system_time;
    245   EXTENDED_SYS_STATE,      None,        Asked,        Unasked(5.0),   status::extended_sys_state;
    193   EKF_STATUS_REPORT,       EXTRA3,      Asked,        Never,          status::ekf_status_report;
    230   ESTIMATOR_STATUS,        None,        Never,        Unasked(1.0),   status::estimator_status;
    241   VIBRATION,               EXTRA3,      Asked,        Unasked(0.5),   status::vibration;
    242   HOME_POSITION,           None,        Asked,        Unasked(0.5),   motion::home_position;
    42    MISSION_CURRENT,         STATUS,      Asked,        Unasked(1.0),   status::mission_current;
    168   WIND,                    EXTRA3,      Asked,        Never,          status::wind;
    231   WIND_COV,                None,        Never,        Silent,         status::nothing;
    164   SIMSTATE,                EXTRA3,      Asked,        Never,          truth::simstate;
    108   SIM_STATE,               None,        Asked,        Never,          truth::sim_state;
    115   HIL_STATE_QUATERNION,    None,        Never,        Asked,          truth::hil_state_quaternion;
};

/// Names of the messages the simulator can stream, of both stacks.
pub fn names() -> impl Iterator<Item = &'static str> {
    CATALOG.iter().map(|s| s.name)
}

/// True for the name of a message the simulator can stream.
pub fn can_send(name: &str) -> bool {
    CATALOG.iter().any(|s| s.name == name)
}

/// Place in the catalogue of a message.
pub(super) fn find(id: u32) -> Option<usize> {
    CATALOG.iter().position(|s| s.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::message_info;

    #[test]
    fn names_and_ids_are_mavlinks() {
        for s in CATALOG {
            assert_eq!(message_info(s.id).map(|i| i.name), Some(s.name));
        }
        assert_eq!(CATALOG[0].id, 0, "the heartbeat comes first: the schedule never slows it down");
    }
}
