//! Attitude, velocity and position from a CSV of raw sensor samples, without MAVLink, and a picture of them.
//!
//! ```sh
//! cargo run --release --example gnss_ins_csv                          # a simulated flight
//! cargo run --release --example gnss_ins_csv -- samples.csv out.svg   # your own
//! ```
//!
//! One row per inertial sample, with a header. Columns: `t_s`; specific force `ax,ay,az` (m/s², body FRD, −9.81 in z at
//! rest); rates `gx,gy,gz` (rad/s); field `mx,my,mz` (gauss); and, in rows that bring a new fix, its position `n,e,d`
//! (m from any fixed origin) and velocity `vn,ve` (m/s); empty elsewhere. The declination is that of the place.

use mavobserver::observers::Observer;
use mavobserver::observers::cascade_gnss_ins::{NavigationGains, NavigationObserver, NavigationSettings};
use mavobserver::report::{Colour, Figure, Panel};
use mavobserver::signal::{FixType, GnssFix, Held, Imu, MagField, MagSource, Measurement, Stamp};
use mavobserver::sim::control::Leg;
use mavobserver::sim::{FlightPlan, SimVehicle};
use mavobserver::vehicle;
use nalgebra::Vector3;
use std::error::Error;
use std::fmt::Write;

/// East of north, rad: that of the simulated place.
const DECLINATION_RAD: f64 = 0.22;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let csv = match args.next() {
        Some(file) => std::fs::read_to_string(file)?,
        None => simulated()?,
    };
    let picture = args.next().unwrap_or_else(|| "gnss_ins.svg".to_owned());

    let settings = NavigationSettings { declination_rad: Some(DECLINATION_RAD), ..NavigationSettings::default() };
    let gains = NavigationGains::new(&settings.goal)?;
    println!(
        "‖H‖ of the level axes: {:.3} (Theorem 1 asks for less than {})",
        gains.norms[0].upper, settings.goal.gamma
    );
    let mut observer = NavigationObserver::new(settings, gains);

    let (mut attitude, mut velocity) = (vec![Vec::new(); 3], vec![Vec::new(); 3]);
    let mut fixes: Option<Held<GnssFix>> = None;
    for (line, row) in csv.lines().skip(1).enumerate() {
        let x: Vec<Option<f64>> = row.split(',').map(|cell| cell.trim().parse().ok()).collect();
        let three = |at: usize| Some(Vector3::new((*x.get(at)?)?, (*x.get(at + 1)?)?, (*x.get(at + 2)?)?));
        let needed = (x.first().copied().flatten(), three(1), three(4), three(7));
        let (Some(t), Some(accel), Some(rate), Some(field)) = needed else {
            return Err(format!("line {}: expected numbers in the first ten columns", line + 2).into());
        };
        let stamp = Stamp::from_secs(t);
        let mut m = Measurement::new(stamp, Imu { accel_frd_mps2: accel, rate_frd_rads: rate });
        let mag = MagField { field_frd_gauss: field, source: MagSource::HighRes };
        m.magnetometer = Some(Held { value: mag, stamp, age_s: 0.0, sequence: 0, new: true });
        match three(10) {
            Some(position) => {
                let ground = x.get(13).copied().flatten().zip(x.get(14).copied().flatten());
                let value = fix(position, ground.map(|(n, e)| [n, e]));
                fixes =
                    Some(Held { value, stamp, age_s: 0.0, sequence: fixes.map_or(1, |f| f.sequence + 1), new: true });
            }
            None => fixes = fixes.map(|f| Held { new: false, age_s: stamp - f.stamp, ..f }),
        }
        m.gnss = fixes;
        let values = &observer.step(&m)?.values;
        for k in 0..3 {
            attitude[k].push([t, values[k].to_degrees()]);
            velocity[k].push([t, values[3 + k]]);
        }
    }

    let panel = |title: &str, unit: &str, names: [&str; 3], lines: &[Vec<[f64; 2]>]| {
        names.iter().zip(lines).enumerate().fold(Panel::new(title, unit), |panel, (k, (name, points))| {
            panel.line(*name, Colour::nth(k), points.iter().copied())
        })
    };
    let figure = Figure::new("Attitude and velocity from raw sensors")
        .x("time", "s")
        .panel(panel("attitude", "deg", ["roll", "pitch", "yaw"], &attitude))
        .panel(panel("velocity", "m/s", ["north", "east", "down"], &velocity));
    std::fs::write(&picture, figure.svg()?)?;
    println!("wrote {picture}: {} samples, ends as {:?}", attitude[0].len(), observer.estimate().verdict);
    Ok(())
}

/// A fix of which only position and level velocity are known.
fn fix(position: Vector3<f64>, ground_velocity_mps: Option<[f64; 2]>) -> GnssFix {
    GnssFix {
        fix_type: FixType::ThreeD,
        latitude_deg: 0.0,
        longitude_deg: 0.0,
        altitude_m: 0.0,
        position_ned_m: Some(position),
        ground_velocity_mps,
        down_velocity_mps: None,
        hdop: None,
        vdop: None,
        horizontal_accuracy_m: None,
        vertical_accuracy_m: None,
        speed_accuracy_mps: None,
        satellites: None,
        unix_s: None,
    }
}

/// A minute of a simulated flight as such a CSV.
fn simulated() -> Result<String, Box<dyn Error>> {
    let mut plan = FlightPlan::calm(vehicle::resolve("arducopter-sitl")?, 1);
    plan.sensors.gnss.latency_s = 0.0;
    plan.mission = vec![
        Leg::Wait { seconds: 3.0 },
        Leg::Takeoff { height_m: 10.0 },
        Leg::Goto { position_ned_m: Vector3::new(40.0, 0.0, -10.0), speed_mps: 6.0 },
        Leg::Turn { heading_rad: 1.0 },
        Leg::Circle { radius_m: 15.0, speed_mps: 5.0, seconds: 25.0, nose_ahead: true },
    ];
    let mut flight = SimVehicle::new(&plan)?;
    let mut csv = "t_s,ax,ay,az,gx,gy,gz,mx,my,mz,n,e,d,vn,ve\n".to_owned();
    let (mut field, mut fix) = (Vector3::zeros(), None);
    for k in 0..400 * 60 {
        let moment = flight.advance();
        let r = &moment.readings;
        field = r.mag_frd_gauss.unwrap_or(field);
        fix = r.gnss.or(fix);
        if k % 4 > 0 {
            continue;
        }
        let (t, a, g) = (moment.truth.stamp.secs(), r.imu[0].accel_frd_mps2, r.imu[0].rate_frd_rads);
        write!(csv, "{t},{},{},{},{},{},{},{},{},{}", a.x, a.y, a.z, g.x, g.y, g.z, field.x, field.y, field.z)?;
        match fix.take() {
            Some(f) => {
                let (p, v) = (f.position_ned_m, f.velocity_ned_mps);
                writeln!(csv, ",{},{},{},{},{}", p.x, p.y, p.z, v.x, v.y)?;
            }
            None => csv.push_str(",,,,,\n"),
        }
    }
    Ok(csv)
}
