//! The torque that acts on a body whose mass and inertia change, on a model of one's own and a plain CSV, without
//! MAVLink.
//!
//! ```sh
//! cargo run --release --example torque_csv                       # makes its own data
//! cargo run --release --example torque_csv -- torque.csv out.svg # your own
//! ```
//!
//! Designs the unknown-input observer for every body between two, proves its decay rate, and runs it. One row per
//! sample, with a header. Columns: `t_s`; quaternion body to world `qw,qx,qy,qz`; body rates `p,q,r` (rad/s); the known
//! torque since the row before, `l,m,n` (N m); and the mass (kg), from which the inertia is interpolated. Columns
//! `dl,dm,dn` with the true unknown torque are drawn beside the estimates.

use mavobserver::observers::unknown_input::{Body, Objective, TorqueFilter, TorqueStep, attitude_of, design};
use mavobserver::report::{Colour, Figure, Panel};
use nalgebra::{Matrix3, Matrix6, Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use std::error::Error;
use std::fmt::Write;

/// The lightest and the heaviest body: kg, and kg m² about each axis.
const LIGHT: (f64, [f64; 3]) = (1.12, [0.0119, 0.0119, 0.0223]);
const HEAVY: (f64, [f64; 3]) = (2.0, [0.0142, 0.0142, 0.0267]);
/// Yaw rate up to which the proof holds, rad/s.
const YAW_RADS: f64 = 3.0;
/// Error decay of attitude and rate, 1/s, and time constant of the torque, s.
const DECAY: f64 = 5.0;
const TAU_S: f64 = 0.05;

fn body((mass_kg, inertia): (f64, [f64; 3])) -> Body {
    Body { mass_kg, inertia_kgm2: Matrix3::from_diagonal(&Vector3::from(inertia)) }
}

/// The inertia at a mass between the two.
fn inertia_at(mass_kg: f64) -> Matrix3<f64> {
    let share = ((mass_kg - LIGHT.0) / (HEAVY.0 - LIGHT.0)).clamp(0.0, 1.0);
    body(LIGHT).inertia_kgm2 * (1.0 - share) + body(HEAVY).inertia_kgm2 * share
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let csv = match arguments.next() {
        Some(path) => std::fs::read_to_string(path)?,
        None => simulated()?,
    };
    let picture = arguments.next().unwrap_or_else(|| "torque.svg".to_owned());
    let plant = attitude_of(&body(LIGHT), &body(HEAVY), YAW_RADS, 0.0).ok_or("an inertia is singular")?;
    let made = design(&plant, Objective::SmallestGain { decay: DECAY })?;
    println!("errors decay as e^(-{} t) for every body between the two; margin {:.1e}", made.decay, made.margin);
    // the corners differ in what Q takes out alone, so that one gain serves
    let gain = made.gains.first().map(|l| Matrix6::from_fn(|i, j| l[(i, j)])).ok_or("no gain")?;
    let mut filter = TorqueFilter::new(&gain, Vector3::repeat(TAU_S));

    let (mut found, mut true_torque) = (vec![Vec::new(); 3], vec![Vec::new(); 3]);
    let (mut mass, mut last_s) = (Vec::new(), None);
    for (line, row) in csv.lines().enumerate().skip(1).filter(|(_, row)| !row.trim().is_empty()) {
        let x: Vec<f64> = row
            .split(',')
            .map(|cell| cell.trim().parse())
            .collect::<Result<_, _>>()
            .map_err(|e| format!("line {}: {e}", line + 1))?;
        if x.len() < 12 {
            return Err(format!("line {}: twelve columns are needed", line + 1).into());
        }
        let three = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
        let t = x[0];
        filter.step(&TorqueStep {
            dt_s: last_s.replace(t).map_or(0.0, |last| t - last),
            body_to_ned: UnitQuaternion::from_quaternion(Quaternion::new(x[1], x[2], x[3], x[4])),
            rate_frd_rads: three(5),
            torque_frd_nm: three(8),
            rotors_frd_nms: Vector3::zeros(),
            inertia_kgm2: inertia_at(x[11]),
        });
        mass.push([t, x[11]]);
        let torque = filter.torque_frd_nm();
        for k in 0..3 {
            found[k].push([t, 1e3 * torque[k]]);
            if let Some(exact) = x.get(12 + k) {
                true_torque[k].push([t, 1e3 * exact]);
            }
        }
    }
    let mut figure = Figure::new("Unknown torque on a body that drops its load").x("time", "s");
    for (k, name) in ["roll", "pitch", "yaw"].into_iter().enumerate() {
        let panel = Panel::new(name, "mN m").line("found", Colour::Blue, found[k].iter().copied());
        figure = figure.panel(panel.line("true", Colour::Ink, true_torque[k].iter().copied()));
    }
    let figure = figure.panel(Panel::new("mass", "kg").line("mass", Colour::nth(3), mass));
    std::fs::write(&picture, figure.svg()?)?;
    println!("wrote {picture}: {} samples", found[0].len());
    Ok(())
}

/// Twelve seconds at 200 Hz: the load falls off at 4 s and is taken up again at 9 s, and unknown torques come and go.
fn simulated() -> Result<String, Box<dyn Error>> {
    let mut rng = rand::rngs::StdRng::seed_from_u64(1);
    let mut csv = "t_s,qw,qx,qy,qz,p,q,r,l,m,n,mass_kg,dl,dm,dn\n".to_owned();
    let (mut attitude, mut rate) = (UnitQuaternion::identity(), Vector3::<f64>::zeros());
    let mut known = Vector3::zeros();
    for k in 0..2400 {
        let t = 0.005 * f64::from(k);
        let mass = if (4.0..9.0).contains(&t) { LIGHT.0 } else { HEAVY.0 };
        let unknown = Vector3::new(
            if t > 2.0 { 0.05 } else { 0.0 },
            0.04 * (1.5 * t).sin(),
            if (6.0..6.3).contains(&t) { 0.02 } else { 0.0 },
        );
        let noise = Vector3::from_fn(|_, _| 2e-3 * rng.random_range(-1.7..1.7));
        let (q, w) = (attitude.quaternion(), rate + noise);
        write!(csv, "{t:.3},{},{},{},{},{},{},{}", q.w, q.i, q.j, q.k, w.x, w.y, w.z)?;
        writeln!(csv, ",{},{},{},{mass},{},{},{}", known.x, known.y, known.z, unknown.x, unknown.y, unknown.z)?;
        // held from here to the next row
        known = -(attitude.scaled_axis() * 0.6 + rate * 0.13);
        let inertia = inertia_at(mass);
        for _ in 0..20 {
            let torque = known + unknown - rate.cross(&(inertia * rate));
            let next = rate + torque.component_div(&inertia.diagonal()) * 2.5e-4;
            attitude *= UnitQuaternion::from_scaled_axis((rate + next) * 1.25e-4);
            rate = next;
        }
    }
    Ok(csv)
}
