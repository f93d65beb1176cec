//! PX4: CA_ROTORn_PX, _PY and _KM place each rotor, THR_MDL_FAC bends the thrust curve.

use super::{Airframe, AirframeError, Autopilot, Curve, Lookup, Place, Reader};
use crate::signal::MAX_ROTORS;
use crate::vehicle::Spin;
use nalgebra::Vector2;

/// CA_AIRFRAME of a multirotor.
const MULTIROTOR: i64 = 0;
/// An arm shorter than this is no arm, m.
const MIN_ARM_M: f64 = 0.01;

/// PX4's standard quad in X, where no rotor is described: motor order 1 front right, 2 rear left, 3 front left,
/// 4 rear right.
const QUAD_X: [(f64, f64, Spin); 4] =
    [(1.0, 1.0, Spin::Ccw), (-1.0, -1.0, Spin::Ccw), (1.0, -1.0, Spin::Cw), (-1.0, 1.0, Spin::Cw)];

pub(super) fn airframe(parameters: Lookup<'_>) -> Result<Airframe, AirframeError> {
    let mut geometry = Reader::new(parameters);
    if let Some(kind) = geometry.known("CA_AIRFRAME").map(|x| x as i64)
        && kind != MULTIROTOR
    {
        return Err(AirframeError::NotMultirotor(kind));
    }
    let count = geometry.known("CA_ROTOR_COUNT").map(|n| n as i64);
    let (places, arm_m) = match count {
        Some(n) if (3..=MAX_ROTORS as i64).contains(&n) => described(&mut geometry, n as usize)?,
        Some(n) => return Err(AirframeError::RotorCount(n)),
        None => {
            geometry.assumed.push("quad in X".to_owned());
            let place = |(output, &(x, y, spin)): (usize, &(f64, f64, Spin))| Place {
                forward_right: Vector2::new(x, y) / f64::sqrt(2.0),
                spin,
                output,
            };
            (QUAD_X.iter().enumerate().map(place).collect(), None)
        }
    };
    let mut curve = Reader::new(parameters);
    let expo = curve.or("THR_MDL_FAC", 0.0);
    Ok(Airframe {
        autopilot: Autopilot::Px4,
        places,
        arm_m,
        // PX4 reports its outputs on 1000 + 1000·u whatever the pulses on the wire are, save where PWM limits are set
        curve: Curve { expo, at_zero: 1000.0, at_full: 2000.0 },
        geometry_origin: geometry.origin(Autopilot::Px4),
        curve_origin: curve.origin(Autopilot::Px4),
        mapping_origin: "motor n is the actuator message's output n".to_owned(),
    })
}

fn described(geometry: &mut Reader<'_>, count: usize) -> Result<(Vec<Place>, Option<f64>), AirframeError> {
    let mut places = Vec::with_capacity(count);
    for output in 0..count {
        let x = geometry.known(&format!("CA_ROTOR{output}_PX"));
        let y = geometry.known(&format!("CA_ROTOR{output}_PY"));
        let moment = geometry.or(&format!("CA_ROTOR{output}_KM"), 0.05);
        let (Some(x), Some(y)) = (x, y) else { return Err(AirframeError::NoPosition(output + 1)) };
        // KM > 0 is a propeller that turns counter-clockwise
        let spin = if moment >= 0.0 { Spin::Ccw } else { Spin::Cw };
        places.push(Place { forward_right: Vector2::new(x, y), spin, output });
    }
    let arm = places.iter().map(|p| p.forward_right.norm()).fold(0.0, f64::max);
    if arm < MIN_ARM_M {
        return Err(AirframeError::NoPosition(1));
    }
    for p in &mut places {
        p.forward_right /= arm;
    }
    Ok((places, Some(arm)))
}

pub(super) fn names(parameters: Lookup<'_>) -> Vec<String> {
    let fixed = ["CA_AIRFRAME", "CA_ROTOR_COUNT", "THR_MDL_FAC"].map(str::to_owned);
    let count = parameters("CA_ROTOR_COUNT").map_or(0, |n| n as usize).min(MAX_ROTORS);
    let rotors = (0..count).flat_map(|n| ["PX", "PY", "KM"].map(|field| format!("CA_ROTOR{n}_{field}")));
    fixed.into_iter().chain(rotors).collect()
}
