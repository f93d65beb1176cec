use crate::sets::Interval;
use crate::signal::{Actuation, Imu};
use crate::vehicle::Vehicle;
use nalgebra::{UnitQuaternion, Vector3};

/// The residual force, body FRD, N, and the half-widths of its interval (infinite where nothing is claimed).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceInterval {
    pub value_frd_n: Vector3<f64>,
    pub half_width_frd_n: Vector3<f64>,
}

/// What the wind is computed from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flow {
    pub imu: Imu,
    pub body_to_ned: UnitQuaternion<f64>,
    /// How far the heading in it may be off, rad.
    pub yaw_rad: f64,
    pub velocity_ned_mps: Vector3<f64>,
    /// North and east of a GNSS receiver's own velocity, when a new fix came with this measurement.
    pub gnss_velocity_mps: Option<[f64; 2]>,
    pub actuation: Actuation,
    /// kg/m³.
    pub density_kgm3: f64,
    /// A bound on the residual force from elsewhere, when its assumptions hold as far as one can tell.
    pub force: Option<ForceInterval>,
}

/// What one measurement says of the wind, NED, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    pub value: Vector3<f64>,
    pub range: [Interval; 3],
    /// Standard deviation that the declared noise of one sample means for each component: a third of its bound.
    pub noise_mps: Vector3<f64>,
}

/// Below this cosine of the lean angle the horizontal wind can't be told from the body's lateral airspeed.
const MIN_UPRIGHT: f64 = 0.3;
/// Share by which the inflow law may be off.
const INFLOW_SHARE: f64 = 0.2;
/// A declared bound is taken as this many standard deviations.
const BOUND_IN_SIGMAS: f64 = 3.0;

/// Airspeed along one body axis: the likeliest, its interval, and force over airspeed there (N per m/s).
#[derive(Debug, Clone, Copy)]
struct Along {
    value: f64,
    range: Interval,
    slope: f64,
}

impl Instant {
    /// Wind from one measurement. `None` when no drag coefficient is known, or the vehicle is on its side.
    ///
    /// The lateral body axes give two airspeeds. The third is taken so that the vertical wind is what the vertical drag
    /// says, shrunk towards zero by the declared envelope: in hover the vertical drag law is flat around zero and
    /// thrust error dominates, so without the envelope it would say next to nothing.
    ///
    /// `shift` is what velocity is likely to lack, north and east, m/s; it moves the value and not the interval.
    pub fn of(vehicle: &Vehicle, flow: &Flow, shift: [f64; 2]) -> Option<Self> {
        let r = flow.body_to_ned.to_rotation_matrix().into_inner();
        if r[(2, 2)] < MIN_UPRIGHT {
            return None;
        }
        let (x, y) = (lateral(vehicle, flow, 0)?, lateral(vehicle, flow, 1)?);
        let noise = &vehicle.noise;
        let v = &flow.velocity_ned_mps;
        let v_range = |i: usize| Interval::centred(v[i], noise.velocity_mps[i]);
        let prior = Interval::centred(0.0, vehicle.envelope.vertical_wind_mps);
        let (down, down_range, down_noise) = match vertical(vehicle, flow) {
            Some(z) => {
                let seen = v[2] - r[(2, 0)] * x.value - r[(2, 1)] * y.value - r[(2, 2)] * z.value;
                let across = x.range * r[(2, 0)] + y.range * r[(2, 1)];
                let (value, range) = shrink(seen, v_range(2) - across - z.range * r[(2, 2)], prior);
                (value, range, accel_sigma(vehicle, 2) / z.slope)
            }
            None => (0.0, prior, 0.0),
        };
        // v_air,z follows from the vertical wind; substituted, the horizontal wind is linear in x, y, v and that wind
        let mut out = Self { value: Vector3::zeros(), range: [prior; 3], noise_mps: Vector3::zeros() };
        let across = (r[(0, 0)] * x.value + r[(0, 1)] * y.value).hypot(r[(1, 0)] * x.value + r[(1, 1)] * y.value);
        let climb = (v[2] - down).abs();
        for i in 0..2 {
            let cz = r[(i, 2)] / r[(2, 2)];
            let cx = r[(i, 0)] - cz * r[(2, 0)];
            let cy = r[(i, 1)] - cz * r[(2, 1)];
            out.value[i] = v[i] + shift[i] - cx * x.value - cy * y.value - cz * (v[2] - down);
            // a small rotation of R moves R·v_air by the angle times the part of v_air across it
            let turned = flow.yaw_rad * across + noise.tilt_rad * (climb + cz.abs() * across);
            let range = v_range(i) - x.range * cx - y.range * cy - (v_range(2) - down_range) * cz;
            out.range[i] = range + Interval::centred(0.0, turned);
            out.value[i] = out.value[i].max(out.range[i].lo()).min(out.range[i].hi());
            let felt = (cx * accel_sigma(vehicle, 0) / x.slope).hypot(cy * accel_sigma(vehicle, 1) / y.slope);
            out.noise_mps[i] = felt.hypot(noise.velocity_mps[i] / BOUND_IN_SIGMAS);
        }
        out.value[2] = down;
        out.range[2] = down_range.hull(Interval::point(down));
        // the envelope damps noise as it damps the value
        let trusted = down_range.radius() / (down_range.radius() + prior.radius()).max(f64::MIN_POSITIVE);
        out.noise_mps[2] = (1.0 - trusted) * down_noise.hypot(noise.velocity_mps[2] / BOUND_IN_SIGMAS);
        Some(out)
    }
}

/// Standard deviation of the force on a body axis that one accelerometer sample shows, N.
fn accel_sigma(vehicle: &Vehicle, i: usize) -> f64 {
    vehicle.mass_kg.nominal * vehicle.noise.accel_mps2[i] / BOUND_IN_SIGMAS
}

/// Across the thrust axis the accelerometer holds drag directly: m·a − f, with f nearly nothing.
fn lateral(vehicle: &Vehicle, flow: &Flow, i: usize) -> Option<Along> {
    let act = &flow.actuation;
    let (a, f) = (flow.imu.accel_frd_mps2[i], act.force_frd_n[i]);
    let thrust = Interval::centred(f, (vehicle.thrust_share() + act.doubt) * f.abs());
    let mut range = accelerometer(vehicle, a, i) * vehicle.mass_kg.range - thrust;
    if let Some(force) = &flow.force {
        let other = Interval::centred(force.value_frd_n[i], force.half_width_frd_n[i]);
        range = range.intersect(other).unwrap_or(range);
    }
    invert(vehicle, flow, i, vehicle.mass_kg.nominal * a - f, range, 0.0)
}

/// Along the thrust axis drag is what the balance of thrust leaves. The thrust lost to inflow is given back first and
/// acts as drag of that direction: it depends on the very airspeed that is sought.
fn vertical(vehicle: &Vehicle, flow: &Flow) -> Option<Along> {
    let act = &flow.actuation;
    let a = flow.imu.accel_frd_mps2.z;
    let still = act.force_frd_n.z - act.inflow_n_per_mps2 * act.climb_mps.max(0.0).powi(2);
    let thrust = Interval::centred(still, (vehicle.thrust_share() + act.doubt) * still.abs());
    let range = accelerometer(vehicle, a, 2) * vehicle.mass_kg.range - thrust;
    invert(vehicle, flow, 2, vehicle.mass_kg.nominal * a - still, range, act.inflow_n_per_mps2)
}

fn accelerometer(vehicle: &Vehicle, a: f64, i: usize) -> Interval {
    let noise = &vehicle.noise;
    Interval::centred(a, noise.accel_mps2[i] + noise.accel_bias_mps2[i])
}

fn invert(vehicle: &Vehicle, flow: &Flow, i: usize, force: f64, range: Interval, back: f64) -> Option<Along> {
    let (drag, sum) = (&vehicle.drag, flow.actuation.sum_sqrt_thrust);
    let value = drag.airspeed(i, force, sum, flow.density_kgm3, back)?;
    // the square root halves the thrust's own error
    let share = 0.5 * (vehicle.thrust_share() + flow.actuation.doubt);
    let rho = Interval::centred(flow.density_kgm3, flow.density_kgm3 * vehicle.noise.density);
    let back = Interval::centred(back, back * INFLOW_SHARE);
    let range = drag.airspeed_interval(i, range, Interval::centred(sum, sum * share), rho, back)?;
    let linear = drag.linear[i].nominal + drag.rotor[i].nominal * sum;
    let slope = linear + flow.density_kgm3 * drag.area_m2[i].nominal * value.abs();
    Some(Along { value, range: range.hull(Interval::point(value)), slope: slope.max(1e-6) })
}

/// Joins what the vertical drag says with the declared envelope: the value shrunk by how wide each is, the common
/// interval (the envelope alone where they contradict each other).
fn shrink(seen: f64, seen_range: Interval, prior: Interval) -> (f64, Interval) {
    let (p, s) = (prior.radius().powi(2), seen_range.radius().powi(2));
    let common = seen_range.intersect(prior).unwrap_or(prior);
    let weight = if p + s > 0.0 && s.is_finite() { p / (p + s) } else { 0.0 };
    ((seen * weight).clamp(common.lo(), common.hi()), common)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{MAX_ROTORS, RotorCommands};
    use crate::vehicle::{GRAVITY_MPS2, resolve};
    use proptest::prelude::*;

    proptest! {
        /// A vehicle out of the declared ranges in any wind within the envelope, measured with errors at the declared
        /// bounds: the wind lies in the interval of every single measurement.
        #[test]
        fn the_wind_lies_in_the_interval(
            wind in prop::array::uniform3(-1.0..1.0_f64), angles in prop::array::uniform3(-1.0..1.0_f64),
            v in prop::array::uniform3(-5.0..5.0_f64), s in prop::array::uniform12(-1.0..=1.0_f64),
        ) {
            let vehicle = resolve("arducopter-sitl").unwrap();
            let at = |r: crate::vehicle::Ranged, s: f64| r.nominal + s * (r.range.hi() - r.nominal).min(r.nominal - r.range.lo());
            let q = UnitQuaternion::from_euler_angles(0.3 * angles[0], 0.3 * angles[1], 3.1 * angles[2]);
            let wind = Vector3::new(9.0 * wind[0], 9.0 * wind[1], vehicle.envelope.vertical_wind_mps * wind[2]);
            let velocity = Vector3::from(v);
            let air = q.inverse() * (velocity - wind);
            let mut real = vehicle.clone();
            for i in 0..3 {
                real.drag.rotor[i].nominal = at(vehicle.drag.rotor[i], s[0]);
                real.drag.area_m2[i].nominal = at(vehicle.drag.area_m2[i], s[1]);
            }
            let mass = at(vehicle.mass_kg, s[2]);
            let thrust_share = vehicle.thrust_share() * s[3];
            let (inflow, lift) = (0.0506, 30.0);
            let loss = |climb: f64| inflow * climb.max(0.0).powi(2);
            let real_lift = lift * (1.0 + thrust_share) - loss(-air.z);
            let sum = 4.0 * (lift / 4.0_f64).sqrt();
            let drag = Vector3::from_fn(|i, _| real.drag.force(i, air[i], sum, 1.157));
            let specific = (drag - Vector3::z() * real_lift) / mass;
            let n = vehicle.noise;
            let error = Vector3::from_fn(|i, _| (n.accel_mps2[i] + n.accel_bias_mps2[i]) * s[4 + i]);
            let seen_velocity = velocity + Vector3::from_fn(|i, _| n.velocity_mps[i] * s[7 + i]);
            let turn = UnitQuaternion::from_euler_angles(0.0, 0.0, 0.99 * n.yaw_rad * s[10]);
            let tilt = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.99 * n.tilt_rad * s[11]);
            let climb = -(q.inverse() * seen_velocity).z;
            let flow = Flow {
                imu: Imu { accel_frd_mps2: specific + error, rate_frd_rads: Vector3::zeros() },
                body_to_ned: turn * tilt * q,
                yaw_rad: n.yaw_rad,
                velocity_ned_mps: seen_velocity,
                gnss_velocity_mps: None,
                actuation: Actuation {
                    rotors: RotorCommands { command: [0.5; MAX_ROTORS], count: 4 },
                    force_frd_n: -Vector3::z() * (lift - loss(climb)),
                    torque_frd_nm: Vector3::zeros(),
                    sum_sqrt_thrust: sum,
                    inflow_n_per_mps2: inflow,
                    doubt: 0.0,
                    climb_mps: climb,
                },
                density_kgm3: 1.157,
                force: None,
            };
            let seen = Instant::of(&vehicle, &flow, [0.0; 2]).unwrap();
            // the angle's second order, of 9 m/s
            let slack = 9.0 * (n.yaw_rad + n.tilt_rad).powi(2);
            for i in 0..3 {
                let range = seen.range[i] + Interval::centred(0.0, slack);
                prop_assert!(range.contains(wind[i]), "{i}: {} {:?}", wind[i], seen);
            }
        }
    }

    #[test]
    fn on_its_side_or_without_drag_nothing_is_said() {
        let mut vehicle = resolve("arducopter-sitl").unwrap();
        let mut flow = Flow {
            imu: Imu { accel_frd_mps2: -Vector3::z() * GRAVITY_MPS2, rate_frd_rads: Vector3::zeros() },
            body_to_ned: UnitQuaternion::from_euler_angles(1.5, 0.0, 0.0),
            yaw_rad: 0.0,
            velocity_ned_mps: Vector3::zeros(),
            gnss_velocity_mps: None,
            actuation: Actuation {
                rotors: RotorCommands { command: [0.5; MAX_ROTORS], count: 4 },
                force_frd_n: -Vector3::z() * 29.42,
                torque_frd_nm: Vector3::zeros(),
                sum_sqrt_thrust: 10.8,
                inflow_n_per_mps2: 0.0,
                doubt: 0.0,
                climb_mps: 0.0,
            },
            density_kgm3: 1.157,
            force: None,
        };
        assert!(Instant::of(&vehicle, &flow, [0.0; 2]).is_none());
        flow.body_to_ned = UnitQuaternion::identity();
        assert!(Instant::of(&vehicle, &flow, [0.0; 2]).unwrap().value.norm() < 0.05);
        for i in 0..2 {
            vehicle.drag.rotor[i] = crate::vehicle::Ranged::exact(0.0);
            vehicle.drag.area_m2[i] = crate::vehicle::Ranged::exact(0.0);
        }
        assert!(Instant::of(&vehicle, &flow, [0.0; 2]).is_none());
    }
}
