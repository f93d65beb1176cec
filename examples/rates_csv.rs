//! Angular speeds from angles and motors alone, on a model of one's own and a plain CSV, without MAVLink.
//!
//! ```sh
//! cargo run --release --example rates_csv                      # a rig in software
//! cargo run --release --example rates_csv -- rig.csv out.svg   # your own
//! ```
//!
//! Designs a fuzzy-polynomial observer for a body that turns in three directions, proves its decay rate, and runs it.
//! One row per sample, all as far apart as the model's sample time, with a header. Columns: `t_s`; the measured angles
//! `phi,theta,psi` (rad); the angular accelerations that the motors cause, `u1,u2,u3` (rad/s²); and the rotors' momentum
//! as a share of the largest, `spin` (−1 to 1). Columns `p,q,r` with the true speeds are drawn beside the estimates.

use mavobserver::observers::fuzzy_polynomial::rig::Experiment;
use mavobserver::observers::fuzzy_polynomial::{Method, Options, Plant, Record, design, estimates};
use mavobserver::report::{Colour, Figure, Panel};
use std::error::Error;
use std::fmt::Write;

/// The decay rate of the error that is asked for, 1/s.
const ALPHA: f64 = 18.0;

/// The model: what is not given here is as on the Quanser rig.
fn my_rig() -> Plant {
    Plant {
        dt_s: 0.005,
        inertia_kgm2: [0.050, 0.060, 0.105],
        // four rotors of 6e-5 kg m² at 550 rad/s
        rotor_momentum: 4.0 * 6e-5 * 550.0,
        ..Plant::quanser()
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let plant = my_rig();
    let csv = match arguments.next() {
        Some(path) => std::fs::read_to_string(path)?,
        None => simulated(&plant)?,
    };
    let picture = arguments.next().unwrap_or_else(|| "rates.svg".to_owned());
    let made = design(&plant, Method::SumsOfSquares, ALPHA, Options::default())?;
    println!(
        "errors decay as e^(-{} t); gain from disturbance to error at most {:.4}; proven with margin {:.1e}",
        made.alpha, made.gain_bound, made.margin
    );
    let record = read(&csv, plant.dt_s)?;
    record.check()?;
    let found = estimates(&plant, &made, &record);

    let mut figure = Figure::new("Angular speeds from angles and motors").x("time", "s");
    for (axis, name) in ["p", "q", "r"].into_iter().enumerate() {
        let line = |speeds: &[[f64; 3]]| -> Vec<[f64; 2]> {
            speeds.iter().enumerate().map(|(k, s)| [k as f64 * plant.dt_s, s[axis]]).collect()
        };
        // what one would have without an observer
        let steps = record.angles.windows(2).enumerate();
        let differences: Vec<[f64; 2]> =
            steps.map(|(k, w)| [k as f64 * plant.dt_s, (w[1][axis] - w[0][axis]) / plant.dt_s]).collect();
        figure = figure.panel(
            Panel::new(name, "rad/s")
                .points("difference of two angles", Colour::Grey, differences)
                .line("true", Colour::Ink, line(&record.speeds))
                .line("estimate", Colour::Blue, line(&found)),
        );
    }
    std::fs::write(&picture, figure.svg()?)?;
    println!("wrote {picture}: {} samples", record.angles.len());
    Ok(())
}

fn read(csv: &str, dt_s: f64) -> Result<Record, Box<dyn Error>> {
    let mut record = Record { dt_s, ..Record::default() };
    for (line, row) in csv.lines().enumerate().skip(1).filter(|(_, row)| !row.trim().is_empty()) {
        let x: Vec<f64> = row
            .split(',')
            .map(|cell| cell.trim().parse())
            .collect::<Result<_, _>>()
            .map_err(|e| format!("line {}: {e}", line + 1))?;
        let three = |at: usize| Some([*x.get(at)?, *x.get(at + 1)?, *x.get(at + 2)?]);
        let (Some(angles), Some(inputs), Some(spin)) = (three(1), three(4), x.get(7)) else {
            return Err(format!("line {}: eight columns are needed", line + 1).into());
        };
        record.angles.push(angles);
        record.inputs.push(inputs);
        record.momentum.push(*spin);
        record.speeds.push(three(8).unwrap_or([f64::NAN; 3]));
    }
    Ok(record)
}

/// Twelve seconds of the rig in software as such a CSV.
fn simulated(plant: &Plant) -> Result<String, Box<dyn Error>> {
    let record = Experiment { duration_s: 12.0, ..Experiment::fast() }.record(plant);
    let mut csv = "t_s,phi,theta,psi,u1,u2,u3,spin,p,q,r\n".to_owned();
    for k in 0..record.angles.len() {
        let ([a, b, c], [u, v, w], [p, q, r]) = (record.angles[k], record.inputs[k], record.speeds[k]);
        let t = k as f64 * record.dt_s;
        writeln!(csv, "{t:.3},{a},{b},{c},{u},{v},{w},{},{p},{q},{r}", record.momentum[k])?;
    }
    Ok(csv)
}
