//! ArduPilot: FRAME_CLASS and FRAME_TYPE name the geometry, MOT_* the thrust curve, SERVOn_FUNCTION the outputs.
//!
//! The tables give, for motors 1, 2, …, the bearing of each arm from forward, clockwise seen from above (degrees), and
//! its sense of rotation, as ArduCopter's documentation of motor numbering shows them. Only frames whose arms are all of
//! one length are listed.

use super::{Airframe, AirframeError, Autopilot, Curve, Lookup, Place, Reader};
use crate::vehicle::Spin::{self, Ccw, Cw};
use nalgebra::Vector2;

const QUAD: i64 = 1;
const HEXA: i64 = 2;
const OCTA: i64 = 3;
const OCTA_QUAD: i64 = 4;
const DODECA_HEXA: i64 = 12;

type Motor = (f64, Spin);

const QUAD_PLUS: [Motor; 4] = [(90.0, Ccw), (-90.0, Ccw), (0.0, Cw), (180.0, Cw)];
const QUAD_X: [Motor; 4] = [(45.0, Ccw), (-135.0, Ccw), (-45.0, Cw), (135.0, Cw)];
const QUAD_X_BETAFLIGHT: [Motor; 4] = [(135.0, Cw), (45.0, Ccw), (-135.0, Ccw), (-45.0, Cw)];
const QUAD_X_DJI: [Motor; 4] = [(45.0, Ccw), (-45.0, Cw), (-135.0, Ccw), (135.0, Cw)];
const QUAD_X_CLOCKWISE: [Motor; 4] = [(45.0, Ccw), (135.0, Cw), (-135.0, Ccw), (-45.0, Cw)];
const HEXA_PLUS: [Motor; 6] = [(0.0, Cw), (180.0, Ccw), (-120.0, Cw), (60.0, Ccw), (-60.0, Ccw), (120.0, Cw)];
const HEXA_X: [Motor; 6] = [(90.0, Cw), (-90.0, Ccw), (-30.0, Cw), (150.0, Ccw), (30.0, Ccw), (-150.0, Cw)];
const HEXA_X_DJI: [Motor; 6] = [(30.0, Ccw), (-30.0, Cw), (-90.0, Ccw), (-150.0, Cw), (150.0, Ccw), (90.0, Cw)];
const HEXA_X_CLOCKWISE: [Motor; 6] = [(30.0, Ccw), (90.0, Cw), (150.0, Ccw), (-150.0, Cw), (-90.0, Ccw), (-30.0, Cw)];
const OCTA_PLUS: [Motor; 8] =
    [(0.0, Cw), (180.0, Cw), (45.0, Ccw), (135.0, Ccw), (-45.0, Ccw), (-135.0, Ccw), (-90.0, Cw), (90.0, Cw)];
const OCTA_X: [Motor; 8] =
    [(22.5, Cw), (-157.5, Cw), (67.5, Ccw), (157.5, Ccw), (-22.5, Ccw), (-112.5, Ccw), (-67.5, Cw), (112.5, Cw)];
const OCTA_QUAD_PLUS: [Motor; 8] =
    [(0.0, Ccw), (-90.0, Cw), (180.0, Ccw), (90.0, Cw), (-90.0, Ccw), (0.0, Cw), (90.0, Ccw), (180.0, Cw)];
const OCTA_QUAD_X: [Motor; 8] =
    [(45.0, Ccw), (-45.0, Cw), (-135.0, Ccw), (135.0, Cw), (-45.0, Ccw), (45.0, Cw), (135.0, Ccw), (-135.0, Cw)];
const DODECA_PLUS: [Motor; 12] = [
    (0.0, Ccw),
    (0.0, Cw),
    (60.0, Cw),
    (60.0, Ccw),
    (120.0, Ccw),
    (120.0, Cw),
    (180.0, Cw),
    (180.0, Ccw),
    (-120.0, Ccw),
    (-120.0, Cw),
    (-60.0, Cw),
    (-60.0, Ccw),
];

/// The motors of a frame; `None` where it is not in the tables.
fn motors(class: i64, frame_type: i64) -> Option<Vec<Motor>> {
    let reversed = |motors: &[Motor]| motors.iter().map(|&(a, s)| (a, if s == Cw { Ccw } else { Cw })).collect();
    Some(match (class, frame_type) {
        (QUAD, 0) => QUAD_PLUS.to_vec(),
        (QUAD, 1) => QUAD_X.to_vec(),
        // H has the arms of X and turns the other way round
        (QUAD, 3) => reversed(&QUAD_X),
        (QUAD, 12) => QUAD_X_BETAFLIGHT.to_vec(),
        (QUAD, 13) => QUAD_X_DJI.to_vec(),
        (QUAD, 14) => QUAD_X_CLOCKWISE.to_vec(),
        (QUAD, 18) => reversed(&QUAD_X_BETAFLIGHT),
        (HEXA, 0) => HEXA_PLUS.to_vec(),
        (HEXA, 1) => HEXA_X.to_vec(),
        (HEXA, 13) => HEXA_X_DJI.to_vec(),
        (HEXA, 14) => HEXA_X_CLOCKWISE.to_vec(),
        (OCTA, 0) => OCTA_PLUS.to_vec(),
        (OCTA, 1) => OCTA_X.to_vec(),
        (OCTA_QUAD, 0) => OCTA_QUAD_PLUS.to_vec(),
        (OCTA_QUAD, 1) => OCTA_QUAD_X.to_vec(),
        (OCTA_QUAD, 3) => reversed(&OCTA_QUAD_X),
        (DODECA_HEXA, 0) => DODECA_PLUS.to_vec(),
        (DODECA_HEXA, 1) => DODECA_PLUS.iter().map(|&(a, s)| (a + 30.0, s)).collect(),
        _ => return None,
    })
}

/// SERVOn_FUNCTION of motor `rotor` (0-based): 33–40 are motors 1–8, 82–85 motors 9–12.
fn function_of(rotor: usize) -> f64 {
    (if rotor < 8 { 33 + rotor } else { 82 + rotor - 8 }) as f64
}

pub(super) fn airframe(parameters: Lookup<'_>) -> Result<Airframe, AirframeError> {
    let mut geometry = Reader::new(parameters);
    let class = geometry.or("FRAME_CLASS", 1.0) as i64;
    let frame_type = geometry.or("FRAME_TYPE", 1.0) as i64;
    let motors = motors(class, frame_type).ok_or(if (QUAD..=OCTA_QUAD).contains(&class) || class == DODECA_HEXA {
        AirframeError::FrameType { class, frame_type }
    } else {
        AirframeError::FrameClass(class)
    })?;

    let mut mapping = Reader::new(parameters);
    let mut places: Vec<Place> = motors
        .iter()
        .enumerate()
        .map(|(output, &(bearing, spin))| {
            let (right, forward) = f64::to_radians(bearing).sin_cos();
            Place { forward_right: Vector2::new(forward, right), spin, output }
        })
        .collect();
    for output in 0..16 {
        let function = (mapping.parameters)(&format!("SERVO{}_FUNCTION", output + 1));
        for (rotor, place) in places.iter_mut().enumerate() {
            if function == Some(function_of(rotor)) {
                place.output = output;
                mapping.found.push(format!("SERVO{}_FUNCTION {}", output + 1, function_of(rotor)));
            }
        }
    }
    if mapping.found.is_empty() {
        mapping.assumed.push("motor n on output n".to_owned());
    }

    let mut curve = Reader::new(parameters);
    let (low, high) = (curve.or("MOT_PWM_MIN", 1000.0), curve.or("MOT_PWM_MAX", 2000.0));
    let (spin_min, spin_max) = (curve.or("MOT_SPIN_MIN", 0.15), curve.or("MOT_SPIN_MAX", 0.95));
    let expo = curve.or("MOT_THST_EXPO", 0.65);
    Ok(Airframe {
        autopilot: Autopilot::ArduPilot,
        places,
        arm_m: None,
        curve: Curve { expo, at_zero: low + spin_min * (high - low), at_full: low + spin_max * (high - low) },
        geometry_origin: geometry.origin(Autopilot::ArduPilot),
        curve_origin: curve.origin(Autopilot::ArduPilot),
        mapping_origin: mapping.origin(Autopilot::ArduPilot),
    })
}

pub(super) fn names() -> Vec<String> {
    const FIXED: [&str; 7] =
        ["FRAME_CLASS", "FRAME_TYPE", "MOT_PWM_MIN", "MOT_PWM_MAX", "MOT_SPIN_MIN", "MOT_SPIN_MAX", "MOT_THST_EXPO"];
    let outputs = (1..=16).map(|n| format!("SERVO{n}_FUNCTION"));
    FIXED.iter().map(ToString::to_string).chain(outputs).collect()
}
