//! Force, torque, mass and wind from a plain CSV and a vehicle of one's own, without MAVLink.
//!
//! ```sh
//! cargo run --example wrench_csv                                   # makes a flight of its own
//! cargo run --example wrench_csv -- flight.csv my-quad.toml        # t,ax,ay,az,p,q,r,qw,qx,qy,qz,vn,ve,vd,u1..u4
//! ```
//!
//! Columns: time (s), specific force (m/s²) and body rate (rad/s) in FRD, quaternion body to NED, velocity NED (m/s), and
//! rotor commands from 0 to 1. The picture goes to `wrench.svg` in the folder for temporary files.

use mavobserver::document::Document;
use mavobserver::observers::{Options, build};
use mavobserver::report::{Colour, Figure, Panel};
use mavobserver::signal::{
    Actuation, Aged, Discontinuity, Imu, MAX_ROTORS, Measurement, RotorCommands, Stamp, Verdict,
};
use mavobserver::vehicle::{self, Air, SEA_LEVEL_KGM3, Vehicle};
use mavobserver::wind::{Flow, WindObserver};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::error::Error;
use std::fmt::Write;
use std::path::Path;

/// A vehicle file of one's own; what is not given has a default.
const QUAD: &str = r#"
name = "my quad"
mass_kg = { nominal = 1.2, percent = 1 }
inertia_kgm2 = [0.012, 0.012, 0.022]

[[rotor]]
position_frd_m = [0.16, 0.16, 0.0]
spin = "ccw"
torque_ratio_m = 0.016
[[rotor]]
position_frd_m = [-0.16, -0.16, 0.0]
spin = "ccw"
torque_ratio_m = 0.016
[[rotor]]
position_frd_m = [0.16, -0.16, 0.0]
spin = "cw"
torque_ratio_m = 0.016
[[rotor]]
position_frd_m = [-0.16, 0.16, 0.0]
spin = "cw"
torque_ratio_m = 0.016

[thrust]
max_n = { nominal = 7.5, percent = 2 }
expo = 1.0

[rotor_dynamics]
time_constant_s = 0.0

[drag]
linear_n_per_mps = { nominal = 0.35, percent = 10 }

[noise]
accel_mps2 = 0.1
accel_bias_mps2 = 0.05
velocity_mps = 0.1
tilt_deg = 0.5
yaw_deg = 3
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let csv = match arguments.next() {
        Some(path) => std::fs::read_to_string(path)?,
        None => synthetic(),
    };
    let vehicle = match arguments.next() {
        Some(path) => vehicle::from_file(Path::new(&path))?,
        None => vehicle::parse(&Document::new("my-quad.toml", QUAD)).map_err(|issues| issues.to_string())?,
    };
    let mut wrench = build("quadratic_bounded", &vehicle, Options::default())?;
    let mut torque = build("unknown_input", &vehicle, Options::default())?;
    let mut wind = WindObserver::default();

    let (mut force_east, mut force_band) = (Vec::new(), Vec::new());
    let (mut wind_east, mut wind_band, mut roll, mut mass) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut last = None;
    for line in csv.lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(str::trim).map(str::parse).collect::<Result<_, _>>()?;
        let m = measurement(&vehicle, &row, last.replace(row.first().copied().unwrap_or_default()))?;
        let t = m.stamp.secs();
        torque.step(&m)?;
        let e = wrench.step(&m)?;
        if matches!(e.verdict, Verdict::Starved | Verdict::Grounded) {
            continue;
        }
        force_east.push([t, e.values[1]]);
        force_band.push([t, e.values[1] - e.half_widths[1], e.values[1] + e.half_widths[1]]);
        let (roll_nm, mass_kg) = (torque.estimate().values[0], torque.estimate().values[3]);
        roll.push([t, roll_nm]);
        mass.push([t, mass_kg]);
        if let Some(w) = flow(&vehicle, &m).and_then(|flow| wind.step(&vehicle, &flow, m.dt_s)) {
            let (east, half) = (w.velocity_ned_mps.y, w.half_width_mps.y);
            wind_east.push([t, east]);
            wind_band.push([t, east - half, east + half]);
        }
    }
    let picture = Figure::new(format!("What acts on {}", vehicle.name))
        .x("time", "s")
        .panel(Panel::new("Force, east", "N").band("bound", Colour::Blue, force_band).line(
            "force",
            Colour::Blue,
            force_east,
        ))
        .panel(Panel::new("Wind, east", "m/s").band("bound", Colour::nth(1), wind_band).line(
            "wind",
            Colour::nth(1),
            wind_east,
        ))
        .panel(Panel::new("Torque, roll", "N m").line("torque", Colour::nth(2), roll))
        .panel(Panel::new("Mass", "kg").line("mass", Colour::nth(3), mass));
    let path = std::env::temp_dir().join("wrench.svg");
    std::fs::write(&path, picture.svg()?)?;
    println!("wrote {}", path.display());
    Ok(())
}

/// One row as the observers want it.
fn measurement(vehicle: &Vehicle, row: &[f64], last_s: Option<f64>) -> Result<Measurement, Box<dyn Error>> {
    let rotors = vehicle.rotors.len();
    if row.len() < 14 + rotors {
        return Err(format!("a row has {} columns, {} are needed", row.len(), 14 + rotors).into());
    }
    let three = |at: usize| Vector3::new(row[at], row[at + 1], row[at + 2]);
    let imu = Imu { accel_frd_mps2: three(1), rate_frd_rads: three(4) };
    let mut m = Measurement::new(Stamp::from_secs(row[0]), imu);
    m.dt_s = last_s.map_or(0.0, |last| row[0] - last);
    m.discontinuity = last_s.is_none().then_some(Discontinuity::First);
    let now = |value| Some(Aged { value, age_s: 0.0 });
    m.attitude = Some(Aged {
        value: UnitQuaternion::from_quaternion(Quaternion::new(row[7], row[8], row[9], row[10])),
        age_s: 0.0,
    });
    m.velocity_ned_mps = now(three(11));
    let mut commands = RotorCommands { command: [0.0; MAX_ROTORS], count: rotors };
    commands.command[..rotors].copy_from_slice(&row[14..14 + rotors]);
    // a CSV rarely has voltage and density; a model that needs them would say so in its doubt
    let air = Air { voltage_v: None, density_kgm3: None, climb_mps: 0.0 };
    let (w, sum_sqrt_thrust) = vehicle.rotor_wrench(&commands, air);
    m.actuation = Some(Aged {
        value: Actuation {
            rotors: commands,
            force_frd_n: w.force_frd_n,
            torque_frd_nm: w.torque_frd_nm,
            sum_sqrt_thrust,
            inflow_n_per_mps2: 0.0,
            doubt: vehicle.thrust.doubt(air),
            climb_mps: 0.0,
        },
        age_s: 0.0,
    });
    Ok(m)
}

fn flow(vehicle: &Vehicle, m: &Measurement) -> Option<Flow> {
    Some(Flow {
        imu: m.imu,
        body_to_ned: m.attitude?.value,
        yaw_rad: vehicle.noise.yaw_rad,
        velocity_ned_mps: m.velocity_ned_mps?.value,
        gnss_velocity_mps: None,
        actuation: m.actuation?.value,
        density_kgm3: SEA_LEVEL_KGM3,
        force: None,
    })
}

/// Twenty seconds of hover: wind of 4 m/s towards east from 5 s on, against which the vehicle holds itself by leaning.
fn synthetic() -> String {
    let mut csv = "t,ax,ay,az,p,q,r,qw,qx,qy,qz,vn,ve,vd,u1,u2,u3,u4\n".to_owned();
    let (mass, gravity) = (1.2, 9.80665);
    for k in 0..1000 {
        let t = f64::from(k) * 0.02;
        // built up within half a second
        let east = 0.35 * 4.0 * ((t - 5.0) / 0.5).clamp(0.0, 1.0);
        // leaning to the west so far that thrust balances wind and weight
        let lean = -(east / (mass * gravity)).atan();
        let q = UnitQuaternion::from_euler_angles(lean, 0.0, 0.0);
        let thrust = (mass * gravity).hypot(east);
        let specific = q.inverse() * Vector3::new(0.0, east, 0.0) / mass - Vector3::z() * (thrust / mass);
        let shake = 0.03 * (37.0 * t).sin();
        let u = (thrust / 4.0 / 7.5).sqrt();
        // writing to a String cannot fail
        let _ = writeln!(
            csv,
            "{t},{},{},{},0,0,0,{},{},{},{},0,0,0,{u},{u},{u},{u}",
            specific.x + shake,
            specific.y - shake,
            specific.z + shake,
            q.w,
            q.i,
            q.j,
            q.k,
        );
    }
    csv
}
