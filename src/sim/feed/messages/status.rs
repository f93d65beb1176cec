//! How the autopilot is.

use crate::sim::control::Flight;
use crate::sim::feed::Stack;
use crate::sim::feed::view::View;
use crate::sim::feed::writer::Writer;
use crate::wire::FrameBuf;
use crate::wire::dialect::ardupilotmega as mav;

type Out = Option<FrameBuf>;

/// Acknowledged by the autopilot, never sent.
pub(in crate::sim::feed) fn nothing(_: &View<'_>, _: &mut Writer) -> Out {
    None
}

pub(in crate::sim::feed) fn heartbeat(v: &View<'_>, w: &mut Writer) -> Out {
    let flight = v.moment.flight;
    let armed = if flight.armed() { 0x80 } else { 0 };
    let (autopilot, base, custom_mode) = match v.stack {
        // manual input, stabilised, guided, custom; GUIDED is mode 4, LAND 9, STABILIZE 0
        Stack::ArduPilot => {
            let mode = match flight {
                Flight::Disarmed => 0,
                Flight::TakingOff | Flight::Flying => 4,
                Flight::Landing => 9,
            };
            (mav::MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA, 0x59, mode)
        }
        // stabilised, guided, auto, custom; main mode AUTO with its sub mode above it
        Stack::Px4 => {
            let sub: u32 = match flight {
                Flight::TakingOff => 2,
                Flight::Disarmed | Flight::Flying => 3,
                Flight::Landing => 6,
            };
            (mav::MavAutopilot::MAV_AUTOPILOT_PX4, 0x1D, sub << 24 | 4 << 16)
        }
    };
    w.put(&mav::HEARTBEAT_DATA {
        custom_mode,
        mavtype: vehicle_type(v.rotor_count),
        autopilot,
        base_mode: mav::MavModeFlag::from_bits_retain(base | armed),
        system_status: match flight.armed() {
            true => mav::MavState::MAV_STATE_ACTIVE,
            false => mav::MavState::MAV_STATE_STANDBY,
        },
        mavlink_version: 3,
    })
}

fn vehicle_type(rotors: usize) -> mav::MavType {
    match rotors {
        6 => mav::MavType::MAV_TYPE_HEXAROTOR,
        8 => mav::MavType::MAV_TYPE_OCTOROTOR,
        12 => mav::MavType::MAV_TYPE_DODECAROTOR,
        _ => mav::MavType::MAV_TYPE_QUADROTOR,
    }
}

pub(in crate::sim::feed) fn sys_status(v: &View<'_>, w: &mut Writer) -> Out {
    let r = &v.moment.readings;
    // gyro, accelerometer, magnetometer, absolute pressure, GPS, rate and attitude control, motors
    let all = mav::MavSysStatusSensor::from_bits_retain(0x0000_8C2F);
    w.put(&mav::SYS_STATUS_DATA {
        onboard_control_sensors_present: all,
        onboard_control_sensors_enabled: all,
        onboard_control_sensors_health: all,
        load: 214,
        voltage_battery: (r.voltage_v * 1e3) as u16,
        current_battery: (r.current_a * 100.0) as i16,
        battery_remaining: (v.moment.truth.battery_left * 100.0) as i8,
        ..Default::default()
    })
}

pub(in crate::sim::feed) fn system_time(v: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::SYSTEM_TIME_DATA { time_unix_usec: v.unix_us, time_boot_ms: v.stamp_ms() })
}

pub(in crate::sim::feed) fn extended_sys_state(v: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::EXTENDED_SYS_STATE_DATA {
        vtol_state: match v.stack {
            Stack::ArduPilot => mav::MavVtolState::MAV_VTOL_STATE_MC,
            Stack::Px4 => mav::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
        },
        landed_state: match v.moment.flight {
            Flight::Disarmed => mav::MavLandedState::MAV_LANDED_STATE_ON_GROUND,
            Flight::TakingOff => mav::MavLandedState::MAV_LANDED_STATE_TAKEOFF,
            Flight::Flying => mav::MavLandedState::MAV_LANDED_STATE_IN_AIR,
            Flight::Landing => mav::MavLandedState::MAV_LANDED_STATE_LANDING,
        },
    })
}

pub(in crate::sim::feed) fn ekf_status_report(v: &View<'_>, w: &mut Writer) -> Out {
    let i = &v.innovations;
    w.put(&mav::EKF_STATUS_REPORT_DATA {
        flags: mav::EkfStatusFlags::from_bits_retain(831),
        velocity_variance: i.velocity as f32,
        pos_horiz_variance: i.position as f32,
        pos_vert_variance: i.height as f32,
        compass_variance: i.heading as f32,
        terrain_alt_variance: 0.0,
        airspeed_variance: 0.0,
    })
}

pub(in crate::sim::feed) fn estimator_status(v: &View<'_>, w: &mut Writer) -> Out {
    let i = &v.innovations;
    w.put(&mav::ESTIMATOR_STATUS_DATA {
        time_usec: v.stamp_us(),
        flags: mav::EstimatorStatusFlags::from_bits_retain(895),
        vel_ratio: i.velocity as f32,
        pos_horiz_ratio: i.position as f32,
        pos_vert_ratio: i.height as f32,
        mag_ratio: i.heading as f32,
        hagl_ratio: f32::NAN,
        tas_ratio: f32::NAN,
        pos_horiz_accuracy: 0.3,
        pos_vert_accuracy: 0.3,
    })
}

pub(in crate::sim::feed) fn vibration(v: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::VIBRATION_DATA { time_usec: v.stamp_us(), ..Default::default() })
}

pub(in crate::sim::feed) fn mission_current(_: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::MISSION_CURRENT_DATA {
        seq: 0,
        mission_state: mav::MissionState::MISSION_STATE_NO_MISSION,
        ..Default::default()
    })
}

/// ArduPilot sends this even when it estimates nothing: no wind, from the south.
pub(in crate::sim::feed) fn wind(_: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::WIND_DATA { direction: -180.0, speed: 0.0, speed_z: 0.0 })
}
