use crate::signal::Measurement;
use nalgebra::UnitQuaternion;

/// Attitude may differ by this from what the gyro predicts before it counts as a reset of the estimator, rad.
const ATTITUDE_JUMP_RAD: f64 = 0.14;
/// Velocity may move by this beside the accelerometer's word before it counts as a reset, m/s.
const VELOCITY_JUMP_MPS: f64 = 1.5;
/// Samples further apart than this say too little about what lay between them to call anything a jump, s.
const JUMP_MAX_DT_S: f64 = 0.15;

/// Did the autopilot's estimate move in a way that its own inertial sensors contradict?
pub(super) fn jumped(last: &Measurement, m: &Measurement) -> bool {
    if m.dt_s > JUMP_MAX_DT_S {
        return false;
    }
    if let (Some(a), Some(b)) = (last.attitude, m.attitude) {
        let turned = UnitQuaternion::from_scaled_axis(0.5 * (last.imu.rate_frd_rads + m.imu.rate_frd_rads) * m.dt_s);
        // two samples say little about a fast turn between them: allow a quarter of it
        let allowed = ATTITUDE_JUMP_RAD + 0.25 * turned.angle();
        if (a.value * turned).angle_to(&b.value) > allowed {
            return true;
        }
    }
    if let (Some(u), Some(v)) = (last.velocity_ned_mps, m.velocity_ned_mps) {
        let accel = last.imu.accel_frd_mps2.norm().max(m.imu.accel_frd_mps2.norm()) + 9.8;
        return (v.value - u.value).norm() > VELOCITY_JUMP_MPS + 1.5 * accel * (m.dt_s + u.age_s.abs());
    }
    false
}
