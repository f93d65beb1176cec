//! What a ground station may ask of the daemon, and what the daemon leaves behind.

// GET_MESSAGE_INTERVAL is superseded, and what autopilots answer.
#![allow(deprecated)]

mod live_support;

use live_support::*;
use mavobserver::config::Config;
use mavobserver::daemon::Settings;
use mavobserver::signal::Channel;
use mavobserver::telemetry::requests::Need;
use mavobserver::wire::dialect::ardupilotmega::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, MESSAGE_INTERVAL_DATA, MavCmd, MavParamType, MavResult,
    PARAM_REQUEST_LIST_DATA, PARAM_SET_DATA, PARAM_VALUE_DATA,
};
use mavobserver::wire::{Encoder, FrameBuf, decode};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;
use tokio::time::sleep;

fn name(text: &str) -> mavlink_core::types::CharArray<16> {
    let mut bytes = [0; 16];
    bytes.iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from);
    mavlink_core::types::CharArray::new(bytes)
}

/// A daemon that knows vehicle 1 on its first link and has a second one for a ground station.
async fn daemon(parameters: Option<PathBuf>, requests: Option<Vec<Need>>) -> (Running, Peer) {
    let settings = Settings { parameters, requests, ..Settings::new(vec![silent(any_port()), talking(any_port())]) };
    let daemon = Running::start(settings, Echo::default()).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    for frame in flight_of(&mut Encoder::new(1, 1), 5) {
        vehicle.send(frame.bytes()).await;
    }
    sleep(Duration::from_millis(100)).await;
    (daemon, vehicle)
}

async fn answers(station: &Peer) -> Vec<FrameBuf> {
    let all = station.receive_all().await;
    all.iter().map(|d| frame_of(d)).filter(|f| f.as_ref().component_id() == 191).collect()
}

#[tokio::test]
async fn parameters_are_listed_and_set_and_outlive_a_restart() {
    let directory = tempfile::tempdir().expect("a directory");
    let file = directory.path().join("set.params");
    let (running, _vehicle) = daemon(Some(file.clone()), None).await;
    let station = Peer::new(Some(running.address(1))).await;
    let mut encoder = Encoder::new(255, 190);
    station.send(encoder.encode(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 191 }).bytes()).await;
    let listed = answers(&station).await;
    let listed: Vec<_> = listed.iter().filter_map(|f| decode::<PARAM_VALUE_DATA>(f.as_ref())).collect();
    assert!(!listed.is_empty() && listed.len() == usize::from(listed[0].param_count), "{listed:?}");

    let set = PARAM_SET_DATA {
        param_value: 3.0,
        target_system: 1,
        target_component: 191,
        param_id: name("OUT_NAMED_HZ"),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    };
    station.send(encoder.encode(&set).bytes()).await;
    let said = answers(&station).await;
    assert!(said.iter().filter_map(|f| decode::<PARAM_VALUE_DATA>(f.as_ref())).any(|p| p.param_value == 3.0));
    running.stop().await;
    assert!(std::fs::read_to_string(&file).expect("written").contains("OUT_NAMED_HZ 3\n"));

    let (running, _vehicle) = daemon(Some(file), None).await;
    let station = Peer::new(Some(running.address(1))).await;
    station.send(encoder.encode(&PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 191 }).bytes()).await;
    let listed = answers(&station).await;
    let kept =
        listed.iter().filter_map(|f| decode::<PARAM_VALUE_DATA>(f.as_ref())).find(|p| p.param_id == set.param_id);
    assert_eq!(kept.map(|p| p.param_value), Some(3.0));
    running.stop().await;
}

/// The interval of every message before it is asked for.
const BEFORE_US: f32 = 250_000.0;

#[tokio::test]
async fn what_the_vehicle_granted_is_given_back_on_leaving() {
    let needs = vec![Need::at_default_rate(Channel::Gnss)];
    let (running, vehicle) = daemon(None, Some(needs)).await;
    let mut encoder = Encoder::new(1, 1);
    let (mut granted, mut given_back) = (Vec::new(), Vec::new());
    let mut running = Some(running);
    let (mut stopping, mut settled) = (None, 0);
    for k in 5..600 {
        vehicle.send(encoder.encode(&attitude(k)).bytes()).await;
        let deadline = tokio::time::Instant::now() + Duration::from_millis(20);
        while let Some(datagram) = vehicle.receive_until(deadline).await {
            let Some(command) = decode::<COMMAND_LONG_DATA>(frame_of(&datagram).as_ref()) else { continue };
            match command.command {
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL if command.param2 == BEFORE_US => {
                    given_back.push(command.param1);
                    continue;
                }
                MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => granted.push(command.param1),
                MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => {
                    let (message_id, interval_us) = (command.param1 as u16, BEFORE_US as i32);
                    let told = MESSAGE_INTERVAL_DATA { message_id, interval_us };
                    vehicle.send(encoder.encode(&told).bytes()).await;
                }
                // who it is
                other => {
                    assert_eq!(other, MavCmd::MAV_CMD_REQUEST_MESSAGE);
                    continue;
                }
            }
            let ack = COMMAND_ACK_DATA {
                command: command.command,
                result: MavResult::MAV_RESULT_ACCEPTED,
                target_system: 1,
                target_component: 191,
                ..COMMAND_ACK_DATA::DEFAULT
            };
            vehicle.send(encoder.encode(&ack).bytes()).await;
        }
        // the last grant has to arrive before the end begins
        settled += u32::from(granted.len() >= 2);
        if settled > 25
            && let Some(daemon) = running.take()
        {
            stopping = Some(tokio::spawn(daemon.stop()));
        }
        if stopping.as_ref().is_some_and(tokio::task::JoinHandle::is_finished) {
            break;
        }
    }
    stopping.expect("both messages were asked for").await.expect("no panic");
    for datagram in vehicle.receive_all().await {
        let frame = frame_of(&datagram);
        let commands = decode::<COMMAND_LONG_DATA>(frame.as_ref());
        given_back.extend(commands.filter(|c| c.param2 == BEFORE_US).map(|c| c.param1));
    }
    granted.sort_by(f32::total_cmp);
    given_back.sort_by(f32::total_cmp);
    assert!(granted.len() >= 2);
    assert_eq!(given_back, granted);
}

#[test]
fn every_ready_config_is_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config");
    for name in ["arducopter-sitl", "px4-sitl", "companion-serial", "ground-side", "log-only", "example"] {
        let (config, warnings) = Config::open(&folder.join(format!("{name}.toml"))).unwrap_or_else(|e| panic!("{e}"));
        assert!(warnings.is_empty() && !config.links.is_empty() && config.vehicles.default.is_some(), "{name}");
    }
}

/// pymavlink as a ground station: lists our parameters, sets one, asks for another interval.
#[tokio::test]
async fn pymavlink_lists_and_sets_our_parameters_and_intervals() {
    let here = Command::new("python3").args(["-c", "import pymavlink"]).stderr(Stdio::null()).status();
    if !here.is_ok_and(|s| s.success()) {
        eprintln!("SKIPPED: python3 with pymavlink is not here");
        return;
    }
    let (running, _vehicle) = daemon(None, None).await;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pymavlink_station.py");
    let url = format!("udpout:{}", running.address(1));
    let output = tokio::task::spawn_blocking(move || Command::new("python3").arg(script).arg(url).output())
        .await
        .expect("no panic")
        .expect("python starts");
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("all well"), "{said}{}", String::from_utf8_lossy(&output.stderr));
    running.stop().await;
}

/// What MAVProxy prints when it is told these lines, one every few seconds.
fn mavproxy(url: &str, home: &Path, lines: &[&str]) -> String {
    let mut proxy = Command::new("mavproxy.py")
        .args([&format!("--master={url}"), "--default-modules=param,cmdlong"])
        .current_dir(home)
        .env("HOME", home)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let mut input = proxy.stdin.take().expect("piped");
    // it reads while it connects
    std::thread::sleep(Duration::from_secs(5));
    for line in lines {
        writeln!(input, "{line}").expect("takes it");
        std::thread::sleep(Duration::from_secs(2));
    }
    drop(input);
    let output = proxy.wait_with_output().expect("ends");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// MAVProxy as a ground station: the same as pymavlink does, in an operator's words.
#[tokio::test]
async fn mavproxy_lists_and_sets_our_parameters_and_intervals() {
    let here = Command::new("mavproxy.py").arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !here.is_ok_and(|s| s.success()) {
        eprintln!("SKIPPED: mavproxy.py is not here");
        return;
    }
    let home = tempfile::tempdir().expect("a directory");
    let (running, vehicle) = daemon(None, None).await;
    let (url, folder) = (format!("udpout:{}", running.address(1)), home.path().to_owned());
    let mut operator = tokio::task::spawn_blocking(move || {
        let lines = [
            "vehicle 1:191",
            "param fetch",
            "param set OUT_NAMED_HZ 4",
            "param show OUT_*",
            "long SET_MESSAGE_INTERVAL 250 50000",
        ];
        mavproxy(&url, &folder, &lines)
    });
    let (mut encoder, mut k) = (Encoder::new(1, 1), 5);
    let said = loop {
        tokio::select! {
            said = &mut operator => break said.expect("no panic"),
            () = sleep(Duration::from_millis(100)) => {
                k += 1;
                vehicle.send(encoder.encode(&heartbeat()).bytes()).await;
                vehicle.send(encoder.encode(&attitude(k)).bytes()).await;
            }
        }
    };
    running.stop().await;
    let count = mavobserver::station::parameters().len();
    assert!(said.contains(&format!("Received {count} parameters")), "{said}");
    let shown = said.lines().any(|l| l.contains("OUT_NAMED_HZ") && l.trim_end().ends_with("4.0"));
    assert!(shown, "{said}");
    assert!(said.contains("SET_MESSAGE_INTERVAL: ACCEPTED"), "{said}");
}
