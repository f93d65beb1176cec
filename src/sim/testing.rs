//! Vehicles for this folder's tests, written out in code so that the tests stand alone.

use crate::vehicle::{
    Actuators, Drag, Envelope, NoiseBounds, OutputSource, Ranged, Rotor, RotorDynamics, Sensors, Spin, ThrustCurve,
    Vehicle,
};
use nalgebra::{Matrix3, Vector3};

/// A 3 kg quad-X close to ArduCopter's simulated one, with a lag and rotor inertia of its own.
pub(crate) fn quad() -> Vehicle {
    let a = 0.35 * std::f64::consts::FRAC_1_SQRT_2;
    let rotor = |output, x, y, spin| Rotor {
        position_frd_m: Vector3::new(x, y, 0.0),
        axis_frd: Vector3::new(0.0, 0.0, -1.0),
        spin,
        torque_ratio_m: 0.02,
        output,
    };
    Vehicle {
        name: "test quad".into(),
        mass_kg: Ranged::exact(3.0),
        inertia_kgm2: Matrix3::from_diagonal(&Vector3::new(0.02297, 0.02297, 0.04594)),
        inertia_uncertainty: 0.0,
        rotors: vec![
            rotor(0, a, a, Spin::Ccw),
            rotor(1, -a, -a, Spin::Ccw),
            rotor(2, a, -a, Spin::Cw),
            rotor(3, -a, a, Spin::Cw),
        ],
        thrust: ThrustCurve {
            max_n: Ranged::exact(18.9),
            expo: 0.65,
            voltage_ref_v: Some(12.6),
            density_ref_kgm3: Some(1.225),
            inflow_speed_mps: None,
        },
        dynamics: RotorDynamics { time_constant_s: 0.03, delay_s: 0.0, inertia_kgm2: 3e-5, max_speed_rads: 900.0 },
        drag: Drag {
            linear: [Ranged::exact(0.0); 3],
            rotor: [Ranged::exact(0.066), Ranged::exact(0.066), Ranged::exact(0.0)],
            area_m2: [Ranged::exact(0.17433); 3],
            angular: [0.0; 3],
        },
        actuators: Actuators { source: OutputSource::ServoOutputRaw, at_zero: 1150.0, at_full: 1950.0 },
        sensors: Sensors { accel_delay_s: 0.008, gyro_delay_s: 0.014, gnss_delay_s: 0.0 },
        noise: NoiseBounds {
            accel_mps2: [0.3; 3],
            accel_bias_mps2: [0.05; 3],
            gyro_rads: [0.02; 3],
            position_m: [2.0; 3],
            velocity_mps: [0.3; 3],
            velocity_bias_mps: [0.0; 3],
            tilt_bias_rad: 0.0,
            yaw_bias_rad: 0.0,
            tilt_rad: 0.02,
            yaw_rad: 0.05,
            density: 0.03,
        },
        envelope: Envelope {
            force_n: [20.0; 3],
            force_rate_nps: [40.0; 3],
            torque_nm: [1.0; 3],
            torque_rate_nmps: [4.0; 3],
            vertical_wind_mps: 1.0,
        },
    }
}

/// The same without air drag, gyroscopic terms or battery effects: a clean body for balance tests.
pub(crate) fn quad_in_vacuum() -> Vehicle {
    let mut v = quad();
    v.drag.rotor = [Ranged::exact(0.0); 3];
    v.drag.area_m2 = [Ranged::exact(0.0); 3];
    v.dynamics.inertia_kgm2 = 0.0;
    v.thrust.voltage_ref_v = None;
    v.thrust.density_ref_kgm3 = None;
    v
}

/// A hexa-X of the same mass.
pub(crate) fn hexa() -> Vehicle {
    let mut v = quad();
    let template = v.rotors[0];
    v.rotors = (0..6)
        .map(|i| {
            let angle = f64::from(i as u8) * std::f64::consts::FRAC_PI_3 + std::f64::consts::FRAC_PI_6;
            let spin = if i % 2 == 0 { Spin::Ccw } else { Spin::Cw };
            let position_frd_m = Vector3::new(angle.cos(), angle.sin(), 0.0) * 0.35;
            Rotor { position_frd_m, spin, output: i, ..template }
        })
        .collect();
    v.thrust.max_n = Ranged::exact(12.6);
    v
}
