use crate::signal::{Actuation, Measurement};
use crate::vehicle::{Flying, SEA_LEVEL_KGM3, Vehicle};
use nalgebra::{Matrix3, Vector3};

/// Share by which the inflow law itself may be off.
const INFLOW_SHARE: f64 = 0.2;

/// How the rotors' force along body z differs from what was modelled over still air.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ThrustLaw {
    /// To be added to the modelled force, body z, N: thrust lost to the likely climb through the air, less what was
    /// reckoned as lost to the climb over ground.
    pub correction_n: f64,
    /// By how much the force may still be off along body z, N: range of full thrust, mass, unknown voltage or density,
    /// and the climb through the air.
    pub half_width_n: f64,
}

impl ThrustLaw {
    pub fn of(
        vehicle: &Vehicle,
        m: &Measurement,
        rotation: &Matrix3<f64>,
        velocity_ned_mps: Vector3<f64>,
        actuation: &Actuation,
    ) -> Self {
        let force = actuation.force_frd_n;
        let share = vehicle.thrust_share() + vehicle.mass_share() + actuation.doubt;
        let inflow = actuation.inflow_n_per_mps2;
        if inflow == 0.0 {
            return Self { correction_n: 0.0, half_width_n: share * force.norm() };
        }
        let (mass, noise) = (&vehicle.mass_kg, &vehicle.noise);
        let lateral = [0, 1].map(|i| mass.nominal * m.imu.accel_frd_mps2[i] - force[i]);
        let lateral_half_width_n = [0, 1].map(|i| {
            mass.range.hi() * (noise.accel_mps2[i] + noise.accel_bias_mps2[i])
                + vehicle.mass_share() * lateral[i].abs()
                + share * force[i].abs()
        });
        let density = m.air_density_kgm3.map(|d| d.value).or(vehicle.thrust.density_ref_kgm3);
        let climb = vehicle.climb_through_air(&Flying {
            rotation: *rotation,
            velocity_ned_mps,
            lateral_n: lateral,
            lateral_half_width_n,
            sum_sqrt_thrust: actuation.sum_sqrt_thrust,
            density_kgm3: density.unwrap_or(SEA_LEVEL_KGM3),
        });
        // only air that comes from above takes thrust
        let lost = |climb: f64| inflow * climb.max(0.0).powi(2);
        let likely = lost(climb.likely_mps);
        let (least, most) = (lost(climb.range.lo()), lost(climb.range.hi()));
        let spread = (most * (1.0 + INFLOW_SHARE) - likely).max(likely - least * (1.0 - INFLOW_SHARE));
        Self { correction_n: likely - lost(actuation.climb_mps), half_width_n: share * force.norm() + spread }
    }
}
