use super::{Air, GRAVITY_MPS2, Vehicle};
use crate::signal::{MAX_ROTORS, RotorCommands};
use nalgebra::Vector3;

/// What a person wants to know of a vehicle before trusting its model. Everything at reference voltage and density.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Facts {
    pub weight_n: f64,
    /// Upward thrust of all rotors at full command, N.
    pub max_thrust_n: f64,
    /// Weight over full thrust; above 1 the vehicle cannot hover.
    pub hover_thrust_share: f64,
    /// The command (0..1) at which equal rotors carry the weight; `None` when they cannot.
    pub hover_command: Option<f64>,
    /// The same on the scale of the actuator message (µs or what the vehicle file says).
    pub hover_output: Option<f64>,
    /// Largest torque about each body axis that the rotors can give, N m.
    pub max_torque_nm: [f64; 3],
    /// Drag at 1 m/s through the air along each body axis in hover, N; 0 where wind cannot be told from force.
    pub drag_at_1_mps_n: [f64; 3],
    /// Wind along each body axis that 1 N stands for in hover, m/s; `None` where there is no drag.
    pub wind_per_newton_mps: [Option<f64>; 3],
}

impl Vehicle {
    /// Derives the [`Facts`] of this vehicle.
    pub fn facts(&self) -> Facts {
        let air = Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 };
        let density = self.thrust.density_ref_kgm3.unwrap_or(1.225);
        let weight_n = self.mass_kg.nominal * GRAVITY_MPS2;
        let lift = |c: f64| {
            let commands = RotorCommands { command: [c; MAX_ROTORS], count: self.rotors.len() };
            let (wrench, sum_sqrt) = self.rotor_wrench(&commands, air);
            (-wrench.force_frd_n.z, sum_sqrt)
        };
        let (max_thrust_n, sum_sqrt_full) = lift(1.0);
        let hover_command = (max_thrust_n >= weight_n).then(|| bisect(|c| lift(c).0 - weight_n));
        let sum_sqrt = hover_command.map_or(sum_sqrt_full, |c| lift(c).1);
        let drag_at_1_mps_n = [0, 1, 2].map(|i| -self.drag.force(i, 1.0, sum_sqrt, density));
        Facts {
            weight_n,
            max_thrust_n,
            hover_thrust_share: weight_n / max_thrust_n,
            hover_command,
            hover_output: hover_command
                .map(|c| self.actuators.at_zero + c * (self.actuators.at_full - self.actuators.at_zero)),
            max_torque_nm: self.max_torque_nm(),
            drag_at_1_mps_n,
            wind_per_newton_mps: [0, 1, 2].map(|i| self.drag.airspeed(i, 1.0, sum_sqrt, density, 0.0).map(f64::abs)),
        }
    }

    /// Each rotor adds either nothing or its full torque about an axis: the larger of the two one-sided sums.
    fn max_torque_nm(&self) -> [f64; 3] {
        let full = self.thrust.max_n.nominal;
        let (mut up, mut down) = (Vector3::zeros(), Vector3::zeros());
        for rotor in &self.rotors {
            let reaction = -rotor.axis_frd * (rotor.spin.reaction_sign() * rotor.torque_ratio_m);
            let torque: Vector3<f64> = (rotor.position_frd_m.cross(&rotor.axis_frd) + reaction) * full;
            up += torque.map(|x| x.max(0.0));
            down += torque.map(|x| (-x).max(0.0));
        }
        up.sup(&down).into()
    }
}

/// The zero in 0..1 of a rising function that is negative at 0 and not at 1.
fn bisect(f: impl Fn(f64) -> f64) -> f64 {
    let (mut lo, mut hi) = (0.0, 1.0);
    // 60 halvings exhaust the precision of f64
    for _ in 0..60 {
        let middle = 0.5 * (lo + hi);
        if f(middle) < 0.0 { lo = middle } else { hi = middle }
    }
    hi
}

#[cfg(test)]
mod tests {
    use crate::vehicle::resolve;

    #[test]
    fn facts_of_the_arducopter_simulator() {
        let f = resolve("arducopter-sitl").unwrap().facts();
        assert!((f.hover_thrust_share - 0.39).abs() < 1e-3);
        // 0.35c + 0.65c² = 0.39
        assert!((f.hover_command.unwrap() - 0.5510).abs() < 1e-3, "{f:?}");
        // two rotors at 0.2475 m
        assert!((f.max_torque_nm[0] - 2.0 * 18.86 * 0.24749).abs() < 1e-3, "{f:?}");
        // 1 m/s in hover: .241·3 momentum drag + ½·1.157·.17433
        assert!((f.drag_at_1_mps_n[0] - 0.824).abs() < 1e-2, "{f:?}");
    }

    #[test]
    fn the_rig_cannot_hover_and_says_so() {
        let f = resolve("quanser-3dof").unwrap().facts();
        assert_eq!(f.hover_command, None);
        assert!(f.hover_thrust_share > 5.0);
        assert_eq!(f.wind_per_newton_mps, [None; 3]);
    }
}
