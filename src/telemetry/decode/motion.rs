//! What the autopilot's estimator says: attitude, velocity, position.

use super::{Decoded, Decoder, finite, integers, sample, vector};
use crate::signal::{SampleKind, Stamp};
use crate::wire::dialect::ardupilotmega as mav;
use crate::wire::{Fields, FrameRef, decode};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

impl Decoder {
    /// ATTITUDE, ATTITUDE_QUATERNION, LOCAL_POSITION_NED, GLOBAL_POSITION_INT.
    pub(super) fn motion(&mut self, frame: FrameRef<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        match frame.message_id() {
            30 => {
                if let Some(m) = decode::<mav::ATTITUDE_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.attitude.accept(1, t)
                {
                    let q = UnitQuaternion::from_euler_angles(m.roll.into(), m.pitch.into(), m.yaw.into());
                    self.attitude(t, q.into_inner(), sink);
                }
            }
            31 => {
                if let Some(m) = decode::<mav::ATTITUDE_QUATERNION_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.attitude.accept(2, t)
                {
                    let q = Quaternion::new(m.q1.into(), m.q2.into(), m.q3.into(), m.q4.into());
                    self.attitude(t, q, sink);
                }
            }
            32 => {
                if let Some(m) = decode::<mav::LOCAL_POSITION_NED_DATA>(frame)
                    && let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink)
                    && self.velocity.accept(3, t)
                {
                    local_position(t, vector(m.x, m.y, m.z), vector(m.vx, m.vy, m.vz), sink);
                }
            }
            33 => {
                let Some(m) = decode::<mav::GLOBAL_POSITION_INT_DATA>(frame) else { return };
                let Some(t) = self.boot_ms(m.time_boot_ms, received_us, sink) else { return };
                let position = SampleKind::GlobalPosition {
                    latitude_deg: f64::from(m.lat) * 1e-7,
                    longitude_deg: f64::from(m.lon) * 1e-7,
                    altitude_m: f64::from(m.alt) * 1e-3,
                };
                sink(sample(t, position));
                if self.velocity.accept(1, t) {
                    sink(sample(t, SampleKind::Velocity { velocity_ned_mps: integers(m.vx, m.vy, m.vz) * 1e-2 }));
                }
            }
            _ => {}
        }
    }

    fn attitude(&mut self, t: Stamp, q: Quaternion<f64>, sink: &mut dyn FnMut(Decoded)) {
        if let Some(body_to_ned) = UnitQuaternion::try_new(q, 0.5)
            && q.norm() < 1.5
        {
            sink(sample(t, SampleKind::Attitude { body_to_ned }));
        }
    }

    pub(super) fn odometry(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let resets = f.u8(230);
        if self.odometry_resets.replace(resets).is_some_and(|old| old != resets) {
            sink(Decoded::EstimatorReset);
        }
        let Some(t) = self.boot_us(f.u64(0), received_us, sink) else { return };
        let at = |o: usize| vector(f.f32(o), f.f32(o + 4), f.f32(o + 8));
        let q = Quaternion::new(f.f32(20).into(), f.f32(24).into(), f.f32(28).into(), f.f32(32).into());
        // MAV_FRAME_LOCAL_NED 1, MAV_FRAME_BODY_FRD 12
        const LOCAL_NED: u8 = 1;
        const BODY_FRD: u8 = 12;
        let velocity = match (f.u8(228), f.u8(229)) {
            (LOCAL_NED, LOCAL_NED) => at(36),
            (LOCAL_NED, BODY_FRD) => match UnitQuaternion::try_new(q, 0.5) {
                Some(q) => q * at(36),
                None => return,
            },
            // any other frame has no fixed relation to NED
            _ => return,
        };
        if self.velocity.accept(2, t) {
            local_position(t, at(8), velocity, sink);
        }
    }
}

fn local_position(t: Stamp, position: Vector3<f64>, velocity: Vector3<f64>, sink: &mut dyn FnMut(Decoded)) {
    if finite(position) && finite(velocity) {
        sink(sample(t, SampleKind::LocalPosition { position_ned_m: position, velocity_ned_mps: velocity }));
    }
}
