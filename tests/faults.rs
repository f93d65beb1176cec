//! Faults on recorded flights: each injected one is named, nothing else is, and healthy flights stay silent.
//!
//! The flights are not part of this repository: they are looked for in `$MAVOBSERVER_DATA` or `../shared/data`.

use mavobserver::pipeline::{Event, FaultMask, Fleet, FleetSettings, ObserverSetting};
use mavobserver::vehicle;
use mavobserver::wire;
use mavobserver::wire::tlog::TlogReader;
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

/// Every appearance of a fault between two boot times, s, with its name.
fn told(file: &str, preset: &str, from_s: f64, to_s: f64) -> Option<Vec<(f64, &'static str)>> {
    let log = data(file)?;
    let model = Arc::new(vehicle::resolve(preset).expect("a preset"));
    let observers = vec![ObserverSetting::named("zonotopic_ekf")];
    let settings = FleetSettings { observers, ..FleetSettings::standard(model) };
    let mut fleet = Fleet::new(settings).expect("designs");
    let mut reader = TlogReader::open(&log).expect("a log");
    let (mut before, mut out) = (FaultMask::default(), Vec::new());
    while let Some(record) = reader.next().expect("readable") {
        let wire::Event::Frame(frame) = record.event else { continue };
        fleet.frame(frame, record.received_unix_us.unwrap_or(0), &mut |event| {
            if let Event::Snapshot(s, _) = event {
                let t = s.stamp.secs();
                let new = FaultMask(s.faults.0 & !before.0);
                before = s.faults;
                out.extend(new.names().filter(|_| (from_s..to_s).contains(&t)).map(|name| (t, name)));
            }
        });
    }
    Some(out)
}

/// These faults in this order, each within its time from its injection, and no other.
fn assert_told(file: &str, preset: &str, flown_s: [f64; 2], injected: &[(f64, &str, f64)]) {
    let Some(told) = told(file, preset, flown_s[0], flown_s[1]) else { return };
    let names = |told: &[(f64, &str)]| told.iter().map(|t| t.1.to_owned()).collect::<Vec<_>>();
    assert_eq!(names(&told), injected.iter().map(|i| i.1.to_owned()).collect::<Vec<_>>(), "{file}: {told:?}");
    for ((t, name), (at, _, within_s)) in told.iter().zip(injected) {
        assert!((0.0..*within_s).contains(&(t - at)), "{file}: {name} injected at {at} s, told at {t} s");
    }
}

#[test]
fn rotors() {
    assert_told("sitl/rotor_dev.tlog", "arducopter-sitl", [69.6, 95.7], &[(83.68, "rotor_4", 0.3)]);
    let weak = [(78.90, "rotor_1", 2.0), (128.99, "rotor_3", 2.0)];
    assert_told("sitl/motor_degrade.tlog", "arducopter-sitl", [63.9, 1e9], &weak);
    // 5 % of a rotor's thrust hides in the noise of this vehicle; 10 %, ten seconds later, does not
    let weak = [(51.22, "rotor_1", 13.0), (90.61, "rotor_3", 13.0)];
    assert_told("px4/motor_degrade.tlog", "px4-sih", [36.4, 130.3], &weak);
}

#[test]
fn sensors() {
    let injected = [(72.22, "accel", 1.0), (92.26, "gyro", 1.0), (110.29, "baro", 0.5), (126.34, "gnss_position", 0.3)];
    assert_told("sitl/sensor_dev.tlog", "arducopter-sitl", [60.2, 1e9], &injected);
}

#[test]
fn payload() {
    assert_told("px4/payload.tlog", "px4-sih", [36.2, 118.4], &[(50.46, "payload", 1.2)]);
}

#[test]
fn healthy_flights_stay_silent() {
    assert_told("sitl/wind_dev.tlog", "arducopter-sitl", [0.0, 1e9], &[]);
    assert_told("px4/wind_dev.tlog", "px4-sih", [0.0, 1e9], &[]);
    assert_told("sitl/default_streams.tlog", "arducopter-sitl", [0.0, 1e9], &[]);
    assert_told("sitl/mavlink1_req4.tlog", "arducopter-sitl", [0.0, 1e9], &[]);
    assert_told("px4/default_streams.tlog", "px4-sih", [0.0, 1e9], &[]);
    // real, lossy, inertial data once a second
    assert_told("real/phoenix_m1.tlog", "arducopter-sitl", [0.0, 1e9], &[]);
}
