use crate::sets::Interval;
use crate::signal::{Actuation, Imu};
use crate::vehicle::Vehicle;
use nalgebra::{UnitQuaternion, Vector3};

/// The residual force, world NED, N, and the half-widths of its interval (infinite where nothing is claimed).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceInterval {
    pub value_ned_n: Vector3<f64>,
    pub half_width_ned_n: Vector3<f64>,
    /// May the accelerometer's own interval be intersected with this one? Not while the data contradict the
    /// declared noise: then neither is to be trusted more than the other.
    pub trust_accelerometer: bool,
}

/// What the wind is computed from beside the force.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    pub imu: Imu,
    pub body_to_ned: UnitQuaternion<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub actuation: Actuation,
    /// kg/m³.
    pub density_kgm3: f64,
}

/// Velocity of the air over ground, world NED, m/s, with half-widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wind {
    pub velocity_ned_mps: Vector3<f64>,
    pub half_width_mps: Vector3<f64>,
}

/// Below this cosine of the lean angle the horizontal wind can't be told from the body's lateral airspeed.
const MIN_UPRIGHT: f64 = 0.3;
/// Share by which Σ√T may be off: the square root halves the thrust's own error.
const SQRT_THRUST_SHARE: f64 = 0.05;

/// Share by which the inflow law may be off.
const INFLOW_SHARE: f64 = 0.2;

/// Wind from the residual force (DESIGN §6.7). `None` when no drag coefficient is known, or the vehicle is on its side.
///
/// The lateral body axes give two airspeeds. The third is taken so that the vertical wind is what the vertical drag
/// says, shrunk towards zero by the declared envelope: in hover the vertical drag law is flat around zero and thrust
/// error dominates, so without the envelope it would say next to nothing.
pub fn wind_from_force(vehicle: &Vehicle, flow: &Flow, force: &ForceInterval) -> Option<Wind> {
    let r = flow.body_to_ned.to_rotation_matrix();
    let r = r.matrix();
    if r[(2, 2)] < MIN_UPRIGHT {
        return None;
    }
    let act = &flow.actuation;
    let mut value = r.tr_mul(&force.value_ned_n);
    // the rotor model lost thrust to the climb over ground; what counts is the climb through the air, which is sought
    // here: give that loss back and let it act as drag along body z
    value.z += act.inflow_n_per_mps2 * act.climb_mps.max(0.0).powi(2);
    let sqrt_t = Interval::centred(act.sum_sqrt_thrust, act.sum_sqrt_thrust * SQRT_THRUST_SHARE);
    let rho = Interval::centred(flow.density_kgm3, flow.density_kgm3 * vehicle.noise.density);
    let airspeed = |i: usize| -> Option<(f64, Interval)> {
        let back = if i == 2 { act.inflow_n_per_mps2 } else { 0.0 };
        let nominal = vehicle.drag.airspeed(i, value[i], act.sum_sqrt_thrust, flow.density_kgm3, back)?;
        let range = body_force(vehicle, flow, force, value[i], i);
        let back = Interval::centred(back, back * INFLOW_SHARE);
        let range = vehicle.drag.airspeed_interval(i, range, sqrt_t, rho, back)?;
        Some((nominal, range.hull(Interval::point(nominal))))
    };
    let (x, x_range) = airspeed(0)?;
    let (y, y_range) = airspeed(1)?;

    let noise = &vehicle.noise;
    let v = &flow.velocity_ned_mps;
    let v_range = |i: usize| Interval::centred(v[i], noise.velocity_mps[i]);
    let lateral = |i: usize| (x_range * r[(i, 0)]) + (y_range * r[(i, 1)]);

    let prior = Interval::centred(0.0, vehicle.envelope.vertical_wind_mps);
    let (down, down_range) = match airspeed(2) {
        Some((z, z_range)) => {
            let seen = v[2] - r[(2, 0)] * x - r[(2, 1)] * y - r[(2, 2)] * z;
            let seen_range = v_range(2) - lateral(2) - z_range * r[(2, 2)];
            shrink(seen, seen_range, prior)
        }
        None => (0.0, prior),
    };

    // v_air,z follows from the vertical wind; substituted, the horizontal wind is linear in x, y, v and the vertical wind
    let mut wind = Wind { velocity_ned_mps: Vector3::new(0.0, 0.0, down), half_width_mps: Vector3::zeros() };
    let horizontal_air = (r[(0, 0)] * x + r[(0, 1)] * y).hypot(r[(1, 0)] * x + r[(1, 1)] * y);
    let climb_air = (v[2] - down).abs();
    for i in 0..2 {
        let cz = r[(i, 2)] / r[(2, 2)];
        let cx = r[(i, 0)] - cz * r[(2, 0)];
        let cy = r[(i, 1)] - cz * r[(2, 1)];
        let w = v[i] - cx * x - cy * y - cz * (v[2] - down);
        let range = v_range(i) - x_range * cx - y_range * cy - (v_range(2) - down_range) * cz;
        // a small rotation of R moves R·v_air by the angle times the part of v_air across it
        let turned = noise.yaw_rad * horizontal_air + noise.tilt_rad * (climb_air + cz.abs() * horizontal_air);
        wind.velocity_ned_mps[i] = w;
        wind.half_width_mps[i] = reach(range, w) + turned;
    }
    wind.half_width_mps[2] = reach(down_range, down);
    Some(wind)
}

/// Interval of the residual force on body axis `i` that the air explains.
fn body_force(vehicle: &Vehicle, flow: &Flow, force: &ForceInterval, value: f64, i: usize) -> Interval {
    let r = flow.body_to_ned.to_rotation_matrix();
    let r = r.matrix();
    let spread: f64 = (0..3).map(|j| r[(j, i)].abs() * force.half_width_ned_n[j]).sum();
    let noise = &vehicle.noise;
    let angle = noise.yaw_rad.hypot(noise.tilt_rad);
    let thrust_share = vehicle.thrust.max_n.range.radius() / vehicle.thrust.max_n.nominal.max(f64::MIN_POSITIVE);
    let thrust_error = thrust_share * flow.actuation.force_frd_n[i].abs();
    let from_wrench = Interval::centred(value, spread + angle * force.value_ned_n.norm() + thrust_error);
    // along the thrust axis the accelerometer says no more than the wrench does
    if !force.trust_accelerometer || i == 2 {
        return from_wrench;
    }
    let accel = Interval::centred(flow.imu.accel_frd_mps2[i], noise.accel_mps2[i] + noise.accel_bias_mps2[i]);
    let from_accel = accel * vehicle.mass_kg.range - Interval::centred(flow.actuation.force_frd_n[i], thrust_error);
    from_wrench.intersect(from_accel).unwrap_or(from_wrench)
}

/// Joins what the vertical drag says with the declared envelope: the value shrunk by how wide each is, the common
/// interval (the envelope alone where they contradict each other).
fn shrink(seen: f64, seen_range: Interval, prior: Interval) -> (f64, Interval) {
    let (p, s) = (prior.radius().powi(2), seen_range.radius().powi(2));
    let common = seen_range.intersect(prior).unwrap_or(prior);
    let weight = if p + s > 0.0 && s.is_finite() { p / (p + s) } else { 0.0 };
    ((seen * weight).clamp(common.lo(), common.hi()), common)
}

/// Half-width of the symmetric interval about `x` that holds `range`.
fn reach(range: Interval, x: f64) -> f64 {
    (range.hi() - x).max(x - range.lo()).max(0.0).next_up()
}
