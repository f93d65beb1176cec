//! Attitude from raw sensors on recorded flights, held against the simulators' truth.
//!
//! The flights are not part of this repository: they are looked for in `$MAVOBSERVER_DATA` or `../shared/data`.

use mavobserver::pipeline::{Event, Fleet, FleetSettings, ObserverSetting};
use mavobserver::vehicle;
use mavobserver::wire::tlog::TlogReader;
use mavobserver::wire::{self, FrameRef};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

fn data(file: &str) -> Option<PathBuf> {
    let root = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join(file);
    if !path.exists() {
        eprintln!("SKIPPED: no {} (set MAVOBSERVER_DATA)", path.display());
        return None;
    }
    Some(path)
}

/// An attitude and velocity at a boot time.
#[derive(Debug, Clone, Copy)]
struct Point {
    t: f64,
    attitude: UnitQuaternion<f64>,
    velocity: Vector3<f64>,
}

/// What was estimated from raw sensors, and the attitude that the autopilot had.
struct Flown {
    own: Vec<Point>,
    autopilot: Vec<Point>,
}

fn replay(log: &Path, preset: &str, mut each: impl FnMut(FrameRef<'_>)) -> Flown {
    let model = Arc::new(vehicle::resolve(preset).expect("a preset"));
    let only = ObserverSetting::named("gnss_ins");
    let settings = FleetSettings { observers: vec![only], ..FleetSettings::standard(model) };
    let mut fleet = Fleet::new(settings).expect("gains");
    let mut reader = TlogReader::open(log).expect("a log");
    let mut flown = Flown { own: Vec::new(), autopilot: Vec::new() };
    while let Some(record) = reader.next().expect("readable") {
        let wire::Event::Frame(frame) = record.event else { continue };
        each(frame);
        fleet.frame(frame, record.received_unix_us.unwrap_or(0), &mut |event| {
            let Event::Snapshot(s, m) = event else { return };
            let t = s.stamp.secs();
            let report = s.observers.iter().next().expect("the observer");
            let v = &report.estimate.values;
            if v.iter().any(|x| *x != 0.0) {
                let attitude = UnitQuaternion::from_euler_angles(v[0], v[1], v[2]);
                flown.own.push(Point { t, attitude, velocity: Vector3::from_row_slice(&v[3..6]) });
            }
            if let (Some(q), Some(u)) = (m.attitude, m.velocity_ned_mps) {
                flown.autopilot.push(Point { t, attitude: q.value, velocity: u.value });
            }
        });
    }
    flown
}

/// RMS of the angle between attitudes and of the heading's error (degrees), and of the velocity's error (m/s), from a
/// time on.
fn errors(points: &[Point], truth: &[Point], from_s: f64) -> [f64; 3] {
    let (mut sums, mut n) = ([0.0; 3], 0.0);
    for p in points.iter().filter(|p| p.t >= from_s) {
        let k = truth.partition_point(|x| x.t < p.t);
        let (Some(b), Some(a)) = (truth.get(k), k.checked_sub(1).and_then(|k| truth.get(k))) else { continue };
        let share = (p.t - a.t) / (b.t - a.t);
        let exact = a.attitude.try_slerp(&b.attitude, share, 1e-9).unwrap_or(a.attitude);
        let off = (p.attitude * exact.inverse()).scaled_axis().map(f64::to_degrees);
        let by = p.velocity - a.velocity.lerp(&b.velocity, share);
        sums[0] += off.norm_squared();
        sums[1] += off.z * off.z;
        sums[2] += by.norm_squared();
        n += 1.0;
    }
    assert!(n > 1000.0, "only {n} points with a truth");
    sums.map(|s| (s / n).sqrt())
}

/// SIM_STATE has no stamp: it is sent in the same loop as HIGHRES_IMU, which has one.
#[test]
fn attitude_of_simulated_copters() {
    for file in ["wind_dev", "wind_turb", "force_dev"] {
        let Some(log) = data(&format!("sitl/{file}.tlog")) else { return };
        let (mut stamps, mut states) = (Vec::new(), Vec::new());
        let flown = replay(&log, "arducopter-sitl", |frame| {
            let f = frame.fields();
            let at = |o: usize| f64::from(f.f32(o));
            match frame.message_id() {
                105 => stamps.push(f.u64(0) as f64 * 1e-6),
                108 => {
                    let q = UnitQuaternion::from_quaternion(Quaternion::new(at(0), at(4), at(8), at(12)));
                    states.push((q, Vector3::new(at(72), at(76), at(80))));
                }
                _ => {}
            }
        });
        assert_eq!(stamps.len(), states.len(), "{file}: frames were lost");
        let truth: Vec<_> =
            stamps.iter().zip(states).map(|(&t, (attitude, velocity))| Point { t, attitude, velocity }).collect();
        let start = flown.own.first().expect("estimates").t + 30.0;
        let [angle, yaw, velocity] = errors(&flown.own, &truth, start);
        let [theirs, their_yaw, _] = errors(&flown.autopilot, &truth, start);
        println!(
            "{file}: {angle:.2}° (heading {yaw:.2}°), {velocity:.3} m/s; autopilot {theirs:.2}° ({their_yaw:.2}°)"
        );
        assert!(angle <= 2.5, "{file}: attitude RMSE {angle}°");
        assert!(velocity <= 0.15, "{file}: velocity RMSE {velocity} m/s");
    }
}

#[test]
fn heading_of_a_simulated_px4_copter_is_twice_as_good_as_the_autopilots() {
    let Some(log) = data("px4/wind_dev.tlog") else { return };
    let flown = replay(&log, "px4-sih", |_| {});
    let text = std::fs::read_to_string(log.with_extension("truth.csv")).expect("readable");
    let truth: Vec<_> = text
        .lines()
        .skip(1)
        .map(|line| {
            let x: Vec<f64> = line.split(',').map(|c| c.parse().expect("a number")).collect();
            let attitude = UnitQuaternion::from_quaternion(Quaternion::new(x[1], x[2], x[3], x[4]));
            Point { t: x[0] * 1e-3, attitude, velocity: Vector3::new(x[11], x[12], x[13]) }
        })
        .collect();
    let start = flown.own.first().expect("estimates").t + 30.0;
    let [angle, yaw, velocity] = errors(&flown.own, &truth, start);
    let [theirs, their_yaw, _] = errors(&flown.autopilot, &truth, start);
    println!("{angle:.2}° (heading {yaw:.2}°), {velocity:.3} m/s; autopilot {theirs:.2}° ({their_yaw:.2}°)");
    assert!(yaw <= 0.5 * their_yaw, "heading RMSE {yaw}° against {their_yaw}°");
}
