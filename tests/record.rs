//! Recordings: conversion of real and simulated logs, there and back, and what other readers find in them.

use assert_cmd::Command;
use mavobserver::record::{Encoding, FileKind, log_to_mcap, mcap_to_log};
use mavobserver::sim::{Run, RunOptions, scenario};
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

fn bin() -> Command {
    Command::cargo_bin("mavobserver").unwrap()
}

/// The telemetry logs of the data folder, or a loud word.
fn real_logs() -> Vec<PathBuf> {
    let root = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let mut logs = Vec::new();
    for folder in ["real", "sitl", "px4"] {
        let entries = fs::read_dir(root.join(folder)).into_iter().flatten().flatten();
        logs.extend(entries.map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "tlog" || e == "rlog")));
    }
    logs.sort();
    if logs.is_empty() {
        eprintln!("SKIPPED: no flights in {}; set MAVOBSERVER_DATA", root.display());
    }
    logs
}

/// A simulated flight as a telemetry log.
fn simulated(seconds: f64) -> Vec<u8> {
    let mut run = Run::new(&scenario::resolve("wind-steps").unwrap(), &RunOptions::default()).unwrap();
    let mut log = Vec::new();
    while run.now_s() < seconds {
        run.advance(&mut |r| {
            log.extend_from_slice(&r.unix_us.to_be_bytes());
            log.extend_from_slice(r.bytes);
        });
    }
    log
}

/// There and back.
fn round_trip(log: &Path) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("x.mcap");
    let (_, sink) = log_to_mcap(log, Cursor::new(Vec::new()), Encoding::Protobuf, &mut |_| {}).unwrap();
    fs::write(&recording, sink.into_inner()).unwrap();
    mcap_to_log(&recording, Vec::new(), &mut |_| {}).unwrap().1
}

fn assert_same(log: &Path) {
    let (before, after) = (fs::read(log).unwrap(), round_trip(log));
    let differs = before.iter().zip(&after).position(|(a, b)| a != b);
    assert!(
        before == after,
        "{}: {} bytes became {}, first difference at {differs:?}",
        log.display(),
        before.len(),
        after.len()
    );
}

#[test]
fn every_real_log_comes_back_byte_for_byte() {
    for log in real_logs() {
        assert_same(&log);
    }
}

#[test]
fn a_damaged_log_comes_back_byte_for_byte() {
    let folder = tempfile::tempdir().unwrap();
    let whole = simulated(5.0);
    let mut random = 0x2545_F491_4F6C_DD1D_u64;
    let mut next = |below: usize| {
        random ^= random << 13;
        random ^= random >> 7;
        random ^= random << 17;
        (random % below as u64) as usize
    };
    for case in 0..40 {
        let mut log = whole.clone();
        for _ in 0..1 + case {
            let at = next(log.len() - 40);
            match next(4) {
                0 => log[at] ^= 1 << next(8),
                1 => drop(log.drain(at..at + next(40))),
                2 => drop(log.splice(at..at, (0..next(300)).map(|i| (i * 37) as u8).collect::<Vec<_>>())),
                _ => log.truncate(log.len() - next(100)),
            }
        }
        let path = folder.path().join(format!("{case}.tlog"));
        fs::write(&path, &log).unwrap();
        assert_same(&path);
    }
}

/// pymavlink finds the same messages in the log as Python's MCAP reader in the recording, every field equal.
#[test]
fn recordings_hold_what_pymavlink_reads() {
    let python = std::env::var("MAVOBSERVER_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let modules = ["-c", "import pymavlink.generator.mavgen, mcap_protobuf"];
    if !std::process::Command::new(&python).args(modules).output().is_ok_and(|o| o.status.success()) {
        eprintln!("SKIPPED: {python} with pymavlink, mcap and mcap-protobuf-support is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("sim.tlog");
    fs::write(&log, simulated(20.0)).unwrap();
    let mut logs = real_logs();
    logs.push(log);
    for log in logs {
        let recording = folder.path().join("x.mcap");
        let (converted, sink) = log_to_mcap(&log, Cursor::new(Vec::new()), Encoding::Protobuf, &mut |_| {}).unwrap();
        fs::write(&recording, sink.into_inner()).unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let output = std::process::Command::new(&python)
            .arg(root.join("tests/record_compare.py"))
            .args([root.join("dialects"), log.clone(), recording])
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{}: {text}{}", log.display(), String::from_utf8_lossy(&output.stderr));
        println!("{}: {} messages, compared and bad: {}", log.display(), converted.counts.frames, text.trim());
    }
}

#[test]
fn the_command_converts_there_and_back_and_overwrites_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::create_dir(path("logs")).unwrap();
    let log = simulated(3.0);
    fs::write(path("logs/a.tlog"), &log).unwrap();
    fs::write(path("logs/b.rlog"), b"no log").unwrap();
    let run = |args: &[&Path]| bin().arg("convert").args(args).arg("--json").output().unwrap();

    let output = run(&[&path("logs"), Path::new("-o"), &path("out")]);
    assert_eq!(output.status.code(), Some(1), "one of the two is no log");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["failed"], 1);
    assert_eq!(FileKind::of(&path("out/a.mcap")).unwrap(), FileKind::Mcap);
    assert_eq!(fs::read_dir(path("out")).unwrap().count(), 1, "nothing half-written remains");

    let output = run(&[&path("out/a.mcap"), Path::new("-o"), &path("again.tlog")]);
    assert!(output.status.success());
    assert_eq!(fs::read(path("again.tlog")).unwrap(), log);

    fs::write(path("again.tlog"), b"precious").unwrap();
    let output = run(&[&path("out/a.mcap"), Path::new("-o"), &path("again.tlog")]);
    assert_eq!(output.status.code(), Some(1));
    assert_eq!(fs::read(path("again.tlog")).unwrap(), b"precious");
    let output = run(&[&path("out/a.mcap"), Path::new("-o"), &path("again.tlog"), Path::new("--force")]);
    assert!(output.status.success());
    assert_eq!(fs::read(path("again.tlog")).unwrap(), log);

    assert_eq!(run(&[&path("absent.tlog")]).status.code(), Some(2));
}

#[test]
fn json_is_json_all_through() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.tlog");
    fs::write(&log, simulated(2.0)).unwrap();
    let (converted, sink) = log_to_mcap(&log, Cursor::new(Vec::new()), Encoding::Json, &mut |_| {}).unwrap();
    let bytes = sink.into_inner();
    let mut messages = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        if message.channel.message_encoding == "json" {
            let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            let schema = message.channel.schema.as_ref().unwrap();
            let schema: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
            let properties = schema["properties"].as_object().unwrap();
            assert!(value.as_object().unwrap().keys().all(|k| properties.contains_key(k)));
            messages += 1;
        }
    }
    assert_eq!(messages, converted.counts.frames);
}
