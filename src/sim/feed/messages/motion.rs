//! What the autopilot believes of its motion.

use crate::sim::feed::Stack;
use crate::sim::feed::view::{View, cut};
use crate::sim::feed::writer::Writer;
use crate::wire::FrameBuf;
use crate::wire::dialect::ardupilotmega as mav;
use nalgebra::Vector3;

type Out = Option<FrameBuf>;

pub(in crate::sim::feed) fn attitude(v: &View<'_>, w: &mut Writer) -> Out {
    let n = &v.moment.navigation;
    let (roll, pitch, yaw) = n.body_to_ned.euler_angles();
    w.put(&mav::ATTITUDE_DATA {
        time_boot_ms: v.stamp_ms(),
        roll: roll as f32,
        pitch: pitch as f32,
        yaw: yaw as f32,
        rollspeed: n.rate_frd_rads.x as f32,
        pitchspeed: n.rate_frd_rads.y as f32,
        yawspeed: n.rate_frd_rads.z as f32,
    })
}

pub(in crate::sim::feed) fn attitude_quaternion(v: &View<'_>, w: &mut Writer) -> Out {
    let n = &v.moment.navigation;
    let [q1, q2, q3, q4] = quaternion(v);
    w.put(&mav::ATTITUDE_QUATERNION_DATA {
        time_boot_ms: v.stamp_ms(),
        q1,
        q2,
        q3,
        q4,
        rollspeed: n.rate_frd_rads.x as f32,
        pitchspeed: n.rate_frd_rads.y as f32,
        yawspeed: n.rate_frd_rads.z as f32,
        ..Default::default()
    })
}

pub(in crate::sim::feed) fn local_position_ned(v: &View<'_>, w: &mut Writer) -> Out {
    let [x, y, z] = floats(&v.moment.navigation.position_ned_m);
    let [vx, vy, vz] = floats(&v.moment.navigation.velocity_ned_mps);
    w.put(&mav::LOCAL_POSITION_NED_DATA { time_boot_ms: v.stamp_ms(), x, y, z, vx, vy, vz })
}

pub(in crate::sim::feed) fn global_position_int(v: &View<'_>, w: &mut Writer) -> Out {
    let n = &v.moment.navigation;
    let place = v.place(&n.position_ned_m);
    let velocity = n.velocity_ned_mps * 100.0;
    w.put(&mav::GLOBAL_POSITION_INT_DATA {
        time_boot_ms: v.stamp_ms(),
        lat: place.lat_e7,
        lon: place.lon_e7,
        alt: place.alt_mm,
        relative_alt: (-n.position_ned_m.z * 1e3) as i32,
        vx: cut(velocity.x),
        vy: cut(velocity.y),
        vz: cut(velocity.z),
        hdg: (v.heading_deg() * 100.0) as u16,
    })
}

/// PX4's: pose and velocity both in NED, named so in the message.
pub(in crate::sim::feed) fn odometry(v: &View<'_>, w: &mut Writer) -> Out {
    let n = &v.moment.navigation;
    let [x, y, z] = floats(&n.position_ned_m);
    let [vx, vy, vz] = floats(&n.velocity_ned_mps);
    let [rollspeed, pitchspeed, yawspeed] = floats(&n.rate_frd_rads);
    // upper triangle, row by row: x y z roll pitch yaw
    let covariance = |position: f32, angle: f32| {
        let mut c = [f32::NAN; 21];
        for (at, value) in [(0, position), (6, position), (11, position), (15, angle), (18, angle), (20, angle)] {
            c[at] = value;
        }
        c
    };
    w.put(&mav::ODOMETRY_DATA {
        time_usec: v.stamp_us(),
        frame_id: mav::MavFrame::MAV_FRAME_LOCAL_NED,
        child_frame_id: mav::MavFrame::MAV_FRAME_LOCAL_NED,
        x,
        y,
        z,
        q: quaternion(v),
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: covariance(0.04, 1.3e-5),
        velocity_covariance: covariance(0.01, f32::NAN),
        reset_counter: v.resets,
        estimator_type: mav::MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT,
        quality: 100,
    })
}

pub(in crate::sim::feed) fn attitude_target(v: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::ATTITUDE_TARGET_DATA {
        time_boot_ms: v.stamp_ms(),
        q: quaternion(v),
        thrust: v.throttle() as f32,
        ..Default::default()
    })
}

pub(in crate::sim::feed) fn vfr_hud(v: &View<'_>, w: &mut Writer) -> Out {
    let n = &v.moment.navigation;
    let airspeed = match v.stack {
        Stack::ArduPilot => n.velocity_ned_mps.xy().norm() as f32,
        Stack::Px4 => f32::NAN,
    };
    w.put(&mav::VFR_HUD_DATA {
        airspeed,
        groundspeed: n.velocity_ned_mps.xy().norm() as f32,
        alt: (v.home.altitude_m - n.position_ned_m.z) as f32,
        climb: -n.velocity_ned_mps.z as f32,
        heading: v.heading_deg() as i16,
        throttle: (v.throttle() * 100.0) as u16,
    })
}

pub(in crate::sim::feed) fn altitude(v: &View<'_>, w: &mut Writer) -> Out {
    let up = -v.moment.navigation.position_ned_m.z;
    w.put(&mav::ALTITUDE_DATA {
        time_usec: v.stamp_us(),
        altitude_monotonic: (v.home.altitude_m + up) as f32,
        altitude_amsl: (v.home.altitude_m + up) as f32,
        altitude_local: up as f32,
        altitude_relative: up as f32,
        altitude_terrain: f32::NAN,
        bottom_clearance: f32::NAN,
    })
}

pub(in crate::sim::feed) fn home_position(v: &View<'_>, w: &mut Writer) -> Out {
    let place = v.place(&Vector3::zeros());
    w.put(&mav::HOME_POSITION_DATA {
        latitude: place.lat_e7,
        longitude: place.lon_e7,
        altitude: place.alt_mm,
        q: [1.0, 0.0, 0.0, 0.0],
        time_usec: v.stamp_us(),
        ..Default::default()
    })
}

/// w, x, y, z.
fn quaternion(v: &View<'_>) -> [f32; 4] {
    let q = v.moment.navigation.body_to_ned.quaternion();
    [q.w as f32, q.i as f32, q.j as f32, q.k as f32]
}

fn floats(v: &Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}
