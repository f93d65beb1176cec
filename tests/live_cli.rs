//! `mavobserver run` as a process: exit codes, stopping by signal, what is left on disk.

mod live_support;

use assert_cmd::cargo::{cargo_bin, cargo_bin_cmd};
use live_support::flight_of;
use mavobserver::record::McapReader;
use mavobserver::wire::tlog::{TlogReader, TlogWriter};
use mavobserver::wire::{Encoder, Event};
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

fn refused(arguments: &[&str], code: i32) -> String {
    let output = cargo_bin_cmd!("mavobserver").arg("run").args(arguments).assert().code(code).get_output().clone();
    assert!(output.stdout.is_empty(), "errors belong on standard error");
    String::from_utf8(output.stderr).expect("text")
}

#[test]
fn an_occupied_port_fails_with_its_address_and_advice() {
    let holder = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let url = format!("udpin:{}", holder.local_addr().expect("bound"));
    let message = refused(&["--link", &url], 1);
    assert!(message.contains(&url) && message.contains("in use") && message.contains("choose another"), "{message}");
}

#[test]
fn nothing_to_do_is_wrong_usage() {
    assert!(refused(&[], 2).contains("--link udpin:0.0.0.0:14550"));
    assert!(refused(&["--link", "udpim:0.0.0.0:1"], 2).contains("did you mean `udpin`?"));
    assert!(refused(&["--link", "udpin:127.0.0.1:14550", "--vehicle", "px4-shi"], 2).contains("px4-sih"));
}

#[test]
fn a_missing_or_foreign_log_fails_with_its_name() {
    assert!(refused(&["--link", "tlog:no/such.tlog"], 1).contains("no/such.tlog"));
    let message = refused(&["--link", concat!("tlog:", env!("CARGO_MANIFEST_DIR"), "/Cargo.toml")], 1);
    assert!(message.contains("Cargo.toml") && message.contains("text file"), "{message}");
}

#[test]
fn a_log_played_flat_out_ends_by_itself_and_reports_in_json() {
    let directory = tempfile::tempdir().expect("a directory");
    let log = directory.path().join("flight.tlog");
    let mut writer = TlogWriter::new(File::create(&log).expect("writable"));
    for (k, frame) in flight_of(&mut Encoder::new(1, 1), 500).iter().enumerate() {
        writer.write(1_700_000_000_000_000 + 20_000 * k as u64, frame.as_ref()).expect("written");
    }
    writer.flush().expect("written");
    let link = format!("tlog:{}?speed=max", log.display());
    let output = cargo_bin_cmd!("mavobserver")
        .args(["run", "--json", "--vehicle", "arducopter-sitl", "--link", &link])
        .timeout(Duration::from_secs(120))
        .assert()
        .success()
        .get_output()
        .clone();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object and nothing else");
    assert_eq!((&report["links"][0]["frames_in"], &report["links"][0]["lost_in"]), (&501.into(), &0.into()));
    assert_eq!(report["links"][0]["sources"][0]["frames"], 501);
}

/// A daemon on a free port that records; given back once it runs.
fn start(records: &Path) -> (Child, BufReader<std::process::ChildStderr>, String) {
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a free port").port();
    let address = format!("127.0.0.1:{port}");
    let mut child = Command::new(cargo_bin!("mavobserver"))
        .args(["run", "--vehicle", "arducopter-sitl", "--link", &format!("udpin:{address}"), "--record"])
        .arg(records)
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut log = BufReader::new(child.stderr.take().expect("piped"));
    let mut line = String::new();
    while !line.contains("running") {
        line.clear();
        assert_ne!(log.read_line(&mut line).expect("text"), 0, "ended before it ran");
    }
    (child, log, address)
}

/// Frames received on the link, in the telemetry log and in the MCAP recording.
fn recorded(records: &Path) -> [usize; 2] {
    let files: Vec<PathBuf> = std::fs::read_dir(records).expect("made").map(|f| f.expect("read").path()).collect();
    let named = |end: &str| files.iter().find(|f| f.to_string_lossy().ends_with(end)).expect("recorded");
    let mut log = TlogReader::open(named("Z.tlog")).expect("a log");
    let mut recording = McapReader::open(named(".mcap")).expect("a recording");
    let mut frames = [0; 2];
    while log.next().expect("readable").is_some() {
        frames[0] += 1;
    }
    while let Some(record) = recording.next().expect("readable") {
        let Event::Frame(frame) = record.event else { continue };
        frames[1] += usize::from(frame.component_id() == 1);
    }
    frames
}

#[cfg(unix)]
#[test]
fn it_stops_politely_at_sigterm_and_keeps_what_it_heard_when_killed() {
    for (signal, success) in [("-TERM", true), ("-INT", true), ("-KILL", false)] {
        let directory = tempfile::tempdir().expect("a directory");
        let (mut child, log, address) = start(directory.path());
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a free port");
        for frame in flight_of(&mut Encoder::new(1, 1), 99) {
            socket.send_to(frame.bytes(), &address).expect("sent");
        }
        if !success {
            // the recorder's promise: on disk within a second
            std::thread::sleep(Duration::from_secs(1));
        }
        let begin = Instant::now();
        Command::new("kill").args([signal, &child.id().to_string()]).status().expect("kill runs");
        let status = child.wait().expect("ended");
        assert_eq!(status.success(), success, "{signal}: {status}");
        assert!(begin.elapsed() < Duration::from_secs(5));
        let rest: Vec<_> = log.lines().map_while(Result::ok).collect();
        assert_eq!(recorded(directory.path()), [100, 100], "{signal}: {rest:#?}");
    }
}

/// A simulated autopilot that sends nothing unasked: the whole conversation, up to an estimate.
#[cfg(unix)]
#[test]
fn a_silent_autopilot_is_asked_until_the_estimates_run() {
    let directory = tempfile::tempdir().expect("a directory");
    let scenario = directory.path().join("silent.toml");
    let text = "name = \"silent\"\ndescription = \"Nobody asked for anything\"\nvehicle = \"arducopter-sitl\"\n\
                duration_s = 60\nmission = [{ leg = \"takeoff\", height_m = 10 }, { leg = \"hover\", seconds = 60 }]\n\
                [streams]\nSYSTEM_TIME = 1\n";
    std::fs::write(&scenario, text).expect("written");
    let records = directory.path().join("records");
    let (mut child, log, address) = start(&records);
    let simulator = Command::new(cargo_bin!("mavobserver"))
        .args(["sim", "--quiet", "--duration", "12", "--link", &format!("udpout:{address}"), "-c"])
        .arg(&scenario)
        .stdout(Stdio::null())
        .status()
        .expect("starts");
    assert!(simulator.success());
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
    let rest: Vec<_> = log.lines().map_while(Result::ok).collect();
    assert!(child.wait().expect("ended").success());
    assert!(rest.iter().any(|line| line.contains("estimating wrench and wind")), "{rest:#?}");
    assert!(!rest.iter().any(|line| line.contains("WARN")), "{rest:#?}");
}

/// Reads log lines until one holds this text.
#[cfg(unix)]
fn wait_for(log: &mut BufReader<std::process::ChildStderr>, text: &str) {
    let mut line = String::new();
    while !line.contains(text) {
        line.clear();
        assert_ne!(log.read_line(&mut line).expect("text"), 0, "ended before `{text}`");
    }
}

#[cfg(unix)]
#[test]
fn sighup_reads_the_filters_again_and_a_config_with_mistakes_changes_nothing() {
    let directory = tempfile::tempdir().expect("a directory");
    let config = directory.path().join("bridge.toml");
    let port = || UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a free port").port();
    let (vehicle_port, station_port) = (port(), port());
    let write = |rule: &str| {
        let text = format!(
            "[[observer]]\nname = 'quadratic_bounded'\nenabled = false\n\
             [[link]]\nname = 'vehicle'\nurl = 'udpin:127.0.0.1:{vehicle_port}'\n\
             [[link]]\nname = 'station'\nurl = 'udpin:127.0.0.1:{station_port}'\n{rule}\n"
        );
        std::fs::write(&config, text).expect("written");
    };
    write("");
    let mut child = Command::new(cargo_bin!("mavobserver"))
        .args(["run", "-c"])
        .arg(&config)
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let mut log = BufReader::new(child.stderr.take().expect("piped"));
    wait_for(&mut log, "running");
    let hang_up = || Command::new("kill").args(["-HUP", &child.id().to_string()]).status().expect("kill runs");

    let (vehicle, station) = (UdpSocket::bind("127.0.0.1:0"), UdpSocket::bind("127.0.0.1:0"));
    let (vehicle, station) = (vehicle.expect("a free port"), station.expect("a free port"));
    station.set_read_timeout(Some(Duration::from_secs(20))).expect("set");
    let hello = Encoder::new(255, 190).encode(&live_support::heartbeat());
    station.send_to(hello.bytes(), ("127.0.0.1", station_port)).expect("sent");
    let mut encoder = Encoder::new(1, 1);
    let send = |frame: mavobserver::wire::FrameBuf| {
        vehicle.send_to(frame.bytes(), ("127.0.0.1", vehicle_port)).expect("sent");
    };
    let receive = || {
        let mut buffer = [0; 300];
        let length = station.recv(&mut buffer).expect("passes");
        live_support::frame_of(&buffer[..length]).as_ref().message_id()
    };
    // whoever comes first, the station's greeting or this, it must be served
    std::thread::sleep(Duration::from_millis(100));
    send(encoder.encode(&live_support::attitude(0)));
    assert_eq!(receive(), 30);

    write("out.blok.message = ['ATTITUDE']");
    hang_up();
    wait_for(&mut log, "not taken over");
    send(encoder.encode(&live_support::attitude(1)));
    assert_eq!(receive(), 30);

    write("out.block.message = ['ATTITUDE']");
    hang_up();
    wait_for(&mut log, "as the config says now");
    send(encoder.encode(&live_support::attitude(2)));
    send(encoder.encode(&live_support::heartbeat()));
    assert_eq!(receive(), 0);
    Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill runs");
    assert!(child.wait().expect("ended").success());
}

#[test]
fn run_with_check_tells_what_is_missing_and_runs_nothing() {
    let output = cargo_bin_cmd!("mavobserver")
        .args(["run", "--check", "--vehicle", "arducopter-sitl", "--link", "serial:/dev/no-such-device:57600"])
        .args(["--link", "tlog:no/such.tlog"])
        .timeout(Duration::from_secs(120))
        .assert()
        .success()
        .get_output()
        .clone();
    let text = String::from_utf8(output.stdout).expect("text");
    for part in ["designed and certified", "/dev/no-such-device is not there now; a run waits for it", "a run refuses"]
    {
        assert!(text.contains(part), "{part} is missing of\n{text}");
    }
}

#[test]
fn tap_counts_what_a_log_holds_and_names_what_observers_miss() {
    let directory = tempfile::tempdir().expect("a directory");
    let log = directory.path().join("flight.tlog");
    let mut writer = TlogWriter::new(File::create(&log).expect("writable"));
    let mut encoder = Encoder::new(1, 1);
    for (k, frame) in flight_of(&mut encoder, 500).iter().enumerate() {
        // ten frames in the middle never came
        if !(200..210).contains(&k) {
            writer.write(1_700_000_000_000_000 + 20_000 * k as u64, frame.as_ref()).expect("written");
        }
    }
    writer.flush().expect("written");
    let url = format!("tlog:{}?speed=max", log.display());
    let tap = |arguments: &[&str]| {
        let tap = cargo_bin_cmd!("mavobserver").args(["tap", &url]).args(arguments).assert().success();
        String::from_utf8(tap.get_output().stdout.clone()).expect("text")
    };
    let lines = tap(&["--json"]);
    let report: serde_json::Value = serde_json::from_str(lines.lines().last().expect("a line")).expect("JSON");
    let source = &report["links"][0]["sources"][0];
    assert_eq!((&source["frames"], &source["lost"], &source["kind"]), (&491.into(), &10.into(), &"ArduPilot".into()));
    let attitude = &source["messages"][1];
    assert_eq!((&attitude["name"], &attitude["frames"]), (&"ATTITUDE".into(), &490.into()));
    assert!((attitude["rate_hz"].as_f64().expect("Hz") - 50.0).abs() < 1.0, "{attitude}");
    let gaps: Vec<_> = source["gaps"].as_array().expect("a list").iter().map(|g| g["channel"].to_string()).collect();
    assert!(gaps.iter().any(|g| g.contains("IMU")) && !gaps.iter().any(|g| g.contains("attitude")), "{gaps:?}");
    let text = tap(&[]);
    assert!(text.contains("ATTITUDE") && text.contains("lost 10 (2.0 %)"), "{text}");
}

#[test]
fn tap_with_nothing_to_hear_says_so() {
    let port = UdpSocket::bind("127.0.0.1:0").and_then(|s| s.local_addr()).expect("a free port").port();
    let mut tap = cargo_bin_cmd!("mavobserver");
    tap.args(["tap", &format!("udpin:127.0.0.1:{port}"), "--duration", "0.3"]);
    let output = tap.assert().code(1).get_output().clone();
    assert!(String::from_utf8_lossy(&output.stderr).contains("nothing arrived"));
}
