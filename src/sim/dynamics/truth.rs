use crate::signal::{MAX_ROTORS, Stamp};
use nalgebra::{UnitQuaternion, Vector3};

/// What really happens at one instant, in the terms the observers are judged by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    pub stamp: Stamp,
    /// Of the body's origin, as are velocity and acceleration.
    pub position_ned_m: Vector3<f64>,
    pub velocity_ned_mps: Vector3<f64>,
    pub acceleration_ned_mps2: Vector3<f64>,
    pub body_to_ned: UnitQuaternion<f64>,
    pub rate_frd_rads: Vector3<f64>,
    pub angular_acceleration_frd_rads2: Vector3<f64>,
    /// What a perfect accelerometer at the body's origin reads.
    pub specific_force_frd_mps2: Vector3<f64>,
    /// Velocity of the air over ground (towards).
    pub wind_ned_mps: Vector3<f64>,
    /// Velocity of the vehicle through the air.
    pub air_velocity_frd_mps: Vector3<f64>,
    /// m(a − g) − R·f, with mass and rotor force f of the observers' model at the commands given: everything that
    /// model does not explain. Drag, contact, pushes, weak rotors and wrong mass are all in it.
    pub residual_force_ned_n: Vector3<f64>,
    /// Jω̇ + ω×Jω − τ, with inertia and rotor torque of the observers' model.
    pub residual_torque_frd_nm: Vector3<f64>,
    /// Commands in force over the last step, after the transport delay.
    pub commands: [f64; MAX_ROTORS],
    /// Commands that the rotors have reached.
    pub rotors: [f64; MAX_ROTORS],
    pub rotor_speed_rads: [f64; MAX_ROTORS],
    pub rotor_count: usize,
    /// Of all that flies, and by how much that is more than the observers' model of the empty vehicle.
    pub mass_kg: f64,
    pub payload_kg: f64,
    pub voltage_v: f64,
    pub current_a: f64,
    /// Share of the charge.
    pub battery_left: f64,
    pub density_kgm3: f64,
    pub pressure_pa: f64,
    pub on_ground: bool,
}
