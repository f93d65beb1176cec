//! `mavobserver identify` on recorded and simulated flights whose vehicle is known.

use assert_cmd::cargo::cargo_bin_cmd;
use mavobserver::observers::Options;
use serde_json::Value;
use std::path::{Path, PathBuf};

fn flight(path: &str) -> Option<PathBuf> {
    let base = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let file = base.join(path);
    if !file.exists() {
        eprintln!("SKIPPED: {} is not here; set MAVOBSERVER_DATA", file.display());
        return None;
    }
    Some(file)
}

fn identify(log: &Path, arguments: &[&str]) -> Value {
    let mut command = cargo_bin_cmd!("mavobserver");
    let output = command.arg("-q").arg("identify").arg(log).args(arguments).arg("--json").assert().success();
    serde_json::from_slice(&output.get_output().stdout).unwrap()
}

fn number(report: &Value, pointer: &str) -> f64 {
    report.pointer(pointer).and_then(Value::as_f64).unwrap_or_else(|| panic!("no {pointer} in {report:#}"))
}

fn within(report: &Value, pointer: &str, truth: f64, share: f64) {
    let value = number(report, pointer);
    let off = value / truth - 1.0;
    eprintln!("{pointer}: {value:.4}, {:+.1} % of {truth:.4}", 100.0 * off);
    assert!(off.abs() <= share, "{pointer} is {value}, {:+.1} % off {truth}", 100.0 * off);
}

/// The vehicle of ArduPilot's simulator: 3 kg, arm 0.35 m, Ixx = Iyy = 0.02297 kg m².
fn is_arducopter(report: &Value) {
    // 18.86 N at 12.6 V and 1.157 kg/m³
    let voltage = number(report, "/thrust/voltage_ref_v") / 12.6;
    let density = number(report, "/thrust/density_ref_kgm3") / 1.157;
    within(report, "/thrust/max_n", 18.86 * voltage * voltage * density, 0.03);
    // 0.241 m/s² per m/s of rotor drag in hover, and ½·1.157·0.17433/3 per m of body drag
    let drag_at_5 = 0.241 * 5.0 + 0.5 * 1.157 * 0.17433 / 3.0 * 25.0;
    for axis in 0..2 {
        within(report, &format!("/drag/at_5_mps_mps2/{axis}/value"), drag_at_5, 0.1);
    }
    for axis in ["roll", "pitch"] {
        within(report, &format!("/{axis}/effectiveness_per_m/value"), 0.35 * 3.0 / 0.02297, 0.1);
    }
}

#[test]
fn a_recorded_flight_in_unknown_wind_shows_its_vehicle_and_agrees_with_another() {
    let (Some(log), Some(other)) = (flight("sitl/wind_dev.tlog"), flight("sitl/wind_turb.tlog")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("quad.toml");
    let arguments = ["--mass", "3.0", "-o", file.to_str().unwrap(), "--check", other.to_str().unwrap()];
    let report = identify(&log, &arguments);
    is_arducopter(&report);
    let checks = report["check"].as_array().unwrap();
    assert!(checks.len() >= 5 && checks.iter().all(|c| c["agrees"] == true), "{checks:#?}");

    let text = std::fs::read_to_string(&file).unwrap();
    for said in ["Identified from wind_dev.tlog", "no parameter known", "agree with the preset arducopter-sitl"] {
        assert!(text.contains(said), "{said} not in\n{text}");
    }
    let model = mavobserver::vehicle::from_file(&file).unwrap();
    assert!((model.facts().hover_thrust_share - 0.39).abs() < 0.01);
    let yaw = model.inertia_kgm2[(2, 2)];
    assert!((yaw / 0.04594 - 1.0).abs() < 0.05, "Izz is {yaw}");
    // held against a known torque about yaw in another flight, the motors' torque is 0.0162 times their thrust
    let ratio = model.rotors[0].torque_ratio_m;
    assert!((ratio / 0.0162 - 1.0).abs() < 0.05, "torque ratio {ratio}");
    // a model is of use only if observers can be designed for it
    mavobserver::observers::build("quadratic_bounded", &model, Options::default()).unwrap();
}

#[test]
fn a_simulated_flight_shows_its_vehicle() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.tlog");
    let arguments = ["-q", "sim", "wind-steps", "--duration", "150", "--tlog", log.to_str().unwrap()];
    cargo_bin_cmd!("mavobserver").args(arguments).assert().success();
    let report = identify(&log, &["--mass", "3.0", "--arm", "0.35"]);
    is_arducopter(&report);
    // a mass in hand only scales what was found per kilogram
    let bare = identify(&log, &["--arm", "0.35"]);
    assert_eq!(bare["thrust"]["max_npkg"], report["thrust"]["max_npkg"]);
    assert_eq!(bare["thrust"]["max_n"], Value::Null);
    let per_kilogram = bare["inertia_kgm2"][0].as_f64().unwrap();
    assert!((3.0 * per_kilogram / report["inertia_kgm2"][0].as_f64().unwrap() - 1.0).abs() < 1e-2);
}

#[test]
fn a_hover_says_which_manoeuvre_is_missing() {
    let Some(log) = flight("px4/wind_dev.tlog") else { return };
    let report = identify(&log, &["--mass", "1.0"]);
    within(&report, "/thrust/max_n", 5.0, 0.03);
    let drag = &report["drag"]["at_5_mps_mps2"][0];
    assert_eq!(drag["well_observed"], false, "{drag:#}");
    assert!(drag["missing"].as_str().unwrap().contains("legs"));
}

#[test]
fn logs_without_a_flight_are_refused_with_the_reason() {
    let refused = |log: &Path| {
        let output = cargo_bin_cmd!("mavobserver").arg("identify").arg(log).assert().code(1).get_output().clone();
        String::from_utf8(output.stderr).unwrap()
    };
    if let Some(log) = flight("real/marslab_mav.tlog") {
        assert!(refused(&log).contains("only multirotors"));
    }
    if let Some(log) = flight("real/ardusub_pymavlink_bug.tlog") {
        assert!(refused(&log).contains("no multirotor"));
    }
    assert!(refused(Path::new("no/such.tlog")).contains("no/such.tlog"));
}
