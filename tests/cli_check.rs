//! `check` on valid input: what a person and a machine get to see.

use assert_cmd::cargo::cargo_bin_cmd;
use std::io::Read;
use std::process::{Command, Stdio};

#[test]
fn the_example_config_is_valid_and_summarised() {
    let example = concat!(env!("CARGO_MANIFEST_DIR"), "/config/example.toml");
    let output = cargo_bin_cmd!("mavobserver").args(["check", "-c", example]).assert().success().get_output().clone();
    let text = String::from_utf8(output.stdout).unwrap();
    for expected in
        ["valid", "ArduCopter SITL quad X", "39 % of full thrust", "udpin:0.0.0.0:14550", "quadratic_bounded"]
    {
        assert!(text.contains(expected), "{expected} not in:\n{text}");
    }
}

#[test]
fn json_holds_the_facts_of_each_vehicle() {
    let output = cargo_bin_cmd!("mavobserver")
        .args(["check", "--vehicle", "px4-sih", "--vehicle", "9=quanser-3dof", "--json"])
        .assert()
        .success()
        .get_output()
        .clone();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let [rig, quad] = report["vehicles"].as_array().unwrap().as_slice() else { panic!("{report}") };
    assert_eq!(rig["for"], "system 9");
    assert!(rig["cautions"][0].as_str().unwrap().contains("cannot hover"));
    // linear thrust: the command in hover is the weight's share, 9.80665/20
    assert!((quad["facts"]["hover_command"].as_f64().unwrap() - 0.4903).abs() < 1e-3);
    assert_eq!(quad["facts"]["drag_at_1_mps_n"][0], 1.0);
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_mavobserver"))
        .args(["check", "--vehicle", "px4-sih", "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let mut errors = String::new();
    child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
    assert!(child.wait().unwrap().success());
    assert_eq!(errors, "");
}

#[test]
fn help_of_every_command_has_an_example() {
    let help = |args: &[&str]| {
        let output = cargo_bin_cmd!("mavobserver").args(args).assert().success().get_output().clone();
        String::from_utf8(output.stdout).unwrap()
    };
    let top = help(&["--help"]);
    let commands = top.lines().skip_while(|l| !l.starts_with("Commands:")).skip(1).take_while(|l| !l.is_empty());
    // a description that runs on is indented further than a name
    let named = commands.filter(|l| l.starts_with("  ") && !l.starts_with("   "));
    let names: Vec<_> = named.filter_map(|l| l.split_whitespace().next()).filter(|n| *n != "help").collect();
    assert!(names.contains(&"check"));
    for name in names {
        assert!(help(&[name, "--help"]).contains(&format!("mavobserver {name}")), "{name} --help shows no example");
    }
}
