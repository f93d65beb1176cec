//! The vehicles that come with the program, as the very files a user can copy and edit.

macro_rules! preset {
    ($name:literal) => {
        ($name, include_str!(concat!("../../config/vehicles/", $name, ".toml")))
    };
}

const PRESETS: [(&str, &str); 7] = [
    preset!("arducopter-sitl"),
    preset!("px4-sih"),
    preset!("px4-x500"),
    preset!("arducopter-hexa"),
    preset!("cayero-hummingbird"),
    preset!("quanser-3dof"),
    preset!("pham-quadrotor"),
];

/// The names that [`super::resolve`] knows.
pub fn names() -> impl Iterator<Item = &'static str> {
    PRESETS.iter().map(|(name, _)| *name)
}

/// The TOML text of a preset.
pub fn text(name: &str) -> Option<&'static str> {
    PRESETS.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::{MAX_ROTORS, RotorCommands};
    use crate::vehicle::{Air, Vehicle, Wrench, resolve};

    const STILL_AIR: Air = Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 };

    fn wrench(vehicle: &Vehicle, u: [f64; 4]) -> Wrench {
        let mut commands = RotorCommands { command: [0.0; MAX_ROTORS], count: 4 };
        commands.command[..4].copy_from_slice(&u);
        vehicle.rotor_wrench(&commands, STILL_AIR).0
    }

    #[test]
    fn every_preset_is_a_valid_vehicle() {
        for name in names() {
            let vehicle = resolve(name).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!(vehicle.rotors.len(), if name.ends_with("hexa") { 6 } else { 4 }, "{name}");
        }
    }

    #[test]
    fn arducopter_hovers_at_39_percent_thrust() {
        let v = resolve("arducopter-sitl").unwrap();
        // 0.35c + 0.65c² = 0.39
        let c = (-0.35 + (0.35_f64.powi(2) + 4.0 * 0.65 * 0.39).sqrt()) / 1.3;
        let w = wrench(&v, [c; 4]);
        assert!((w.force_frd_n.z + 3.0 * 9.80665).abs() < 0.01, "{}", w.force_frd_n.z);
        assert!(w.torque_frd_nm.norm() < 1e-9);
        // rotor drag in hover: 0.241·m N per m/s
        let sum_sqrt = 4.0 * (3.0 * 9.80665 / 4.0_f64).sqrt();
        assert!((v.drag.rotor[0].nominal * sum_sqrt - 0.241 * 3.0).abs() < 1e-3);
    }

    #[test]
    fn the_hexarotor_hovers_and_turns_like_the_quad_it_is_made_from() {
        let v = resolve("arducopter-hexa").unwrap();
        let c = (-0.35 + (0.35_f64.powi(2) + 4.0 * 0.65 * 0.39).sqrt()) / 1.3;
        let (w, sum_sqrt) = v.rotor_wrench(&RotorCommands { command: [c; MAX_ROTORS], count: 6 }, STILL_AIR);
        assert!((w.force_frd_n.z + 3.0 * 9.80665).abs() < 0.01 && w.torque_frd_nm.norm() < 1e-9);
        assert!((v.drag.rotor[0].nominal * sum_sqrt - 0.241 * 3.0).abs() < 1e-3);
        // motors 1 and 2 are right and left, 3 and 5 in front, 4 and 6 behind; 1, 3 and 6 turn clockwise
        let alone = |motor: usize| {
            let mut commands = RotorCommands { command: [0.0; MAX_ROTORS], count: 6 };
            commands.command[motor - 1] = 1.0;
            v.rotor_wrench(&commands, STILL_AIR).0.torque_frd_nm
        };
        let signs = |motor| alone(motor).map(|t| if t.abs() < 1e-9 { 0.0 } else { t.signum() });
        let expected = [
            [-1.0, 0.0, -1.0],
            [1.0, 0.0, 1.0],
            [1.0, 1.0, -1.0],
            [-1.0, -1.0, 1.0],
            [-1.0, 1.0, 1.0],
            [1.0, -1.0, -1.0],
        ];
        for (motor, expected) in (1..=6).zip(expected) {
            assert_eq!(<[f64; 3]>::from(signs(motor)), expected, "motor {motor}");
        }
    }

    #[test]
    fn px4_sih_turns_as_its_mixer_says() {
        let v = resolve("px4-sih").unwrap();
        let [u1, u2, u3, u4] = [0.3, 0.5, 0.4, 0.9];
        let t = wrench(&v, [u1, u2, u3, u4]).torque_frd_nm;
        assert!((t.x - 0.2 * 5.0 * (-u1 + u2 + u3 - u4)).abs() < 1e-12);
        assert!((t.y - 0.2 * 5.0 * (u1 - u2 + u3 - u4)).abs() < 1e-12);
        assert!((t.z - 0.1 * (u1 + u2 - u3 - u4)).abs() < 1e-12);
    }

    #[test]
    fn the_rigs_turn_as_their_papers_say() {
        // Pitarch & Sala (3) on squared voltages
        let v = resolve("quanser-3dof").unwrap();
        let q = [0.3_f64, 0.5, 0.4, 0.9];
        let [v1, v2, v3, v4] = q.map(|c| (54.945 * 10.0 * c).powi(2));
        let (b, d, l) = (3.9351e-6, 1.1925e-7, 0.1969);
        let t = wrench(&v, q).torque_frd_nm;
        let expected = [b * l * (v2 - v4), b * l * (v3 - v1), d * (v1 - v2 + v3 - v4)];
        for (got, want) in t.iter().zip(expected) {
            assert!((got - want).abs() < 1e-4, "{got} {want}");
        }
        // Pham et al. (25) on squared speeds, with the arm that (33) adds
        let v = resolve("pham-quadrotor").unwrap();
        let [w1, w2, w3, w4] = q.map(|c| (500.0 * c).powi(2));
        let (b, d, l) = (7.73213e-6, 1.27513e-7, 0.23);
        let t = wrench(&v, q).torque_frd_nm;
        let expected = [l * b * (w4 - w2), l * b * (w3 - w1), d * (w1 - w2 + w3 - w4)];
        for (got, want) in t.iter().zip(expected) {
            assert!((got - want).abs() < 1e-4, "{got} {want}");
        }
    }
}
