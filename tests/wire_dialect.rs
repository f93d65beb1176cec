//! Our dialect beside the others, and in pymavlink's hands.

use mavobserver::wire::dialect::mavobserver::{
    FAULT_STATUS_DATA, MavobserverFault, MavobserverFaultLevel, MavobserverGuarantee, MavobserverVerdict,
    OBSERVER_STATUS_DATA, STATE_BOUNDS_DATA, WIND_ESTIMATE_DATA, WRENCH_ESTIMATE_DATA,
};
use mavobserver::wire::{Encoder, FrameBuf};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const OURS: &str = include_str!("../dialects/mavobserver.xml");

/// Values of an attribute of every element with this name.
fn attributes<'a>(xml: &'a str, element: &str, attribute: &str) -> Vec<&'a str> {
    let open = format!("<{element} ");
    let assign = format!("{attribute}=\"");
    xml.split(open.as_str())
        .skip(1)
        .filter_map(|rest| {
            let tag = &rest[..rest.find('>')?];
            let value = &tag[tag.find(assign.as_str())? + assign.len()..];
            Some(&value[..value.find('"')?])
        })
        .collect()
}

/// What a command prints.
fn stdout(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// The XML that the `mavlink` crate is generated from, wherever cargo keeps it.
fn bundled_dialects() -> Vec<(PathBuf, String)> {
    // without the platform, cargo would want the packages of every other one too
    let version = stdout(Command::new("rustc").arg("-vV"));
    let host = version.lines().find_map(|line| line.strip_prefix("host: ")).unwrap();
    let metadata = stdout(
        Command::new(env!("CARGO"))
            .args(["metadata", "--format-version", "1", "--offline", "--filter-platform", host])
            .current_dir(env!("CARGO_MANIFEST_DIR")),
    );
    let metadata: Value = serde_json::from_str(&metadata).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let mavlink = packages.iter().find(|package| package["name"] == "mavlink").unwrap();
    let manifest = Path::new(mavlink["manifest_path"].as_str().unwrap());
    let folder = manifest.with_file_name("mavlink").join("message_definitions/v1.0");
    std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .map(|path| (path.clone(), std::fs::read_to_string(path).unwrap()))
        .collect()
}

#[test]
fn ids_and_names_are_ours_alone() {
    let dialects = bundled_dialects();
    assert!(dialects.len() > 15);
    for (path, xml) in &dialects {
        for (element, attribute) in [("message", "id"), ("message", "name"), ("enum", "name"), ("entry", "name")] {
            let theirs = attributes(xml, element, attribute);
            for ours in attributes(OURS, element, attribute) {
                assert!(!theirs.contains(&ours), "{element} {ours} is also in {}", path.display());
            }
        }
        for id in attributes(xml, "message", "id") {
            let id: u32 = id.parse().unwrap();
            assert!(id <= 0xFFFF, "{}: the catalogue covers 16-bit ids, {id} needs more", path.display());
            assert!(!(44100..44120).contains(&id), "{id} of {} lies in our block", path.display());
        }
    }
    assert_eq!(attributes(OURS, "message", "id"), ["44100", "44101", "44102", "44103", "44104"]);
}

/// Decodes each frame that comes in as a line of hex, prints its fields, packs it again and prints that.
const PYTHON: &str = r#"
import json, sys
sys.path.insert(0, sys.argv[1])
import mavobserver_messages as messages
mav = messages.MAVLink(None)
for line in sys.stdin:
    message, = mav.parse_buffer(bytes.fromhex(line))
    out = messages.MAVLink(None, message.get_srcSystem(), message.get_srcComponent())
    out.seq = message.get_seq()
    fields = message.to_dict()
    print(json.dumps({"fields": fields, "packed": message.pack(out).hex()}))
"#;

fn python() -> Option<Command> {
    let has_pymavlink = Command::new("python3").args(["-c", "import pymavlink.generator.mavgen"]).output();
    if has_pymavlink.is_ok_and(|output| output.status.success()) {
        return Some(Command::new("python3"));
    }
    eprintln!("SKIPPED: no python3 with pymavlink to generate our dialect with");
    None
}

fn examples() -> Vec<(FrameBuf, Value)> {
    let mut encoder = Encoder::new(3, 191);
    let guarantee = MavobserverGuarantee::MAVOBSERVER_GUARANTEE_STATISTICAL;
    let wrench = WRENCH_ESTIMATE_DATA {
        time_boot_us: 1 << 40,
        force_ned: [1.5, -2.5, 0.25],
        force_half_width: [0.5, 0.75, 1.0],
        torque_frd: [0.125, 0.0, -0.5],
        torque_half_width: [0.25, 0.25, 0.5],
        level: 0.5,
        guarantee,
        verdict: MavobserverVerdict::MAVOBSERVER_VERDICT_ASSUMPTION_VIOLATED,
    };
    let wind = WIND_ESTIMATE_DATA {
        time_boot_us: 7,
        wind_ned: [4.0, -3.0, 0.5],
        half_width: [1.0, 1.25, 2.0],
        level: 1.0,
        guarantee: MavobserverGuarantee::MAVOBSERVER_GUARANTEE_GUARANTEED,
        verdict: MavobserverVerdict::MAVOBSERVER_VERDICT_CONSISTENT,
    };
    let mut bounds = STATE_BOUNDS_DATA { time_boot_us: 8, observer_id: 2, first: 12, count: 3, ..Default::default() };
    bounds.lower[..3].copy_from_slice(&[-1.0, -2.0, -3.0]);
    bounds.upper[..3].copy_from_slice(&[1.0, 2.0, 3.0]);
    let faults = FAULT_STATUS_DATA {
        time_boot_us: 9,
        onset_boot_us: 5,
        active: MavobserverFault::MAVOBSERVER_FAULT_ROTOR_12 | MavobserverFault::MAVOBSERVER_FAULT_LINK,
        candidates: MavobserverFault::MAVOBSERVER_FAULT_GYRO | MavobserverFault::MAVOBSERVER_FAULT_ATTITUDE,
        magnitude: 0.25,
        level: MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_ISOLATED,
    };
    let status = OBSERVER_STATUS_DATA {
        time_boot_us: 10,
        residual: 0.75,
        rate: 50.0,
        steps: 100_000,
        step_ns: 1800,
        violations: 4,
        missing: 0b1_0000_0010,
        observer_id: 2,
        verdict: MavobserverVerdict::MAVOBSERVER_VERDICT_STARVED,
        name: "quadratic_bounded".into(),
    };
    let lower = json!([-1.0, -2.0, -3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let upper = json!([1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    vec![
        (
            encoder.encode(&wrench),
            json!({
                "mavpackettype": "WRENCH_ESTIMATE", "time_boot_us": 1u64 << 40, "force_ned": [1.5, -2.5, 0.25],
                "force_half_width": [0.5, 0.75, 1.0], "torque_frd": [0.125, 0.0, -0.5],
                "torque_half_width": [0.25, 0.25, 0.5], "level": 0.5, "guarantee": 1, "verdict": 2,
            }),
        ),
        (
            encoder.encode(&wind),
            json!({
                "mavpackettype": "WIND_ESTIMATE", "time_boot_us": 7, "wind_ned": [4.0, -3.0, 0.5],
                "half_width": [1.0, 1.25, 2.0], "level": 1.0, "guarantee": 2, "verdict": 0,
            }),
        ),
        (
            encoder.encode(&bounds),
            json!({
                "mavpackettype": "STATE_BOUNDS", "time_boot_us": 8, "lower": lower, "upper": upper,
                "observer_id": 2, "first": 12, "count": 3,
            }),
        ),
        (
            encoder.encode(&faults),
            json!({
                "mavpackettype": "FAULT_STATUS", "time_boot_us": 9, "onset_boot_us": 5,
                "active": (1 << 11) | (1 << 21), "candidates": (1 << 12) | (1 << 18), "magnitude": 0.25, "level": 3,
            }),
        ),
        (
            encoder.encode(&status),
            json!({
                "mavpackettype": "OBSERVER_STATUS", "time_boot_us": 10, "residual": 0.75, "rate": 50.0,
                "steps": 100_000, "step_ns": 1800, "violations": 4, "missing": 0b1_0000_0010, "observer_id": 2,
                "verdict": 3, "name": "quadratic_bounded",
            }),
        ),
    ]
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

#[test]
fn pymavlink_generates_it_and_reads_what_we_send() {
    let Some(mut generate) = python() else { return };
    let folder = tempfile::tempdir().unwrap();
    let generated = generate
        .args(["-m", "pymavlink.tools.mavgen", "--lang=Python3", "--wire-protocol=2.0", "-o"])
        .arg(folder.path().join("mavobserver_messages.py"))
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("dialects/mavobserver.xml"))
        .output()
        .unwrap();
    assert!(generated.status.success(), "{}", String::from_utf8_lossy(&generated.stderr));

    let examples = examples();
    let mut python = Command::new("python3")
        .args(["-c", PYTHON])
        .arg(folder.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = python.stdin.take().unwrap();
    for (frame, _) in &examples {
        writeln!(stdin, "{}", hex(frame.bytes())).unwrap();
    }
    drop(stdin);
    let output = python.wait_with_output().unwrap();
    assert!(output.status.success());
    let answers: Vec<Value> =
        String::from_utf8(output.stdout).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(answers.len(), examples.len());
    for ((frame, expected), answer) in examples.iter().zip(&answers) {
        assert_eq!(&answer["fields"], expected);
        assert_eq!(answer["packed"], hex(frame.bytes()), "packed by pymavlink: {}", expected["mavpackettype"]);
    }
}
