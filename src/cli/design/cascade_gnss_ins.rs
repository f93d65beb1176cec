use super::options::{Shared, matrix, positive, progress, three};
use super::sheet::Sheet;
use crate::cli::Failure;
use crate::observers::cascade_gnss_ins::{
    Conditions, Design, DesignError, Goal, Measures, Plant, PoleRegion, design, eigenvalues, gain_at,
};
use crate::report::{Colour, Figure, Panel};
use nalgebra::DMatrix;
use serde_json::{Map, Value, json};
use std::fmt::Write;

const EXAMPLES: &str = "Examples:
  mavobserver design cascade-gnss-ins
  mavobserver design cascade-gnss-ins --gamma 50 --gamma-n 1.002 --json
  mavobserver design cascade-gnss-ins --plant position --gamma 20 --gamma-n 2 --radius 10
  mavobserver design cascade-gnss-ins --plant all";

/// Attitude, velocity, position from raw sensors (Grip, Saberi, Johansen 2012)
///
/// Gains for a linear system that a nonlinear one drives, from the inequalities (14) and (15) at their analytic centre,
/// with both H∞ norms checked by Hamiltonian eigenvalues outside the solver. The axes of the navigation example do not
/// mix, so each is designed for itself.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, allow_negative_numbers = true)]
pub struct Args {
    #[command(flatten)]
    pub shared: Shared,
    /// What ‖H‖ must stay below: how much of what is not modelled reaches the error
    #[arg(long, value_name = "GAMMA", default_value_t = 50.0, value_parser = positive)]
    gamma: f64,
    /// What ‖G‖ must stay below: how much measurement noise reaches the error [default: 1.002 with velocity, else 2]
    #[arg(long, value_name = "GAMMA", value_parser = positive)]
    gamma_n: Option<f64>,
    /// Poles left of minus this, 1/s
    #[arg(long, value_name = "RATE", value_parser = positive)]
    decay: Option<f64>,
    /// Poles within this of the origin, rad/s
    #[arg(long, value_name = "RATE", value_parser = positive)]
    radius: Option<f64>,
    /// Poles within this of the negative real axis, as seen from the origin, degrees
    #[arg(long, value_name = "DEG", value_parser = positive)]
    angle_deg: Option<f64>,
}

const PAPER_PLANT: &str = "position-velocity";
const EXAMPLE_1: &str = "example-1";

const CORRECTIONS: &[&str] =
    &["Minimising γ_n is ill-posed: with N = I the position's noise reaches its own estimate \
     whatever the gain, so ‖G‖ ≥ 1, and the infimum 1 is approached by growing gains only. The printed gains are one \
     solver's stopping point; here γ_n is given and the analytic centre taken."];

/// One design to make: a plant, or the axes of one that are alike.
struct Case {
    plant_name: &'static str,
    axes: &'static str,
    plant: Plant,
    gamma_n: f64,
}

impl From<DesignError> for Failure {
    fn from(e: DesignError) -> Self {
        Self::Failed(e.to_string())
    }
}

pub fn run(args: &Args) -> Result<Sheet, Failure> {
    let name = args.shared.plant.as_deref().unwrap_or(PAPER_PLANT);
    let cases = cases(name)?;
    let region = PoleRegion { decay: args.decay, radius: args.radius, angle: args.angle_deg.map(f64::to_radians) };
    let bar = progress(cases.len());
    let mut made = Vec::new();
    for case in cases {
        bar.set_message(case.plant_name);
        let goal = Goal { gamma: args.gamma, gamma_n: args.gamma_n.unwrap_or(case.gamma_n), region };
        let d = design(&case.plant, &goal)?;
        made.push((case, d));
        bar.inc(1);
    }
    bar.finish_and_clear();
    let mut more = Map::new();
    more.insert("gamma".into(), json!(args.gamma));
    Ok(Sheet {
        observer: "cascade-gnss-ins",
        plant: name.to_owned(),
        more,
        rows: made.iter().map(|(case, d)| row(case, d)).collect(),
        text: text(name, &made),
        paper: "Grip, Saberi, Johansen: Observers for interconnected nonlinear and linear systems (2012)",
        figures: vec![(
            gains_over_frequency(&made),
            "Largest singular value over frequency: the H∞ norm is the highest point of each line.".to_owned(),
        )],
        corrections: CORRECTIONS,
        ..Sheet::default()
    })
}

/// Everything that belongs to a plant's name.
fn cases(name: &str) -> Result<Vec<Case>, Failure> {
    let both = || Plant::axis(1.0, Some(1.0));
    let case = |plant_name, axes, plant, gamma_n| Case { plant_name, axes, plant, gamma_n };
    let of = |measures: Measures| {
        let name = measures.name();
        match measures {
            Measures::Position => vec![case(name, "each", Plant::axis(1.0, None), 2.0)],
            Measures::PositionAndVelocity => vec![case(name, "each", both(), 1.002)],
            Measures::PositionAndGroundVelocity => {
                vec![case(name, "north, east", both(), 1.002), case(name, "down", Plant::axis(1.0, None), 2.0)]
            }
        }
    };
    let example = || case(EXAMPLE_1, "whole", Plant::example_1(), 2.0);
    match name {
        "all" => Ok(Measures::ALL.into_iter().flat_map(of).chain([example()]).collect()),
        EXAMPLE_1 => Ok(vec![example()]),
        _ => match Measures::ALL.into_iter().find(|m| m.name() == name) {
            Some(measures) => Ok(of(measures)),
            None => Err(Failure::Usage(format!(
                "there is no plant `{name}`; there are: {}, {EXAMPLE_1}, all",
                Measures::ALL.map(Measures::name).join(", ")
            ))),
        },
    }
}

/// The observer's own matrix is 𝔄 − gain·ℭ.
fn row(case: &Case, d: &Design) -> Value {
    let (p, e) = (&case.plant, case.plant.extended());
    let closed = &e.a - &d.gain * &e.c;
    let poles = eigenvalues(&closed).unwrap_or_default();
    let conditions = Conditions::of(p);
    json!({
        "plant": case.plant_name,
        "axes": case.axes,
        "gamma": d.goal.gamma,
        "gamma_n": d.goal.gamma_n,
        "h_norm": { "lower": d.h.lower, "upper": d.h.upper, "peak_rads": d.h.peak_rads },
        "g_norm": { "lower": d.g.lower, "upper": d.g.upper, "peak_rads": d.g.peak_rads },
        "gain": matrix(&d.gain),
        "poles": poles.iter().map(|z| [z.re, z.im]).collect::<Vec<_>>(),
        "A": matrix(&p.a), "B_z": matrix(&p.b_z), "C": matrix(&p.c), "D_z": matrix(&p.d_z), "N": matrix(&p.n),
        "extended": { "A": matrix(&e.a), "B_d": matrix(&e.b_d), "C": matrix(&e.c) },
        "closed_loop": matrix(&closed),
        "P": matrix(&d.p),
        // a plant that breaks Assumption 4 is an error, not a row
        "assumption_4": true,
        "minimum_phase": conditions.minimum_phase,
        "zeros": conditions.zeros.iter().map(|z| [z.re, z.im]).collect::<Vec<_>>(),
        "verified": true,
        "margin": d.margin,
        "solve_s": d.solve_s,
    })
}

fn gains_over_frequency(made: &[(Case, Design)]) -> Figure {
    // four decades about 1 rad/s
    let frequencies = || (0..=240).map(|i| 10.0_f64.powf(-2.0 + f64::from(i) / 60.0));
    let (mut h, mut g) = (Panel::new("‖H(jω)‖", "").log_y(), Panel::new("‖G(jω)‖", "").log_y());
    for (k, (case, d)) in made.iter().enumerate() {
        let e = case.plant.extended();
        let closed = &e.a - &d.gain * &e.c;
        let curve = |input: &DMatrix<f64>| -> Vec<[f64; 2]> {
            frequencies().filter_map(|w| Some([w, gain_at(&closed, input, w)?])).collect()
        };
        let label = format!("{} ({})", case.plant_name, case.axes);
        h = h.line(label.clone(), Colour::nth(k), curve(&e.b_d));
        g = g.line(label, Colour::nth(k), curve(&(-&d.gain * &case.plant.n)));
    }
    Figure::new("What reaches the error").x("frequency", "rad/s").log_x().panel(h).panel(g)
}

fn text(name: &str, made: &[(Case, Design)]) -> String {
    let mut out = String::new();
    // writing to a String cannot fail
    let _ = write_text(&mut out, name, made);
    out
}

fn write_text(out: &mut String, name: &str, made: &[(Case, Design)]) -> std::fmt::Result {
    writeln!(out, "cascade-gnss-ins for {name}: analytic centre of (14) and (15)\n")?;
    for (case, d) in made {
        let minimum_phase = if d.conditions.minimum_phase { ", minimum phase" } else { ", not minimum phase" };
        writeln!(out, "{} ({}): Assumption 4 holds{minimum_phase}", case.plant_name, case.axes)?;
        writeln!(out, "  ‖H‖ = {:.4} < {}   ‖G‖ = {:.6} ≤ {}", d.h.lower, d.goal.gamma, d.g.lower, d.goal.gamma_n)?;
        let states: &[&str] = if case.plant_name == EXAMPLE_1 { &["w₁", "w₂", "z"] } else { &["p", "v", "z"] };
        for (state, gains) in states.iter().zip(d.gain.row_iter()) {
            let gains: Vec<_> = gains.iter().map(|k| format!("{:>9}", three(*k))).collect();
            writeln!(out, "  K_{state} {}", gains.join(" "))?;
        }
        writeln!(out, "  slowest pole {:.3} 1/s, margin {:.0e}, {:.2} s\n", d.abscissa, d.margin, d.solve_s)?;
    }
    writeln!(
        out,
        "both norms are checked by Hamiltonian eigenvalues, the inequalities by eigenvalues, outside the solver"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_plant_is_a_usage_error_that_names_the_known() {
        let Err(Failure::Usage(said)) = cases("velocity") else { panic!("a usage error") };
        assert!(said.contains("position-ground-velocity") && said.contains(EXAMPLE_1), "{said}");
        assert_eq!(cases("all").map_err(|_| ()).unwrap().len(), 5);
    }
}
