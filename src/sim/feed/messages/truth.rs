//! The simulator's truth, as the simulators of both stacks send it. Never to be fed to an observer.

use crate::sim::feed::view::View;
use crate::sim::feed::writer::Writer;
use crate::vehicle::GRAVITY_MPS2;
use crate::wire::FrameBuf;
use crate::wire::dialect::ardupilotmega as mav;

type Out = Option<FrameBuf>;

pub(in crate::sim::feed) fn simstate(v: &View<'_>, w: &mut Writer) -> Out {
    let t = &v.moment.truth;
    let (roll, pitch, yaw) = t.body_to_ned.euler_angles();
    let place = v.place(&t.position_ned_m);
    let (a, g) = (t.specific_force_frd_mps2, t.rate_frd_rads);
    w.put(&mav::SIMSTATE_DATA {
        roll: roll as f32,
        pitch: pitch as f32,
        yaw: yaw as f32,
        xacc: a.x as f32,
        yacc: a.y as f32,
        zacc: a.z as f32,
        xgyro: g.x as f32,
        ygyro: g.y as f32,
        zgyro: g.z as f32,
        lat: place.lat_e7,
        lng: place.lon_e7,
    })
}

pub(in crate::sim::feed) fn sim_state(v: &View<'_>, w: &mut Writer) -> Out {
    let t = &v.moment.truth;
    let (roll, pitch, yaw) = t.body_to_ned.euler_angles();
    let q = t.body_to_ned.quaternion();
    let place = v.place(&t.position_ned_m);
    let (a, g, u) = (t.specific_force_frd_mps2, t.rate_frd_rads, t.velocity_ned_mps);
    w.put(&mav::SIM_STATE_DATA {
        q1: q.w as f32,
        q2: q.i as f32,
        q3: q.j as f32,
        q4: q.k as f32,
        roll: roll as f32,
        pitch: pitch as f32,
        yaw: yaw as f32,
        xacc: a.x as f32,
        yacc: a.y as f32,
        zacc: a.z as f32,
        xgyro: g.x as f32,
        ygyro: g.y as f32,
        zgyro: g.z as f32,
        // the float fields hold degrees times 10⁷ too, as ArduPilot sends them
        lat: place.lat_e7 as f32,
        lon: place.lon_e7 as f32,
        alt: (v.home.altitude_m - t.position_ned_m.z) as f32,
        vn: u.x as f32,
        ve: u.y as f32,
        vd: u.z as f32,
        lat_int: place.lat_e7,
        lon_int: place.lon_e7,
        ..Default::default()
    })
}

/// PX4's has no time: the field is always zero.
pub(in crate::sim::feed) fn hil_state_quaternion(v: &View<'_>, w: &mut Writer) -> Out {
    let t = &v.moment.truth;
    let q = t.body_to_ned.quaternion();
    let place = v.place(&t.position_ned_m);
    let (u, a) = (t.velocity_ned_mps * 100.0, t.specific_force_frd_mps2 * (1000.0 / GRAVITY_MPS2));
    let airspeed = (t.air_velocity_frd_mps.norm() * 100.0) as u16;
    w.put(&mav::HIL_STATE_QUATERNION_DATA {
        time_usec: 0,
        attitude_quaternion: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
        rollspeed: t.rate_frd_rads.x as f32,
        pitchspeed: t.rate_frd_rads.y as f32,
        yawspeed: t.rate_frd_rads.z as f32,
        lat: place.lat_e7,
        lon: place.lon_e7,
        alt: place.alt_mm,
        vx: u.x as i16,
        vy: u.y as i16,
        vz: u.z as i16,
        ind_airspeed: airspeed,
        true_airspeed: airspeed,
        xacc: a.x as i16,
        yacc: a.y as i16,
        zacc: a.z as i16,
    })
}
