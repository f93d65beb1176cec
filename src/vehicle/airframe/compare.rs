use super::{Airframe, Autopilot};
use crate::vehicle::Vehicle;

/// By how much a rotor's bearing may differ, degrees: builders measure arms, not angles.
const BEARING_DEG: f64 = 15.0;
/// By how much its distance from the centre may differ, in units of the longest arm.
const DISTANCE: f64 = 0.2;
/// By how much the ends of the command's range may differ, as a share of it.
const RANGE: f64 = 0.02;
const EXPO: f64 = 0.05;

/// Where a vehicle's parameters contradict a model of it, a sentence each; none if it may be this vehicle.
pub fn differences(airframe: &Airframe, model: &Vehicle) -> Vec<String> {
    let (count, modelled) = (airframe.places.len(), model.rotors.len());
    if count != modelled {
        return vec![format!("the vehicle has {count} rotors ({}), the model {modelled}", airframe.geometry_origin)];
    }
    let mut all = Vec::new();
    let longest = model.rotors.iter().map(|r| r.position_frd_m.xy().norm()).fold(0.0, f64::max);
    for (n, (place, rotor)) in (1..).zip(airframe.places.iter().zip(&model.rotors)) {
        let modelled = rotor.position_frd_m.xy() / longest.max(1e-9);
        let bearing = |p: nalgebra::Vector2<f64>| p.y.atan2(p.x).to_degrees();
        let turned = (bearing(place.forward_right) - bearing(modelled) + 540.0).rem_euclid(360.0) - 180.0;
        if turned.abs() > BEARING_DEG || (place.forward_right.norm() - modelled.norm()).abs() > DISTANCE {
            let (is, has) = (bearing(place.forward_right), bearing(modelled));
            all.push(format!(
                "rotor {n} is at {is:.0}\u{b0} from forward ({:.2} arms), in the model at {has:.0}\u{b0} ({:.2})",
                place.forward_right.norm(),
                modelled.norm()
            ));
        }
        if place.spin != rotor.spin {
            all.push(format!("rotor {n} turns the other way round than in the model"));
        }
        if place.output != rotor.output {
            let (is, has) = (place.output + 1, rotor.output + 1);
            all.push(format!("rotor {n} is driven by output {is}, in the model by output {has}"));
        }
    }
    // PX4 gives its outputs on one scale, and its curve is often left straight where the thrust is not
    if airframe.autopilot == Autopilot::ArduPilot {
        let (curve, modelled) = (airframe.curve, model.actuators);
        let span = (modelled.at_full - modelled.at_zero).abs().max(1e-9);
        for (end, is, has) in [("zero", curve.at_zero, modelled.at_zero), ("full", curve.at_full, modelled.at_full)] {
            if (is - has).abs() > RANGE * span {
                all.push(format!("{end} thrust is at output {is:.0}, in the model at {has:.0}"));
            }
        }
        if (curve.expo - model.thrust.expo).abs() > EXPO {
            all.push(format!("MOT_THST_EXPO is {:.2}, the model's expo {:.2}", curve.expo, model.thrust.expo));
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vehicle::airframe::from_parameters;
    use crate::vehicle::resolve;

    fn airframe(known: &[(&str, f64)]) -> Airframe {
        let known: std::collections::BTreeMap<&str, f64> = known.iter().copied().collect();
        from_parameters(Autopilot::ArduPilot, &|name| known.get(name).copied()).unwrap()
    }

    #[test]
    fn a_vehicle_agrees_with_its_own_model() {
        assert_eq!(differences(&airframe(&[]), &resolve("arducopter-sitl").unwrap()), Vec::<String>::new());
        let hexa = airframe(&[("FRAME_CLASS", 2.0)]);
        assert_eq!(differences(&hexa, &resolve("arducopter-hexa").unwrap()), Vec::<String>::new());
    }

    #[test]
    fn each_contradiction_is_told() {
        let model = resolve("arducopter-sitl").unwrap();
        let told = |known: &[(&str, f64)]| differences(&airframe(known), &model).join("; ");
        assert!(told(&[("FRAME_CLASS", 2.0)]).contains("has 6 rotors"));
        assert!(told(&[("FRAME_TYPE", 0.0)]).contains("rotor 1 is at 90"));
        assert!(told(&[("FRAME_TYPE", 3.0)]).contains("turns the other way"));
        assert!(told(&[("SERVO9_FUNCTION", 33.0)]).contains("rotor 1 is driven by output 9"));
        assert!(told(&[("MOT_SPIN_MAX", 0.8)]).contains("full thrust is at output 1800"));
        assert!(told(&[("MOT_THST_EXPO", 0.2)]).contains("MOT_THST_EXPO is 0.20"));
    }
}
