//! Inertial sensors, and what travels in the same messages: magnetometer and barometer.

use super::{Decoded, Decoder, finite, integers, sample, vector};
use crate::signal::{ImuSource, MagField, MagSource, SampleKind, Stamp};
use crate::vehicle::GRAVITY_MPS2;
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{FrameRef, decode};
use nalgebra::Vector3;

/// One milli-g, m/s².
const MILLI_G: f64 = GRAVITY_MPS2 * 1e-3;
/// Bits of HIGHRES_IMU's `fields_updated`: the three axes of the magnetometer, the absolute pressure.
const MAG_UPDATED: u16 = 0b1_1100_0000;
const PRESSURE_UPDATED: u16 = 0b10_0000_0000;

impl Decoder {
    pub(super) fn raw_imu(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let Some(m) = decode::<mav::RAW_IMU_DATA>(frame) else { return };
        let Some(t) = self.boot_us(m.time_usec, received_us, sink) else { return };
        imu(t, ImuSource::Scaled, [m.xacc, m.yacc, m.zacc], [m.xgyro, m.ygyro, m.zgyro], sink);
        self.mag(t, MagSource::Scaled, integers(m.xmag, m.ymag, m.zmag) * 1e-3, sink);
    }

    pub(super) fn scaled_imu<T: ScaledImu>(
        &mut self,
        frame: FrameRef<'_>,
        received_us: u64,
        source: ImuSource,
        sink: &mut dyn FnMut(Decoded),
    ) {
        let Some(m) = decode::<T>(frame) else { return };
        let Some(t) = self.boot_ms(m.boot_ms(), received_us, sink) else { return };
        imu(t, source, m.accel(), m.gyro(), sink);
        if source == ImuSource::Scaled {
            let [x, y, z] = m.mag();
            self.mag(t, MagSource::Scaled, integers(x, y, z) * 1e-3, sink);
        }
    }

    pub(super) fn highres_imu(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let Some(m) = decode::<mav::HIGHRES_IMU_DATA>(frame) else { return };
        if m.id != 0 {
            return;
        }
        let Some(t) = self.boot_us(m.time_usec, received_us, sink) else { return };
        let accel_frd_mps2 = vector(m.xacc, m.yacc, m.zacc);
        let rate_frd_rads = vector(m.xgyro, m.ygyro, m.zgyro);
        if finite(accel_frd_mps2) && finite(rate_frd_rads) {
            sink(sample(t, SampleKind::Imu { source: ImuSource::HighRes, accel_frd_mps2, rate_frd_rads }));
        }
        // slower sensors are repeated until they have another sample; not every sender keeps the flags
        let updated = m.fields_updated.bits();
        let field = vector(m.xmag, m.ymag, m.zmag);
        if self.highres_field.replace(field) != Some(field) || updated & MAG_UPDATED != 0 {
            self.mag(t, MagSource::HighRes, field * gauss_per_unit(field.norm()), sink);
        }
        let pressure = m.abs_pressure;
        if self.highres_pressure.replace(pressure) != Some(pressure) || updated & PRESSURE_UPDATED != 0 {
            self.pressure(t, 2, pressure, sink);
        }
    }

    pub(super) fn scaled_pressure(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        if let Some(m) = decode::<mav::SCALED_PRESSURE_DATA>(frame)
            && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
        {
            self.pressure(t, 1, m.press_abs, sink);
        }
    }

    /// Absolute pressure in hPa, as both messages have it.
    fn pressure(&mut self, t: Stamp, rank: u8, hpa: f32, sink: &mut dyn FnMut(Decoded)) {
        if hpa > 0.0 && hpa.is_finite() && self.pressure.accept(rank, t) {
            sink(sample(t, SampleKind::Pressure { pressure_pa: f64::from(hpa) * 100.0 }));
        }
    }

    fn mag(&mut self, t: Stamp, source: MagSource, field_frd_gauss: Vector3<f64>, sink: &mut dyn FnMut(Decoded)) {
        let rank = match source {
            MagSource::Scaled => 1,
            MagSource::HighRes => 2,
        };
        if finite(field_frd_gauss) && field_frd_gauss != Vector3::zeros() && self.magnetometer.accept(rank, t) {
            sink(sample(t, SampleKind::Mag(MagField { field_frd_gauss, source })));
        }
    }
}

/// HIGHRES_IMU should hold gauss; ArduPilot sends a millionth, some others a thousandth. The Earth's field is 0.2 to
/// 0.7 G anywhere, which tells them apart.
fn gauss_per_unit(norm: f64) -> f64 {
    if norm < 10.0 {
        1.0
    } else if norm < 1e4 {
        1e-3
    } else {
        1e-6
    }
}

fn imu(t: Stamp, source: ImuSource, accel: [i16; 3], gyro: [i16; 3], sink: &mut dyn FnMut(Decoded)) {
    let [x, y, z] = accel;
    let [p, q, r] = gyro;
    sink(sample(
        t,
        SampleKind::Imu {
            source,
            accel_frd_mps2: integers(x, y, z) * MILLI_G,
            rate_frd_rads: integers(p, q, r) * 1e-3,
        },
    ));
}

/// SCALED_IMU, SCALED_IMU2 and SCALED_IMU3 have the same fields under three types.
pub(super) trait ScaledImu: mavlink::MessageData {
    fn boot_ms(&self) -> u32;
    fn accel(&self) -> [i16; 3];
    fn gyro(&self) -> [i16; 3];
    fn mag(&self) -> [i16; 3];
}

macro_rules! scaled_imu {
    ($($t:ty),*) => {$(
        impl ScaledImu for $t {
            fn boot_ms(&self) -> u32 { self.time_boot_ms }
            fn accel(&self) -> [i16; 3] { [self.xacc, self.yacc, self.zacc] }
            fn gyro(&self) -> [i16; 3] { [self.xgyro, self.ygyro, self.zgyro] }
            fn mag(&self) -> [i16; 3] { [self.xmag, self.ymag, self.zmag] }
        }
    )*};
}

scaled_imu!(mav::SCALED_IMU_DATA, mav::SCALED_IMU2_DATA, mav::SCALED_IMU3_DATA);
