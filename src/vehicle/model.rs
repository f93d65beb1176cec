use crate::sets::Interval;
use nalgebra::{Matrix3, Vector3};

/// A number with the interval that is declared to hold its true value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranged {
    pub nominal: f64,
    pub range: Interval,
}

impl Ranged {
    /// A number known exactly.
    pub fn exact(x: f64) -> Self {
        Self { nominal: x, range: Interval::point(x) }
    }

    /// A number known to a share of its size, such as 0.05 for ±5 %.
    pub fn relative(x: f64, share: f64) -> Self {
        Self { nominal: x, range: Interval::centred(x, x.abs() * share) }
    }
}

/// A multirotor: what moves it, what resists it, what is measured how well, and what may act on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    pub name: String,
    pub mass_kg: Ranged,
    /// About the centre of mass, body FRD, kg m².
    pub inertia_kgm2: Matrix3<f64>,
    /// Share by which the true inertia may differ (0.05 = ±5 %).
    pub inertia_uncertainty: f64,
    pub rotors: Vec<Rotor>,
    pub thrust: ThrustCurve,
    pub dynamics: RotorDynamics,
    pub drag: Drag,
    pub actuators: Actuators,
    pub sensors: Sensors,
    pub noise: NoiseBounds,
    pub envelope: Envelope,
}

/// Direction of rotation seen from above.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Spin {
    /// Counter-clockwise: the reaction torque on the body is clockwise, positive about body z (down).
    Ccw,
    /// Clockwise: the reaction torque is negative about body z.
    Cw,
}

impl Spin {
    /// Sign of the reaction torque about body z.
    pub fn reaction_sign(self) -> f64 {
        match self {
            Self::Ccw => 1.0,
            Self::Cw => -1.0,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotor {
    /// From the centre of mass, body FRD, m.
    pub position_frd_m: Vector3<f64>,
    /// Direction of thrust, unit vector in body FRD: (0, 0, −1) pushes up.
    pub axis_frd: Vector3<f64>,
    pub spin: Spin,
    /// Reaction torque over thrust, m.
    pub torque_ratio_m: f64,
    /// Zero-based index into the actuator message's outputs.
    pub output: usize,
}

/// Thrust of one rotor: `T = max·(ρ/ρ_ref)·[(V/V_ref)²·((1−expo)c + expo·c²) − inflow]`, where `c` is the command
/// from 0 to 1, the voltage factor applies only when `voltage_ref_v` is given, and `inflow = (v_in/v_max)²` with
/// `v_in ≥ 0` the climb speed through the air along the thrust axis, applies only when `inflow_speed_mps` is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThrustCurve {
    /// Thrust of one rotor at full command, reference voltage and reference density, N.
    pub max_n: Ranged,
    /// 0 = linear in the command, 1 = quadratic.
    pub expo: f64,
    pub voltage_ref_v: Option<f64>,
    /// Reference air density, kg/m³; `None` when thrust does not depend on it.
    pub density_ref_kgm3: Option<f64>,
    /// Speed of the air leaving the rotor at full command (`v_max`), m/s.
    pub inflow_speed_mps: Option<f64>,
}

/// First-order lag and slew of a rotor's command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorDynamics {
    pub time_constant_s: f64,
    /// Transport delay from the actuator message's stamp to the rotor, s.
    pub delay_s: f64,
    /// Rotor inertia about its axis, kg m²; 0 when its gyroscopic effect is left out.
    pub inertia_kgm2: f64,
    /// Rotor speed at full command, rad/s (used with `inertia_kgm2`).
    pub max_speed_rads: f64,
}

/// Air drag against the velocity through the air `v` (body FRD, m/s), per axis:
/// `f = −(linear + rotor·Σ√Tᵢ)·v − ½ρ·area·v|v|`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drag {
    /// N per m/s.
    pub linear: [Ranged; 3],
    /// Momentum drag of the rotors, N per m/s and √N of thrust.
    pub rotor: [Ranged; 3],
    /// Drag coefficient times area, m².
    pub area_m2: [Ranged; 3],
    /// Angular damping, N m per rad/s.
    pub angular: [f64; 3],
}

/// Which message carries the rotor commands, and its scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Actuators {
    pub source: OutputSource,
    /// Output at which the rotor stands still (command 0), in the message's unit (µs or 1).
    pub at_zero: f64,
    /// Output at full command.
    pub at_full: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutputSource {
    /// ACTUATOR_OUTPUT_STATUS when it comes, else SERVO_OUTPUT_RAW.
    Auto,
    ServoOutputRaw,
    ActuatorOutputStatus,
    HilActuatorControls,
}

/// How far the sensors' stamps trail the truth, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensors {
    pub accel_delay_s: f64,
    pub gyro_delay_s: f64,
    /// By how much the stamp of a GNSS fix trails the instant it was true.
    pub gnss_delay_s: f64,
}

/// Half-widths within which each measured quantity is declared to lie of its true value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseBounds {
    /// Specific force, body FRD, m/s²: noise of one sample.
    pub accel_mps2: [f64; 3],
    /// Constant part of the above, m/s²: does not average out.
    pub accel_bias_mps2: [f64; 3],
    /// Body rate, rad/s: noise of one sample.
    pub gyro_rads: [f64; 3],
    /// Position, NED, m, from the origin that the vehicle itself uses.
    pub position_m: [f64; 3],
    /// Velocity, NED, m/s: noise of one sample.
    pub velocity_mps: [f64; 3],
    /// What the autopilot's velocity may be off for long beside that, NED, m/s.
    pub velocity_bias_mps: [f64; 3],
    /// Roll and pitch, rad: noise of one sample.
    pub tilt_rad: f64,
    /// What the autopilot's roll and pitch may be off for long beside that, rad.
    pub tilt_bias_rad: f64,
    /// Heading, rad.
    pub yaw_rad: f64,
    /// What the autopilot's heading may be off for long beside that, rad.
    pub yaw_bias_rad: f64,
    /// Air density, as a share.
    pub density: f64,
}

/// What may act on the vehicle: the sizes from which designs are made and bounds are reopened.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Envelope {
    /// Largest residual force, NED, N.
    pub force_n: [f64; 3],
    /// Largest rate of the residual force, N/s.
    pub force_rate_nps: [f64; 3],
    /// Largest residual torque, N m.
    pub torque_nm: [f64; 3],
    /// Largest rate of the residual torque, N m/s.
    pub torque_rate_nmps: [f64; 3],
    /// Largest vertical wind, m/s.
    pub vertical_wind_mps: f64,
}
