//! `mavobserver design`: the published numbers through the front door, and what bad input gets.

use assert_cmd::Command;
use serde_json::Value;

fn design(args: &[&str]) -> std::process::Output {
    let mut command = Command::cargo_bin("mavobserver").unwrap();
    command.args(["design", "quadratic-bounded"]).args(args).output().unwrap()
}

fn rates(args: &[&str]) -> std::process::Output {
    let mut command = Command::cargo_bin("mavobserver").unwrap();
    command.args(["design", "fuzzy-polynomial"]).args(args).output().unwrap()
}

fn matrix(v: &Value) -> Vec<Vec<f64>> {
    serde_json::from_value(v.clone()).unwrap()
}

fn times(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let cell = |i: usize, j: usize| a[i].iter().zip(b).map(|(x, row)| x * row[j]).sum();
    (0..a.len()).map(|i| (0..b[0].len()).map(|j| cell(i, j)).collect()).collect()
}

#[test]
fn published_numbers_come_as_one_json_object() {
    let out = design(&["--alpha", "0.17,2", "--mu", "0.95", "--json"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(v["plant"], "cayero-hummingbird");
    let rows = v["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    for (row, volume) in rows.iter().zip([0.00726, 14.14]) {
        assert!((row["volume"].as_f64().unwrap() / volume - 1.0).abs() < 0.01);
        assert_eq!(row["verified"], true);
        assert!(row["margin"].as_f64().unwrap() > 0.0 && row["solve_s"].as_f64().unwrap() > 0.0);
        let (a, c, gain) = (matrix(&row["A"]), matrix(&row["C"]), matrix(&row["gain"]));
        assert_eq!((a.len(), c.len(), gain.len(), gain[0].len()), (24, 9, 24, 9));
        // the observer's own matrix is A + LC
        let (closed, lc) = (matrix(&row["closed_loop"]), times(&gain, &c));
        assert!((0..24).all(|i| (0..24).all(|j| (closed[i][j] - a[i][j] - lc[i][j]).abs() < 1e-9)));
        assert_eq!(matrix(&row["P"]).len(), 24);
    }
    let selected = &v["selected"][0];
    assert_eq!(selected["mu"], 0.95);
    assert!((selected["alpha"].as_f64().unwrap() / 2.77 - 1.0).abs() < 0.02);
    assert!((selected["volume"].as_f64().unwrap() / 45.8 - 1.0).abs() < 0.02);
}

#[test]
fn a_vehicle_is_designed_from_what_it_declares() {
    let out = design(&["--plant", "px4-sih", "--alpha", "2"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = String::from_utf8(out.stdout).unwrap();
    assert!(text.contains("px4-sih: r = 1, 12 states"), "{text}");
}

#[test]
fn bad_input_is_one_clear_error_and_exit_code_two() {
    for (args, expected) in [
        (&["--alpha", "0"][..], "expected a positive number"),
        (&["--alpha", "fast"], "expected a positive number"),
        (&["--mu", "1.5"], "expected a number from 0 to 1"),
        (&["--plant", "px4-si"], "did you mean `px4-sih`"),
        (&["--plant", "px4-sih", "--r", "3"], "no higher derivative"),
        (&["--r", "0"], "0 is not in 1..=6"),
    ] {
        let out = design(args);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(expected), "{args:?}: {said}");
        assert!(out.stdout.is_empty());
    }
}

/// §5.2 of the cascade observer's paper: γ = 50, and gains within a fifth of the printed ones.
#[test]
fn the_cascade_observers_gains_with_their_norms() {
    let cascade = |args: &[&str]| {
        let mut command = Command::cargo_bin("mavobserver").unwrap();
        command.args(["design", "cascade-gnss-ins"]).args(args).output().unwrap()
    };
    let out = cascade(&["--gamma", "50", "--gamma-n", "1.002", "--json"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    let row = &v["rows"][0];
    assert!(row["h_norm"]["upper"].as_f64().unwrap() < 50.0);
    assert!(row["g_norm"]["upper"].as_f64().unwrap() <= 1.002 * (1.0 + 1e-6));
    let printed = [[128.9, 17.5], [15.7, 2.4], [1.3, 0.2]];
    for (ours, theirs) in matrix(&row["gain"]).iter().flatten().zip(printed.iter().flatten()) {
        assert!((ours / theirs - 1.0).abs() <= 0.2, "{ours} against {theirs}");
    }
    for (args, code, expected) in [
        (&["--plant", "velocity"][..], 2, "position-ground-velocity"),
        (&["--gamma", "-1"], 2, "expected a positive number"),
        (&["--plant", "position", "--gamma", "0.001", "--gamma-n", "1.01"], 1, "try a larger"),
    ] {
        let out = cascade(args);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(expected), "{args:?}: {said}");
    }
}

#[test]
fn the_fuzzy_polynomial_table_comes_as_one_json_object() {
    let dir = tempfile::tempdir().unwrap();
    let page = dir.path().join("front.html");
    let out = rates(&["--method", "LM-D,SOS-2G", "--alpha", "14,18", "--json", "--plot", page.to_str().unwrap()]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let v: Value = serde_json::from_slice(&out.stdout).unwrap();
    let rows = v["rows"].as_array().unwrap();
    let of = |method: &str, alpha: f64| rows.iter().find(|r| r["method"] == method && r["alpha"] == alpha).unwrap();
    for (method, alpha, published) in
        [("LM-D", 14.0, 15.89), ("LM-D", 18.0, 20.9), ("SOS-2G", 14.0, 19.18), ("SOS-2G", 18.0, 24.26)]
    {
        let row = of(method, alpha);
        assert!((row["value"].as_f64().unwrap() / published - 1.0).abs() < 1e-3, "{row}");
        assert!(row["verified"] == true && row["margin"].as_f64().unwrap() > 0.0 && row["published"] == published);
    }
    let gains = of("SOS-2G", 18.0)["gains"].as_array().unwrap();
    assert_eq!((gains.len(), matrix(&gains[0]["L"]).len(), matrix(&of("LM-D", 14.0)["P"]).len()), (2, 6, 6));
    // what is judged on the plant may be chosen, the linear model's own promise may not
    assert!(v["selected"].as_array().unwrap().iter().all(|r| r["method"] == "SOS-2G"));
    assert_eq!(v["model"]["A"].as_array().unwrap().len(), 2);
    let html = std::fs::read_to_string(page).unwrap();
    assert!(html.contains("<svg") && html.contains("SOS-2G, α = 18") && html.contains("7×7"));
}

#[test]
fn wrong_methods_and_files_are_usage_errors() {
    for (args, expected) in [
        (&["--method", "LM-X"][..], "one of LM-D, LM-A, TS-8GD"),
        (&["--method", "LM-D", "--alpha", "9", "--plot", "x.png"], "name.svg or name.html"),
        (&["--method", "LM-D", "--alpha", "9", "--data", "x.txt"], ".tlog or .csv"),
    ] {
        let out = rates(args);
        let said = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{args:?}: {said}");
        assert!(said.contains(expected), "{args:?}: {said}");
    }
}
