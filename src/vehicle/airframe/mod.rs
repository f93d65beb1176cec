//! Where the rotors sit, how they turn and what their commands mean, from the autopilot's own parameters.
//!
//! In: which autopilot, and a look-up of parameters by name. Out: an [`Airframe`], each part with its origin (a
//! parameter, or the autopilot's default because the parameter is not known), or a sentence that says why not.
//! No parameter of either autopilot tells mass, inertia or absolute thrust: those are measured or identified.

mod ardupilot;
mod compare;
mod px4;

pub use compare::differences;

use super::Spin;
use nalgebra::Vector2;

/// The autopilots whose parameters are understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Autopilot {
    ArduPilot,
    Px4,
}

impl Autopilot {
    /// From HEARTBEAT's MAV_AUTOPILOT.
    pub fn from_mav(autopilot: u8) -> Option<Self> {
        match autopilot {
            3 => Some(Self::ArduPilot),
            12 => Some(Self::Px4),
            _ => None,
        }
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::ArduPilot => "ArduPilot",
            Self::Px4 => "PX4",
        }
    }
}

/// One rotor: where it sits in the rotor plane, and what drives it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Forward and right of the centre, in units of the airframe's longest arm.
    pub forward_right: Vector2<f64>,
    pub spin: Spin,
    /// Zero-based index into the actuator message's outputs.
    pub output: usize,
}

/// How a command becomes thrust: `thrust ∝ (1 − expo)·c + expo·c²`, `c = (output − at_zero)/(at_full − at_zero)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curve {
    pub expo: f64,
    pub at_zero: f64,
    pub at_full: f64,
}

/// What is known of a vehicle before it has been measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Airframe {
    pub autopilot: Autopilot,
    pub places: Vec<Place>,
    /// Length of the longest arm, m, where the parameters tell it.
    pub arm_m: Option<f64>,
    pub curve: Curve,
    /// Where geometry, curve and output mapping were taken from, a sentence each.
    pub geometry_origin: String,
    pub curve_origin: String,
    pub mapping_origin: String,
}

/// Why the parameters describe no airframe that can be modelled.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum AirframeError {
    #[error("FRAME_CLASS {0} is not a multirotor whose motor positions are known: describe it in a vehicle file")]
    FrameClass(i64),
    #[error("FRAME_TYPE {frame_type} of FRAME_CLASS {class} is not known: describe it in a vehicle file")]
    FrameType { class: i64, frame_type: i64 },
    #[error("CA_AIRFRAME {0} is not a multirotor: only multirotors are modelled")]
    NotMultirotor(i64),
    #[error("CA_ROTOR_COUNT is {0}, but 3 to {max} rotors are supported", max = crate::signal::MAX_ROTORS)]
    RotorCount(i64),
    #[error("rotor {0} has no usable position (CA_ROTOR{index}_PX, _PY): describe it in a vehicle file", index = .0 - 1)]
    NoPosition(usize),
}

/// A look-up of the autopilot's parameters by name.
pub type Lookup<'a> = &'a dyn Fn(&str) -> Option<f64>;

/// The airframe that the parameters describe. A parameter that is not known counts as the autopilot's default.
///
/// # Errors
/// [`AirframeError`] for what is no multirotor or has rotors whose places are not known.
pub fn from_parameters(autopilot: Autopilot, parameters: Lookup<'_>) -> Result<Airframe, AirframeError> {
    match autopilot {
        Autopilot::ArduPilot => ardupilot::airframe(parameters),
        Autopilot::Px4 => px4::airframe(parameters),
    }
}

/// The names of the parameters that [`from_parameters`] looks up, for whoever has to fetch them. PX4's depend on how
/// many rotors there are: to be called again with what has become known.
pub fn parameter_names(autopilot: Autopilot, parameters: Lookup<'_>) -> Vec<String> {
    match autopilot {
        Autopilot::ArduPilot => ardupilot::names(),
        Autopilot::Px4 => px4::names(parameters),
    }
}

/// Takes parameters where they are known and defaults where not, and remembers which.
struct Reader<'a> {
    parameters: Lookup<'a>,
    found: Vec<String>,
    assumed: Vec<String>,
}

impl<'a> Reader<'a> {
    fn new(parameters: Lookup<'a>) -> Self {
        Self { parameters, found: Vec::new(), assumed: Vec::new() }
    }

    fn known(&mut self, name: &str) -> Option<f64> {
        let x = (self.parameters)(name).filter(|x| x.is_finite())?;
        self.found.push(format!("{name} {x}"));
        Some(x)
    }

    fn or(&mut self, name: &str, default: f64) -> f64 {
        self.known(name).unwrap_or_else(|| {
            self.assumed.push(format!("{name} {default}"));
            default
        })
    }

    fn origin(self, autopilot: Autopilot) -> String {
        let defaults = || format!("{}'s defaults {}", autopilot.name(), self.assumed.join(", "));
        match (self.found.is_empty(), self.assumed.is_empty()) {
            (false, true) => self.found.join(", "),
            (false, false) => format!("{}; {}", self.found.join(", "), defaults()),
            (true, _) => format!("no parameter known: {}", defaults()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn airframe(autopilot: Autopilot, known: &[(&str, f64)]) -> Result<Airframe, AirframeError> {
        let known: BTreeMap<&str, f64> = known.iter().copied().collect();
        from_parameters(autopilot, &|name| known.get(name).copied())
    }

    #[test]
    fn every_known_frame_is_balanced() {
        for class in [1, 2, 3, 4, 12] {
            for frame_type in 0..=20 {
                let known = [("FRAME_CLASS", f64::from(class)), ("FRAME_TYPE", f64::from(frame_type))];
                let Ok(frame) = airframe(Autopilot::ArduPilot, &known) else { continue };
                let centre: Vector2<f64> = frame.places.iter().map(|p| p.forward_right).sum();
                let spin: f64 = frame.places.iter().map(|p| p.spin.reaction_sign()).sum();
                assert!(centre.norm() < 1e-9 && spin == 0.0, "class {class}, type {frame_type}");
                let longest = frame.places.iter().map(|p| p.forward_right.norm()).fold(0.0, f64::max);
                assert!((longest - 1.0).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn arducopters_default_is_a_quad_in_x() {
        let frame = airframe(Autopilot::ArduPilot, &[]).unwrap();
        let signs = |f: fn(&Place) -> f64| frame.places.iter().map(f).map(f64::signum).collect::<Vec<_>>();
        assert_eq!(signs(|p| p.forward_right.x), [1.0, -1.0, 1.0, -1.0]);
        assert_eq!(signs(|p| p.forward_right.y), [1.0, -1.0, -1.0, 1.0]);
        assert_eq!(signs(|p| p.spin.reaction_sign()), [1.0, 1.0, -1.0, -1.0]);
        assert_eq!(frame.curve, Curve { expo: 0.65, at_zero: 1150.0, at_full: 1950.0 });
        assert!(frame.curve_origin.contains("no parameter known"), "{}", frame.curve_origin);
    }

    #[test]
    fn arducopters_parameters_are_followed() {
        let known = [
            ("FRAME_CLASS", 2.0),
            ("FRAME_TYPE", 1.0),
            ("MOT_PWM_MIN", 1100.0),
            ("MOT_PWM_MAX", 1900.0),
            ("MOT_SPIN_MIN", 0.2),
            ("MOT_SPIN_MAX", 1.0),
            ("MOT_THST_EXPO", 0.5),
            ("SERVO9_FUNCTION", 33.0),
        ];
        let frame = airframe(Autopilot::ArduPilot, &known).unwrap();
        assert_eq!(frame.places.len(), 6);
        assert_eq!(frame.curve, Curve { expo: 0.5, at_zero: 1260.0, at_full: 1900.0 });
        assert_eq!(frame.places[0].output, 8);
        assert_eq!(frame.places[1].output, 1);
    }

    #[test]
    fn px4s_rotors_are_where_the_parameters_say() {
        let mut known = vec![("CA_AIRFRAME", 0.0), ("CA_ROTOR_COUNT", 4.0), ("THR_MDL_FAC", 0.3)];
        let places = [
            ("CA_ROTOR0_PX", "CA_ROTOR0_PY", "CA_ROTOR0_KM", 0.13, 0.22, 0.05),
            ("CA_ROTOR1_PX", "CA_ROTOR1_PY", "CA_ROTOR1_KM", -0.13, -0.20, 0.05),
            ("CA_ROTOR2_PX", "CA_ROTOR2_PY", "CA_ROTOR2_KM", 0.13, -0.22, -0.05),
            ("CA_ROTOR3_PX", "CA_ROTOR3_PY", "CA_ROTOR3_KM", -0.13, 0.20, -0.05),
        ];
        for (px, py, km, x, y, k) in places {
            known.extend([(px, x), (py, y), (km, k)]);
        }
        let frame = airframe(Autopilot::Px4, &known).unwrap();
        let arm = frame.arm_m.unwrap();
        assert!((arm - 0.13_f64.hypot(0.22)).abs() < 1e-12);
        assert!((frame.places[1].forward_right * arm - Vector2::new(-0.13, -0.20)).norm() < 1e-12);
        assert_eq!(frame.places[2].spin, Spin::Cw);
        assert_eq!(frame.curve.expo, 0.3);
    }

    #[test]
    fn what_is_no_multirotor_is_said_plainly() {
        assert_eq!(airframe(Autopilot::ArduPilot, &[("FRAME_CLASS", 6.0)]), Err(AirframeError::FrameClass(6)));
        let message = airframe(Autopilot::Px4, &[("CA_AIRFRAME", 1.0)]).unwrap_err().to_string();
        assert!(message.contains("only multirotors"), "{message}");
        assert!(matches!(
            airframe(Autopilot::ArduPilot, &[("FRAME_CLASS", 1.0), ("FRAME_TYPE", 99.0)]),
            Err(AirframeError::FrameType { class: 1, frame_type: 99 })
        ));
    }
}
