//! What the sensors deliver.

use crate::sim::estimator::pressure_altitude_m;
use crate::sim::feed::Stack;
use crate::sim::feed::view::{View, cut};
use crate::sim::feed::writer::Writer;
use crate::sim::sensors::ImuReading;
use crate::vehicle::GRAVITY_MPS2;
use crate::wire::FrameBuf;
use crate::wire::dialect::ardupilotmega as mav;
use nalgebra::Vector3;

type Out = Option<FrameBuf>;

/// milli-g, mrad/s and milligauss, cut off to whole numbers.
struct Integers {
    acc: [i16; 3],
    gyro: [i16; 3],
    mag: [i16; 3],
}

fn integers(imu: &ImuReading, mag_gauss: &Vector3<f64>) -> Integers {
    let three = |v: Vector3<f64>| [cut(v.x), cut(v.y), cut(v.z)];
    Integers {
        acc: three(imu.accel_frd_mps2 * (1000.0 / GRAVITY_MPS2)),
        gyro: three(imu.rate_frd_rads * 1000.0),
        mag: three(mag_gauss * 1000.0),
    }
}

pub(in crate::sim::feed) fn raw_imu(v: &View<'_>, w: &mut Writer) -> Out {
    let [first, _] = &v.moment.readings.imu;
    let Integers { acc: [xacc, yacc, zacc], gyro: [xgyro, ygyro, zgyro], mag: [xmag, ymag, zmag] } =
        integers(first, &v.latest.mag_gauss);
    w.put(&mav::RAW_IMU_DATA {
        time_usec: v.stamp_us(),
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        xmag,
        ymag,
        zmag,
        id: 0,
        temperature: BOARD_CENTIDEGREES,
    })
}

pub(in crate::sim::feed) fn scaled_imu(v: &View<'_>, w: &mut Writer) -> Out {
    let [first, _] = &v.moment.readings.imu;
    let Integers { acc: [xacc, yacc, zacc], gyro: [xgyro, ygyro, zgyro], mag: [xmag, ymag, zmag] } =
        integers(first, &v.latest.mag_gauss);
    w.put(&mav::SCALED_IMU_DATA {
        time_boot_ms: v.stamp_ms(),
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        xmag,
        ymag,
        zmag,
        temperature: BOARD_CENTIDEGREES,
    })
}

pub(in crate::sim::feed) fn scaled_imu2(v: &View<'_>, w: &mut Writer) -> Out {
    let [_, second] = &v.moment.readings.imu;
    let Integers { acc: [xacc, yacc, zacc], gyro: [xgyro, ygyro, zgyro], mag: [xmag, ymag, zmag] } =
        integers(second, &v.latest.mag_gauss);
    w.put(&mav::SCALED_IMU2_DATA {
        time_boot_ms: v.stamp_ms(),
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        xmag,
        ymag,
        zmag,
        temperature: BOARD_CENTIDEGREES,
    })
}

/// PX4 subtracts what its estimator has learnt; ArduPilot sends the field a thousand times too large.
pub(in crate::sim::feed) fn highres_imu(v: &View<'_>, w: &mut Writer) -> Out {
    let [first, _] = &v.moment.readings.imu;
    let (mut accel, mut rate) = (first.accel_frd_mps2, first.rate_frd_rads);
    let mut mag = v.latest.mag_gauss;
    let updated = match v.stack {
        Stack::Px4 => {
            rate -= v.biases.0;
            accel -= v.biases.1;
            0x3F
        }
        Stack::ArduPilot => {
            mag *= 1e6;
            0xFFFF
        }
    };
    w.put(&mav::HIGHRES_IMU_DATA {
        time_usec: v.stamp_us(),
        xacc: accel.x as f32,
        yacc: accel.y as f32,
        zacc: accel.z as f32,
        xgyro: rate.x as f32,
        ygyro: rate.y as f32,
        zgyro: rate.z as f32,
        xmag: mag.x as f32,
        ymag: mag.y as f32,
        zmag: mag.z as f32,
        abs_pressure: (v.latest.pressure_pa * 0.01) as f32,
        diff_pressure: 0.0,
        pressure_alt: pressure_altitude_m(v.latest.pressure_pa) as f32,
        temperature: f32::from(BOARD_CENTIDEGREES) * 0.01,
        fields_updated: mav::HighresImuUpdatedFlags::from_bits_retain(updated),
        id: 0,
    })
}

pub(in crate::sim::feed) fn scaled_pressure(v: &View<'_>, w: &mut Writer) -> Out {
    w.put(&mav::SCALED_PRESSURE_DATA {
        time_boot_ms: v.stamp_ms(),
        press_abs: (v.latest.pressure_pa * 0.01) as f32,
        press_diff: 0.0,
        temperature: 3119,
        temperature_press_diff: 0,
    })
}

/// By how much ArduPilot's stamp of a fix trails the instant it was true, as recorded from it.
const ARDUPILOT_FIX_DELAY_US: u64 = 90_000;

/// Speed and course only: the vertical velocity is not sent. PX4 stamps the instant of the fix.
pub(in crate::sim::feed) fn gps_raw_int(v: &View<'_>, w: &mut Writer) -> Out {
    let Some(fix) = &v.latest.fix else {
        return w.put(&mav::GPS_RAW_INT_DATA {
            fix_type: mav::GpsFixType::GPS_FIX_TYPE_NO_FIX,
            eph: u16::MAX,
            epv: u16::MAX,
            vel: u16::MAX,
            cog: u16::MAX,
            satellites_visible: 0,
            ..Default::default()
        });
    };
    let place = v.place(&fix.position_ned_m);
    let velocity = &fix.velocity_ned_mps;
    // how long ago the fix was true, on whatever clock the autopilot has now
    let age_us = ((v.moment.truth.stamp - fix.stamp) * 1e6).max(0.0) as u64;
    let age_us = match v.stack {
        Stack::Px4 => age_us,
        Stack::ArduPilot => age_us.saturating_sub(ARDUPILOT_FIX_DELAY_US),
    };
    w.put(&mav::GPS_RAW_INT_DATA {
        time_usec: v.loop_us.saturating_sub(age_us) / 1000 * 1000,
        fix_type: mav::GpsFixType::GPS_FIX_TYPE_3D_FIX,
        lat: place.lat_e7,
        lon: place.lon_e7,
        alt: place.alt_mm,
        eph: 121,
        epv: 200,
        vel: (velocity.xy().norm() * 100.0) as u16,
        cog: (velocity.y.atan2(velocity.x).to_degrees().rem_euclid(360.0) * 100.0) as u16,
        satellites_visible: fix.satellites,
        alt_ellipsoid: place.alt_mm,
        h_acc: 300,
        v_acc: 300,
        vel_acc: 40,
        ..Default::default()
    })
}

const BOARD_CENTIDEGREES: i16 = 3521;
