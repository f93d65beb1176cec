use super::options::{Rates, Shared, matrix, positive, progress, three};
use super::sheet::Sheet;
use crate::cli::Failure;
use crate::observers::unknown_input::plant::{attitude_of, paper_roll_pitch, paper_yaw};
use crate::observers::unknown_input::{Body, DesignError, Objective, Polytope, UnknownInputDesign, design};
use crate::vehicle;
use serde_json::{Value, json};
use std::fmt::Write;

const EXAMPLES: &str = "Examples:
  mavobserver design unknown-input
  mavobserver design unknown-input --alpha 2,5,10 --json
  mavobserver design unknown-input --plant px4-sih --gain 10,20";

/// Torque under changing mass and inertia (Pham, Ichalal, Mammar 2020)
///
/// Checks the conditions of Theorem 1 with their reasons, solves the corrected (22) over the corners of the scheduling
/// parameters, and checks it by eigenvalues outside the solver. Corrections to the paper: QM with one sign, Aᵀ in (21),
/// K = X·L, rows ρ₁₂ and ρ₂₁ of table II exchanged; no derivative of a measurement is needed.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    pub shared: Shared,
    /// Rates at which errors shall decay, at the smallest gain [default: 1, 5, 20]
    #[command(flatten)]
    rates: Rates,
    /// Largest gains ‖L‖, at the fastest decay
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = positive)]
    gain: Vec<f64>,
    /// Yaw rate up to which a vehicle's design holds, rad/s
    #[arg(long, value_name = "RATE", default_value_t = 3.0, value_parser = positive)]
    yaw_rate: f64,
}

const PAPER_PLANT: &str = "pham-quadrotor";

impl From<DesignError> for Failure {
    fn from(e: DesignError) -> Self {
        Self::Failed(e.to_string())
    }
}

pub fn run(args: &Args) -> Result<Sheet, Failure> {
    let name = args.shared.plant.as_deref().unwrap_or(PAPER_PLANT);
    let plants = plants(name, args.yaw_rate)?;
    let rates = if args.gain.is_empty() { args.rates.or(&[1.0, 5.0, 20.0]) } else { args.rates.alpha.clone() };
    let slow = rates.into_iter().map(|decay| Objective::SmallestGain { decay });
    let objectives: Vec<_> = slow.chain(args.gain.iter().map(|&gain| Objective::FastestDecay { gain })).collect();
    let bar = progress(plants.len() * objectives.len());
    let mut rows = Vec::new();
    let mut text = format!(
        "unknown-input for {name}\nstate errors decay as e^(−δt); the torque's error is set by τ and the gyro's noise\n\n"
    );
    let _ = writeln!(text, "subsystem    corners   δ 1/s      ‖L‖ ≤    margin  solve s");
    for (part, plant) in &plants {
        for &objective in &objectives {
            let made = design(plant, objective)?;
            bar.inc(1);
            let _ = writeln!(
                text,
                "{part:<12} {:>7} {:>7} {:>10} {:>9.0e} {:>8.2}",
                plant.vertices.len(),
                three(made.decay),
                three(made.gain_bound),
                made.margin,
                made.solve_s
            );
            rows.push(row(part, plant, &made));
        }
    }
    bar.finish_and_clear();
    text.push_str("\nevery row satisfies (22) at every pair of corners by eigenvalues computed outside the solver");
    Ok(Sheet {
        observer: "unknown-input",
        paper: "Pham, Ichalal, Mammar: LPV unknown input observer for attitude of a mass-varying quadcopter (2020)",
        plant: name.to_owned(),
        rows,
        text,
        corrections: &[
            "(21), (22): the term with QM has one sign, else it drops out; A is transposed once; K = X·L",
            "(8b) to (8e) hold for z, with the sum of all unknown inputs",
            "Table II: ±74.1176 belongs to ρ₁₂; the lower end of ρ₁₁ is 1/0.0142 = 70.4, not 47.1",
            "the auxiliary system s(t) has no feedback and drifts: it is left out, and no output is differentiated",
        ],
        ..Sheet::default()
    })
}

/// The paper's two subsystems, or the whole attitude of a vehicle.
fn plants(name: &str, yaw_rads: f64) -> Result<Vec<(&'static str, Polytope)>, Failure> {
    if name == PAPER_PLANT {
        return Ok(vec![("roll, pitch", paper_roll_pitch()), ("yaw", paper_yaw())]);
    }
    let vehicle = vehicle::resolve(name)?;
    let body = |share: f64| Body {
        mass_kg: vehicle.mass_kg.nominal,
        inertia_kgm2: vehicle.inertia_kgm2 * (1.0 + share * vehicle.inertia_uncertainty),
    };
    let d = vehicle.dynamics;
    let rotors = d.inertia_kgm2 * d.max_speed_rads * vehicle.rotors.len() as f64;
    let plant = attitude_of(&body(-1.0), &body(1.0), yaw_rads, rotors)
        .ok_or_else(|| Failure::Failed(format!("`{name}` has a singular inertia")))?;
    Ok(vec![("attitude", plant)])
}

fn row(part: &str, plant: &Polytope, d: &UnknownInputDesign) -> Value {
    let list = |m: &[nalgebra::DMatrix<f64>]| m.iter().map(matrix).collect::<Vec<_>>();
    json!({
        "subsystem": part,
        "decay": d.decay,
        "gain_bound": d.gain_bound,
        "gains": list(&d.gains),
        "A": plant.vertices.iter().map(|v| matrix(&v.a)).collect::<Vec<_>>(),
        "E": plant.vertices.iter().map(|v| matrix(&v.e)).collect::<Vec<_>>(),
        "C": matrix(&plant.c),
        "Q": matrix(&d.q),
        "M": list(&d.m),
        "Gamma": list(&d.gamma),
        "P": matrix(&d.x),
        // a design that fails its check is an error, not a row
        "verified": true,
        "margin": d.margin,
        "solve_s": d.solve_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vehicle_and_the_paper_have_designs() {
        for (name, parts) in [(PAPER_PLANT, 2), ("px4-sih", 1)] {
            let plants = plants(name, 3.0).unwrap();
            assert_eq!(plants.len(), parts);
            for (part, plant) in plants {
                let d = design(&plant, Objective::SmallestGain { decay: 5.0 }).unwrap();
                assert_eq!(row(part, &plant, &d)["verified"], true);
            }
        }
    }
}
