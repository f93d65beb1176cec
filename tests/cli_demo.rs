//! `mavobserver demo` and `mavobserver evaluate` as a user meets them.

use assert_cmd::cargo::cargo_bin_cmd;
use serde_json::Value;

#[test]
fn the_demo_ends_by_itself_with_numbers_from_the_wire_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    // enough to take off and meet the first wind
    let arguments = ["demo", "--json", "--duration", "24", "--out", out.to_str().unwrap()];
    let run = cargo_bin_cmd!("mavobserver").args(arguments).assert().success();
    let report: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let number =
        |path: &str| report.pointer(path).and_then(Value::as_f64).unwrap_or_else(|| panic!("{path}: {report}"));
    assert!(number("/flown_s") > 8.0);
    assert!(number("/estimates/wind/rmse") < 0.6, "{report}");
    assert!(number("/estimates/force/rmse") < 1.0, "{report}");
    assert!(number("/estimates/torque/rmse") < 0.05, "{report}");
    assert!(number("/rates_hz/WIND_ESTIMATE") > 4.0);
    // the link is the loopback of this machine: what the vehicle sends arrives
    assert!(number("/frames_at_ground") + number("/answers_to_daemon") > 0.99 * number("/frames_from_vehicle"));
    let picture = std::fs::read_to_string(out.join("demo.svg")).unwrap();
    assert!(picture.starts_with("<svg") && picture.contains("Wind towards north") && picture.contains("<polygon"));
    for file in report["files"].as_array().unwrap() {
        assert!(std::fs::metadata(file.as_str().unwrap()).unwrap().len() > 1000);
    }
}

#[test]
fn scores_come_as_json_and_as_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("scores.html");
    let arguments = ["evaluate", "hover", "--runs", "2", "--json", "--report", page.to_str().unwrap()];
    let run = cargo_bin_cmd!("mavobserver").args(arguments).assert().success();
    let report: Value = serde_json::from_slice(&run.get_output().stdout).unwrap();
    let rows = report["rows"].as_array().unwrap();
    let wind = rows.iter().find(|r| r["quantity"] == "wind").expect("wind is scored");
    assert_eq!((wind["scenario"].as_str(), wind["flights"].as_u64()), (Some("hover"), Some(2)));
    assert!(wind["rmse"].as_f64().unwrap() < 0.5 && wind["signals"].as_array().unwrap().len() == 3);
    assert!(std::fs::read_to_string(page).unwrap().contains("<table>"));
}

#[test]
fn what_does_not_exist_is_wrong_usage() {
    for arguments in
        [&["evaluate", "hoover"][..], &["evaluate", "hover", "--observer", "kalman"], &["demo", "--scenario", "x"]]
    {
        cargo_bin_cmd!("mavobserver").args(arguments).assert().code(2);
    }
}
