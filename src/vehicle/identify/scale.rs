//! From quantities per mass to a vehicle in kilograms and metres.

use super::drag::Form;
use super::{Identified, TorqueFit, levers};
use crate::signal::{MAX_ROTORS, RotorCommands};
use crate::vehicle::{Air, Vehicle, presets, resolve};
use nalgebra::Vector3;

/// Inertia over mass × arm² of multirotors lies between about 0.06 and 0.32; this stands in where the arm is unknown.
const USUAL_GYRATION: f64 = 0.2;
/// The two ways to Izz are believed together where they differ by less than this part.
const AGREE: f64 = 0.3;
/// Damping counts where the rotation about yaw is explained to this part.
const EXPLAINED: f64 = 0.9;

/// Where the arm's length comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum ArmOrigin {
    /// Given by the user.
    Given,
    /// The autopilot's geometry parameters.
    Parameters,
    /// A known vehicle that agrees in thrust, torque and drag per mass.
    Known(&'static str),
    /// From the usual mass distribution: wrong by up to a factor of three.
    Usual,
}

/// The one length that telemetry cannot show.
#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    pub length_m: f64,
    pub origin: ArmOrigin,
    /// Izz over the mean of Ixx and Iyy: 2 for a flat body.
    pub flatness: f64,
}

impl Arm {
    /// The best that is known; `None` without a fit of the rotation and without a given length.
    pub fn find(identified: &Identified, given_m: Option<f64>) -> Option<Self> {
        let known = known_vehicle(identified);
        let flatness = known.as_ref().map_or(2.0, |(_, v)| {
            let i = v.inertia_kgm2;
            2.0 * i[(2, 2)] / (i[(0, 0)] + i[(1, 1)])
        });
        let arm = |length_m: f64, origin: ArmOrigin| Some(Self { length_m, origin, flatness });
        if let Some(length) = given_m {
            return arm(length, ArmOrigin::Given);
        }
        if let Some(length) = identified.airframe.arm_m {
            return arm(length, ArmOrigin::Parameters);
        }
        if let Some((name, vehicle)) = &known {
            return arm(longest_arm(vehicle), ArmOrigin::Known(name));
        }
        let torque = identified.torque.as_ref()?;
        // arm·m/I = effectiveness and I = gyration·m·arm²
        let effectiveness = 0.5 * (torque.axes[0].effectiveness.value + torque.axes[1].effectiveness.value);
        arm((USUAL_GYRATION * effectiveness).recip(), ArmOrigin::Usual)
    }

    /// Ixx, Iyy, Izz over mass, m².
    pub fn inertia_per_mass_m2(&self, identified: &Identified) -> Option<[f64; 3]> {
        let torque = identified.torque.as_ref()?;
        let [roll, pitch] = [0, 1].map(|k| self.length_m / torque.axes[k].effectiveness.value);
        let flat = 0.5 * self.flatness * (roll + pitch);
        let yaw = match self.yaw_by_damping(identified, torque) {
            Some(damped) => 0.5 * (flat + damped),
            None => flat,
        };
        Some([roll, pitch, yaw])
    }

    /// Is Izz the mean of what a flat body has and of what the damping of yaw says?
    pub fn yaw_is_damped(&self, identified: &Identified) -> bool {
        identified.torque.as_ref().is_some_and(|torque| self.yaw_by_damping(identified, torque).is_some())
    }

    /// Izz over mass, m², from the drag of the rotors: against a turn at rate ω each is moved at ω times its distance
    /// from the centre, and resists as it does against wind. So the damping of yaw is `Σ rotor drag·distance²/Izz`.
    fn yaw_by_damping(&self, identified: &Identified, torque: &TorqueFit) -> Option<f64> {
        let drag = identified.drag.as_ref().filter(|drag| drag.form == Form::Rotors)?;
        let yaw = &torque.axes[2];
        let places = &identified.airframe.places;
        let mean_square = places.iter().map(|p| p.forward_right.norm_squared()).sum::<f64>() / places.len() as f64;
        let rotor_drag = 0.5 * (drag.linear[0].value + drag.linear[1].value);
        let inertia = rotor_drag * mean_square * self.length_m * self.length_m / yaw.damping.value;
        let flat = 0.5
            * self.flatness
            * [0, 1].map(|k| self.length_m / torque.axes[k].effectiveness.value).iter().sum::<f64>();
        let agree = (inertia / flat - 1.0).abs() < AGREE;
        (yaw.explained >= EXPLAINED && agree).then_some(inertia)
    }
}

fn longest_arm(vehicle: &Vehicle) -> f64 {
    vehicle.rotors.iter().map(|r| r.position_frd_m.xy().norm()).fold(0.0, f64::max)
}

/// What a vehicle's model says per mass.
struct Traits {
    rotors: usize,
    max_npkg: f64,
    /// Angular acceleration per lever-weighted thrust per mass, roll and pitch, 1/m.
    turn: [f64; 2],
    drag_at_5: f64,
}

impl Traits {
    fn of(v: &Vehicle) -> Self {
        let mass = v.mass_kg.nominal;
        let arm = longest_arm(v);
        let air = Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 };
        let hover = v.facts().hover_command.unwrap_or(1.0);
        let commands = RotorCommands { command: [hover; MAX_ROTORS], count: v.rotors.len() };
        let (_, sum_sqrt) = v.rotor_wrench(&commands, air);
        let density = v.thrust.density_ref_kgm3.unwrap_or(1.225);
        Self {
            rotors: v.rotors.len(),
            max_npkg: v.thrust.max_n.nominal / mass,
            turn: [0, 1].map(|k| arm * mass / v.inertia_kgm2[(k, k)]),
            drag_at_5: -v.drag.force(0, 5.0, sum_sqrt, density) / mass,
        }
    }
}

/// The preset that agrees with what was identified, if one does.
fn known_vehicle(identified: &Identified) -> Option<(&'static str, Vehicle)> {
    let torque = identified.torque.as_ref()?;
    let drag = identified.drag.as_ref()?;
    let near = |a: f64, b: f64, share: f64| (a - b).abs() <= share * b;
    // full thrust at the model's own reference voltage; a full battery has a little more than a used one
    presets::names().filter_map(|name| Some((name, resolve(name).ok()?))).find(|(_, vehicle)| {
        let traits = Traits::of(vehicle);
        let fit = |k: usize| torque.axes[k].effectiveness.value;
        let places = levers(&identified.airframe);
        let same_rotors = traits.rotors == places.len()
            && vehicle.rotors.iter().zip(&places).all(|(r, l): (_, &Vector3<f64>)| {
                (r.position_frd_m.y + l.x * longest_arm(vehicle)).abs() < 0.05 * longest_arm(vehicle)
            });
        let drag_fits = near(drag.at_5_mps[0].value, traits.drag_at_5, 0.15);
        same_rotors
            && near(identified.thrust.max_npkg.value, traits.max_npkg, 0.15)
            && near(fit(0), traits.turn[0], 0.15)
            && near(fit(1), traits.turn[1], 0.15)
            && drag_fits
    })
}
