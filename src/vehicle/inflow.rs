use super::Vehicle;
use crate::sets::Interval;
use nalgebra::{Matrix3, Vector3};

/// Speed through the air along the thrust axis, climbing > 0, m/s: the likeliest, and what it can be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Climb {
    pub likely_mps: f64,
    pub range: Interval,
}

/// What the climb through the air is found from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flying {
    /// Body FRD to world NED.
    pub rotation: Matrix3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    /// What the accelerometer shows of the force across the thrust axis, body x and y, N, and how far off it may be.
    pub lateral_n: [f64; 2],
    pub lateral_half_width_n: [f64; 2],
    /// Σ√Tᵢ over the rotors' thrusts, √N.
    pub sum_sqrt_thrust: f64,
    /// kg/m³.
    pub density_kgm3: f64,
}

/// Below this cosine of the lean the vertical says nothing about the thrust axis.
const MIN_UPRIGHT: f64 = 0.3;
/// Horizontal wind where no drag law tells it, m/s.
const UNKNOWN_WIND_MPS: f64 = 15.0;

impl Vehicle {
    /// Speed through the air along body −z. A leaning vehicle flies through a horizontal wind along that axis too, and
    /// its rotors lose thrust to it: what drag on body x and y tells of the wind, the vertical wind's declared interval
    /// and the velocity over ground give the third component.
    ///
    /// The range holds whether the lateral force is air or something else: it reaches from the climb that all air
    /// would mean to the climb over still air.
    pub fn climb_through_air(&self, f: &Flying) -> Climb {
        let r = &f.rotation;
        let over_ground = -r.tr_mul(&f.velocity_ned_mps).z;
        let upright = r[(2, 2)];
        let noise = &self.noise;
        let vertical = self.envelope.vertical_wind_mps;
        if upright < MIN_UPRIGHT {
            let reach = UNKNOWN_WIND_MPS + vertical;
            return Climb { likely_mps: over_ground, range: Interval::centred(over_ground, reach) };
        }
        let sum = Interval::point(f.sum_sqrt_thrust);
        let density = Interval::centred(f.density_kgm3, f.density_kgm3 * noise.density);
        let along = |i: usize| -> Option<(f64, Interval)> {
            let likely = self.drag.airspeed(i, f.lateral_n[i], f.sum_sqrt_thrust, f.density_kgm3, 0.0)?;
            let force = Interval::centred(f.lateral_n[i], f.lateral_half_width_n[i]);
            let range = self.drag.airspeed_interval(i, force, sum, density, Interval::point(0.0))?;
            Some((likely, range))
        };
        let unknown = (0.0, Interval::centred(0.0, UNKNOWN_WIND_MPS + f.velocity_ned_mps.norm()));
        let (x, x_range) = along(0).unwrap_or(unknown);
        let (y, y_range) = along(1).unwrap_or(unknown);
        // v_d − w_d = R₂₀·x + R₂₁·y + R₂₂·z
        let likely = -(f.velocity_ned_mps.z - r[(2, 0)] * x - r[(2, 1)] * y) / upright;
        let down = Interval::centred(f.velocity_ned_mps.z, noise.velocity_mps[2] + vertical);
        let air = -(down - x_range * r[(2, 0)] - y_range * r[(2, 1)]) * (1.0 / upright);
        let still = Interval::centred(over_ground, noise.velocity_mps[2] + vertical);
        // turning the airspeed by a small angle moves its part along the thrust axis by as much of the part across it
        let turned = Interval::centred(0.0, noise.tilt_rad * x_range.mag().hypot(y_range.mag()));
        Climb { likely_mps: likely, range: air.hull(still) + turned }
    }

    /// Share by which thrust may differ from the model's at the same command: the declared range of full thrust.
    pub fn thrust_share(&self) -> f64 {
        let n = self.thrust.max_n;
        (n.range.hi() - n.nominal).max(n.nominal - n.range.lo()) / n.nominal.max(f64::MIN_POSITIVE)
    }

    /// Share by which mass may differ from the nominal.
    pub fn mass_share(&self) -> f64 {
        let m = self.mass_kg;
        (m.range.hi() - m.nominal).max(m.nominal - m.range.lo()) / m.nominal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::resolve;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the wind within the envelope, the true climb through the air lies in the range; without vertical
        /// wind it is the likely one.
        #[test]
        fn the_true_climb_lies_in_the_range(
            wind in prop::array::uniform3(-1.0..1.0_f64), angles in prop::array::uniform3(-0.5..0.5_f64),
            v in prop::array::uniform3(-5.0..5.0_f64), s in prop::array::uniform2(-1.0..1.0_f64),
        ) {
            let vehicle = resolve("arducopter-sitl").unwrap();
            let q = UnitQuaternion::from_euler_angles(angles[0], angles[1], 6.0 * angles[2]);
            let velocity_ned_mps = Vector3::from(v);
            let wind = Vector3::new(10.0 * wind[0], 10.0 * wind[1], wind[2]);
            let air = q.inverse() * (velocity_ned_mps - wind);
            let lateral = [0, 1].map(|i| vehicle.drag.force(i, air[i], 10.8, 1.157));
            let half = [0.3; 2];
            let climb = vehicle.climb_through_air(&Flying {
                rotation: q.to_rotation_matrix().into_inner(),
                velocity_ned_mps,
                lateral_n: [0, 1].map(|i| lateral[i] + half[i] * s[i]),
                lateral_half_width_n: half,
                sum_sqrt_thrust: 10.8,
                density_kgm3: 1.157,
            });
            prop_assert!(climb.range.contains(-air.z), "{} {climb:?}", -air.z);
            prop_assert!(climb.range.contains(climb.likely_mps));
        }
    }

    #[test]
    fn a_lean_into_the_wind_climbs_through_it() {
        let vehicle = resolve("arducopter-sitl").unwrap();
        // hovering nose down into 8 m/s from the north
        let q = UnitQuaternion::from_euler_angles(0.0, -0.2, 0.0);
        let air = q.inverse() * Vector3::new(8.0, 0.0, 0.0);
        let climb = vehicle.climb_through_air(&Flying {
            rotation: q.to_rotation_matrix().into_inner(),
            velocity_ned_mps: Vector3::zeros(),
            lateral_n: [0, 1].map(|i| vehicle.drag.force(i, air[i], 10.8, 1.157)),
            lateral_half_width_n: [0.3; 2],
            sum_sqrt_thrust: 10.8,
            density_kgm3: 1.157,
        });
        assert!((climb.likely_mps + air.z).abs() < 1e-9 && climb.likely_mps.abs() > 1.5);
        assert!(climb.range.contains(0.0), "still air and a push are possible too");
    }
}
