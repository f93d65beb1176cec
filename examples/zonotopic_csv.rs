//! Intervals for the states of a model of one's own, from a CSV file: no vehicle and no MAVLink in sight.
//!
//!     cargo run --example zonotopic_csv                      # makes its own data: pendulum.csv, pendulum.svg
//!     cargo run --example zonotopic_csv -- my.csv my.svg
//!
//! A pendulum whose friction is known to ±20 % is driven by a known torque. The file has the columns `time_s`,
//! `torque_nm` and `angle_rad`, the angle read to ±0.02 rad; the speed is measured by nothing. A column
//! `true_speed_rads` is drawn beside the interval when there is one.

use mavobserver::observers::zonotopic_ekf::{
    Differentiated, Equations, FilterSettings, Mode, Output, Smooth, ZonotopicFilter,
};
use mavobserver::report::{Colour, Figure, Panel};
use mavobserver::sets::{Interval, Overlap, Reduction};
use nalgebra::{SVector, vector};
use rand::{RngExt, SeedableRng};
use std::error::Error;
use std::path::{Path, PathBuf};

const NOISE_RAD: f64 = 0.02;
const FRICTION: f64 = 0.1;
/// Share by which friction may differ, and the fastest that the pendulum is expected to swing, rad/s.
const FRICTION_SHARE: f64 = 0.2;
const FASTEST_RADS: f64 = 6.0;

/// Angle from hanging down (rad) and speed (rad/s); unit mass and length.
struct Pendulum;

/// What drives one step: its length, s, and the torque, N m.
struct Step {
    dt_s: f64,
    torque_nm: f64,
}

impl Equations<2> for Pendulum {
    type Input = Step;

    // semi-implicit Euler: what it misses of the continuous motion is part of the disturbance below
    fn next<S: Smooth>(&self, x: &[S; 2], step: &Step) -> [S; 2] {
        let [angle, speed] = *x;
        let acceleration = S::constant(step.torque_nm) - angle.sin() * 9.81 - speed * FRICTION;
        let speed = speed + acceleration * step.dt_s;
        [angle + speed * step.dt_s, speed]
    }

    fn disturbance(&self, step: &Step) -> SVector<f64, 2> {
        let friction = FRICTION * FRICTION_SHARE * FASTEST_RADS;
        // half a step squared times the largest jerk that occurs
        let euler = 0.5 * step.dt_s * 80.0;
        vector![step.dt_s * step.dt_s * (friction + 20.0), step.dt_s * (friction + euler)]
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let csv = arguments.next().unwrap_or_else(|| PathBuf::from("pendulum.csv"));
    let svg = arguments.next().unwrap_or_else(|| csv.with_extension("svg"));
    if !csv.exists() {
        make(&csv)?;
    }
    let rows = read(&csv)?;
    let settings =
        FilterSettings { mode: Mode::Guaranteed, reduction: Reduction::Girard, order: 10, weights: vector![1.0, 0.2] };
    let first = rows.first().ok_or("the file has no rows")?;
    let start = [Interval::centred(first.angle_rad, NOISE_RAD), Interval::centred(0.0, FASTEST_RADS)];
    let mut filter: ZonotopicFilter<2, 24> = ZonotopicFilter::new(&start, settings);
    let model = Differentiated(Pendulum);

    let (mut angles, mut speeds) = (Vec::new(), Vec::new());
    for pair in rows.windows(2) {
        let [before, now] = pair else { continue };
        let step = Step { dt_s: now.time_s - before.time_s, torque_nm: before.torque_nm };
        filter.predict(&model, &step)?;
        let mut told = [Overlap::default()];
        let output = Output::of_state("angle", 0, now.angle_rad, NOISE_RAD).ok_or("no such state")?;
        filter.correct(&[output], &mut told);
        if !told[0].touches() {
            eprintln!("{:.2} s: model and data contradict each other", now.time_s);
        }
        let [angle, speed] = filter.hull();
        angles.push([now.time_s, angle.lo(), angle.hi()]);
        speeds.push([now.time_s, speed.lo(), speed.hi()]);
    }
    let truth = rows.iter().filter_map(|r| Some([r.time_s, r.true_speed_rads?]));
    let measured = rows.iter().map(|r| [r.time_s, r.angle_rad]);
    let figure = Figure::new("A pendulum between bounds")
        .x("time", "s")
        .panel(Panel::new("angle", "rad").band("interval", Colour::Blue, angles).points("read", Colour::Grey, measured))
        .panel(Panel::new("speed", "rad/s").band("interval", Colour::Blue, speeds).line("true", Colour::Ink, truth));
    std::fs::write(&svg, figure.svg()?)?;
    println!("{} rows of {}, drawn in {}", rows.len(), csv.display(), svg.display());
    Ok(())
}

struct Row {
    time_s: f64,
    torque_nm: f64,
    angle_rad: f64,
    true_speed_rads: Option<f64>,
}

fn read(path: &Path) -> Result<Vec<Row>, Box<dyn Error>> {
    let text = std::fs::read_to_string(path)?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().ok_or("the file is empty")?.split(',').collect();
    let column = |name: &str| head.iter().position(|h| h.trim() == name);
    let need = |name: &str| column(name).ok_or_else(|| format!("there is no column `{name}`"));
    let (time, torque, angle) = (need("time_s")?, need("torque_nm")?, need("angle_rad")?);
    let mut rows = Vec::new();
    for line in lines.filter(|l| !l.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').collect();
        let number =
            |i: usize| -> Result<f64, Box<dyn Error>> { Ok(cells.get(i).ok_or("a row is too short")?.trim().parse()?) };
        rows.push(Row {
            time_s: number(time)?,
            torque_nm: number(torque)?,
            angle_rad: number(angle)?,
            true_speed_rads: column("true_speed_rads").map(number).transpose()?,
        });
    }
    Ok(rows)
}

/// Twenty seconds of a pendulum whose friction is 15 % larger than the model's.
fn make(path: &Path) -> Result<(), Box<dyn Error>> {
    let mut rng = rand::rngs::StdRng::seed_from_u64(1);
    let (mut angle, mut speed): (f64, f64) = (0.8, 0.0);
    let mut text = "time_s,torque_nm,angle_rad,true_speed_rads\n".to_owned();
    for k in 0..1000 {
        let time = 0.02 * f64::from(k);
        let torque = 2.0 * (1.5 * time).sin();
        let read = angle + NOISE_RAD * rng.random_range(-1.0..1.0);
        text.push_str(&format!("{time:.3},{torque:.6},{read:.6},{speed:.6}\n"));
        for _ in 0..20 {
            speed += 0.001 * (torque - 9.81 * angle.sin() - 1.15 * FRICTION * speed);
            angle += 0.001 * speed;
        }
    }
    Ok(std::fs::write(path, text)?)
}
