//! Bad input: one clear error on standard error, nothing else, and the right exit code.

use assert_cmd::Command;
use assert_cmd::cargo::cargo_bin_cmd;
use std::fs;
use std::path::PathBuf;

struct Dir(tempfile::TempDir);

impl Dir {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn file(&self, name: &str, text: &str) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, text).unwrap();
        path
    }
}

fn mavobserver() -> Command {
    cargo_bin_cmd!("mavobserver")
}

/// Runs `check` on a config, expects exit code 2 and gives what it wrote to standard error.
fn refused(config: &PathBuf, more: &[&str]) -> String {
    let output = mavobserver().arg("check").arg("-c").arg(config).args(more).assert().code(2).get_output().clone();
    assert!(output.stdout.is_empty(), "errors belong on standard error");
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.starts_with("error: "), "{message}");
    message
}

const VEHICLE: &str = "\
name = \"mine\"
mass_kg = 1.5
inertia_kgm2 = [0.02, 0.02, 0.03]
thrust.max_n = 10
[[rotor]]
position_frd_m = [0.2, 0.2, 0]
spin = \"ccw\"
torque_ratio_m = 0.02
";

#[test]
fn an_unknown_key_names_the_nearest_valid_one() {
    let dir = Dir::new();
    let config = dir.file("c.toml", "[output]\ncomponent = 191\nhearbeat_hz = 1\n");
    let message = refused(&config, &[]);
    assert!(message.contains("c.toml:3:1: unknown key `hearbeat_hz` in `output`"), "{message}");
    assert!(message.contains("did you mean `heartbeat_hz`?"), "{message}");
}

#[test]
fn a_negative_mass_is_refused_where_it_stands() {
    let dir = Dir::new();
    dir.file("v.toml", &VEHICLE.replace("1.5", "-1.5"));
    let config = dir.file("c.toml", "[vehicle]\nfile = \"v.toml\"\n");
    let message = refused(&config, &[]);
    assert!(message.contains("v.toml:2:11: `mass_kg` must be greater than 0, not -1.5"), "{message}");
}

#[test]
fn problems_of_all_files_and_arguments_come_together() {
    let dir = Dir::new();
    dir.file("v.toml", &VEHICLE.replace("0.03", "0.3").replace("\"ccw\"", "\"left\""));
    let config =
        dir.file("c.toml", "[[link]]\nurl = \"udp:14550\"\n[vehicle]\nfile = \"v.toml\"\n[requests]\nrate_hz = 0\n");
    let message = refused(&config, &["--vehicle", "3=px4-shi"]);
    for expected in [
        "4 problems",
        "c.toml:2:7",
        "unknown scheme `udp`",
        "c.toml:6:11: `requests.rate_hz` must lie between",
        "v.toml:3:16: `inertia_kgm2` belongs to no body",
        "v.toml:7:8: `rotor[1].spin` must be one of \"ccw\", \"cw\"",
        "no vehicle preset `px4-shi`; did you mean `px4-sih`?",
    ] {
        assert!(message.contains(expected), "{expected} not in:\n{message}");
    }
}

#[test]
fn an_unknown_preset_lists_the_known_ones() {
    let output = mavobserver().args(["check", "--vehicle", "x500"]).assert().code(2).get_output().clone();
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(message.contains("arducopter-sitl, px4-sih, px4-x500"), "{message}");
}

#[test]
fn unreadable_files_are_named_with_the_reason() {
    let dir = Dir::new();
    let missing = dir.0.path().join("missing.toml");
    let message = refused(&missing, &[]);
    assert!(message.contains("missing.toml: No such file"), "{message}");

    let binary = dir.0.path().join("binary.toml");
    fs::write(&binary, [0xff, 0xfe, 0x00]).unwrap();
    assert!(refused(&binary, &[]).contains("cannot read the config"));
}

#[test]
fn broken_toml_is_placed() {
    let dir = Dir::new();
    let config = dir.file("c.toml", "[output\ncomponent = 191\n");
    let message = refused(&config, &[]);
    assert!(message.contains("c.toml:1:8: not valid TOML"), "{message}");
}

#[test]
fn problems_are_also_told_to_machines() {
    let dir = Dir::new();
    let config = dir.file("c.toml", "colour = 1\n[log]\nfilter = 3\n");
    let output = mavobserver().arg("check").arg("-c").arg(config).arg("--json").assert().code(2).get_output().clone();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["ok"], false);
    assert_eq!(report["issues"].as_array().unwrap().len(), 2);
    assert_eq!(report["issues"][1]["key"], "log.filter");
    assert_eq!(report["issues"][1]["line"], 3);
}

#[test]
fn wrong_usage_exits_with_2() {
    for args in [&["chek"][..], &["check"], &["check", "--vehicle"], &["check", "--verbos"], &[]] {
        mavobserver().args(args).assert().code(2);
    }
}
