use super::{ThrustCurve, Vehicle};
use crate::signal::{MAX_ROTORS, RotorCommands};
use nalgebra::Vector3;

/// Force (N) and torque (N m) on the centre of mass, body FRD.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    pub force_frd_n: Vector3<f64>,
    pub torque_frd_nm: Vector3<f64>,
}

/// What thrust depends on beside the command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Air {
    /// Battery voltage, V, when known.
    pub voltage_v: Option<f64>,
    /// kg/m³, when known.
    pub density_kgm3: Option<f64>,
    /// Speed of the vehicle through the air along its thrust axis (climbing > 0), m/s.
    pub climb_mps: f64,
}

impl ThrustCurve {
    /// Thrust of one rotor at `command` (0..1), N.
    pub fn thrust_n(&self, command: f64, air: Air) -> f64 {
        let c = command.clamp(0.0, 1.0);
        let shape = (1.0 - self.expo) * c + self.expo * c * c;
        let voltage = match (self.voltage_ref_v, air.voltage_v) {
            (Some(v_ref), Some(v)) => (v / v_ref).powi(2),
            _ => 1.0,
        };
        let density = self.density_ratio(air);
        let inflow = self.inflow_n_per_mps2(air) * air.climb_mps.max(0.0).powi(2);
        (self.max_n.nominal * density * voltage * shape - inflow).max(0.0)
    }

    /// Thrust that one rotor loses to inflow, over the square of the climb speed through the air, N per m²/s².
    pub fn inflow_n_per_mps2(&self, air: Air) -> f64 {
        self.inflow_speed_mps.map_or(0.0, |v_max| self.max_n.nominal * self.density_ratio(air) / (v_max * v_max))
    }

    /// Share by which thrust may be off because an input of the law is not known: a battery loses up to a third of a
    /// rotor's thrust between full and empty, air a fifth between sea level and 2000 m.
    pub fn doubt(&self, air: Air) -> f64 {
        let voltage = if self.voltage_ref_v.is_some() && air.voltage_v.is_none() { 0.35 } else { 0.0 };
        let density = if self.density_ref_kgm3.is_some() && air.density_kgm3.is_none() { 0.2 } else { 0.0 };
        voltage + density
    }

    fn density_ratio(&self, air: Air) -> f64 {
        match (self.density_ref_kgm3, air.density_kgm3) {
            (Some(rho_ref), Some(rho)) => rho / rho_ref,
            _ => 1.0,
        }
    }
}

/// The rotors of one vehicle, following their commands with a first-order lag. Keeps state; allocates nothing.
#[derive(Debug, Clone)]
pub struct RotorBank {
    state: [f64; MAX_ROTORS],
    started: bool,
}

impl Default for RotorBank {
    fn default() -> Self {
        Self::new()
    }
}

impl RotorBank {
    pub fn new() -> Self {
        Self { state: [0.0; MAX_ROTORS], started: false }
    }

    pub fn reset(&mut self) {
        *self = Self::new();
    }

    /// Moves the rotors by `dt_s` under a constant command and gives the mean effective command over that time.
    pub fn advance(&mut self, vehicle: &Vehicle, target: &RotorCommands, dt_s: f64) -> RotorCommands {
        let mut mean = *target;
        let tau = vehicle.dynamics.time_constant_s;
        for ((state, out), c) in self.state.iter_mut().zip(&mut mean.command).zip(target.command) {
            if !self.started || tau <= 0.0 || dt_s <= 0.0 {
                *state = c;
                continue;
            }
            // exact solution of τẋ = c − x over the step, and its mean
            let decay = (-dt_s / tau).exp();
            let start = *state;
            *state = c + (start - c) * decay;
            *out = c + (start - c) * tau / dt_s * (1.0 - decay);
        }
        self.started = true;
        mean
    }
}

impl Vehicle {
    /// Wrench of the rotors at given effective commands, and Σ√Tᵢ (√N), which scales rotor drag.
    pub fn rotor_wrench(&self, commands: &RotorCommands, air: Air) -> (Wrench, f64) {
        let mut w = Wrench::default();
        let mut sum_sqrt = 0.0;
        for (rotor, &c) in self.rotors.iter().zip(&commands.command) {
            let thrust = self.thrust.thrust_n(c, air);
            let force = rotor.axis_frd * thrust;
            // the reaction acts about the thrust axis: +z (down) for CCW when the axis points up
            let reaction = -rotor.axis_frd * (rotor.spin.reaction_sign() * rotor.torque_ratio_m * thrust);
            w.force_frd_n += force;
            w.torque_frd_nm += rotor.position_frd_m.cross(&force) + reaction;
            sum_sqrt += thrust.sqrt();
        }
        (w, sum_sqrt)
    }
}
