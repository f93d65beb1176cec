//! Each ready config, run as it is (but for ports and devices, which are free ones here) against a simulated vehicle.
#![cfg(target_os = "linux")]

mod live_support;

use assert_cmd::cargo::cargo_bin;
use live_support::flight;
use mavobserver::wire::{Event, datagram};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tokio::net::UdpSocket;

/// An ArduCopter that sends a heartbeat and the time and waits to be asked, in 4 m/s of wind from the east.
const SILENT: &str = "name = 'silent'\ndescription = 'waits to be asked'\nvehicle = 'arducopter-sitl'\n\
    sensors = 'ardupilot-sitl'\nduration_s = 200\nmission = [{ leg = 'takeoff', height_m = 10 }, \
    { leg = 'hover', seconds = 200 }]\n[wind]\nsteps = [{ at_s = 0, from_deg = 90, speed_mps = 4 }]\n";

fn free_port() -> u16 {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").expect("a free port");
    socket.local_addr().expect("bound").port()
}

/// A ready config in a folder of its own, with parts of it replaced.
fn config(folder: &Path, name: &str, replaced: &[(&str, String)]) -> PathBuf {
    let ready = Path::new(env!("CARGO_MANIFEST_DIR")).join("config").join(name);
    let mut text = std::fs::read_to_string(ready).expect("readable");
    for (from, to) in replaced {
        assert!(text.contains(from), "{name} has no {from}");
        text = text.replace(from, to);
    }
    let file = folder.join(name);
    std::fs::write(&file, text).expect("written");
    file
}

/// `mavobserver run -c config --json`, with what it logs.
struct Running {
    child: Child,
    log: std::thread::JoinHandle<Vec<String>>,
}

impl Running {
    fn start(config: &Path) -> Self {
        let mut child = Command::new(cargo_bin!("mavobserver"))
            .args(["run", "--json", "-c"])
            .arg(config)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let lines = BufReader::new(child.stderr.take().expect("piped")).lines();
        let (ready, is_ready) = std::sync::mpsc::sync_channel(1);
        let log = std::thread::spawn(move || {
            let mut all = Vec::new();
            for line in lines.map_while(Result::ok) {
                if line.contains("running;") {
                    let _ = ready.try_send(());
                }
                all.push(line);
            }
            all
        });
        is_ready.recv_timeout(Duration::from_secs(120)).expect("it runs");
        Self { child, log }
    }

    /// Its report and its log.
    fn stop(self) -> (Value, Vec<String>) {
        Command::new("kill").args(["-TERM", &self.child.id().to_string()]).status().expect("kill runs");
        let output = self.child.wait_with_output().expect("ended");
        let log = self.log.join().expect("no panic");
        assert!(output.status.success(), "{log:#?}");
        (serde_json::from_slice(&output.stdout).expect("one JSON object"), log)
    }
}

/// A simulated flight of so many seconds, twice as fast as real.
fn simulator(folder: &Path, scenario: &str, link: &str, seconds: u32) -> Child {
    let file = folder.join("scenario.toml");
    let scenario = if scenario.contains('=') {
        std::fs::write(&file, scenario).expect("written");
        file.to_str().expect("UTF-8")
    } else {
        scenario
    };
    Command::new(cargo_bin!("mavobserver"))
        .args(["-q", "sim", scenario, "--speed", "2", "--duration", &seconds.to_string(), "--link", link])
        .stdout(Stdio::null())
        .spawn()
        .expect("starts")
}

async fn ended(mut simulator: Child) {
    let ended = tokio::task::spawn_blocking(move || simulator.wait().expect("ended")).await.expect("no panic");
    assert!(ended.success());
}

fn wind(report: &Value) -> Vec<f64> {
    let wind = report["vehicles"][0]["wind"]["velocity_ned_mps"].as_array();
    wind.unwrap_or_else(|| panic!("no wind: {report:#}")).iter().map(|x| x.as_f64().expect("a number")).collect()
}

fn from_the_east(report: &Value) {
    let wind = wind(report);
    assert!(wind[0].abs() < 0.5 && (wind[1] + 4.0).abs() < 0.5, "{wind:?}");
}

/// Nothing is amiss once all streams have been asked for: links that are not there yet are told, and observers that wait
/// for a stream which is asked for after the others.
fn no_warnings(log: &[String]) {
    let starting = |line: &&String| line.contains("trying again") || line.contains("is starved of");
    let warnings = log.iter().filter(|line| line.contains("WARN") || line.contains("ERROR"));
    let warnings: Vec<_> = warnings.filter(|line| !starting(line)).collect();
    assert!(warnings.is_empty(), "{warnings:#?}");
    let place = |text: &str| log.iter().rposition(|line| line.contains(text));
    assert!(place("estimating wrench and wind") > place("is starved of"), "{log:#?}");
}

#[tokio::test]
async fn ardupilots_simulator() {
    let folder = tempfile::tempdir().expect("a folder");
    let tcp = free_port();
    let ports = [
        ("127.0.0.1:5760", format!("127.0.0.1:{tcp}")),
        ("127.0.0.1:5762", format!("127.0.0.1:{}", free_port())),
        ("127.0.0.1:14550", format!("127.0.0.1:{}", free_port())),
        ("127.0.0.1:5770", format!("127.0.0.1:{}", free_port())),
    ];
    let running = Running::start(&config(folder.path(), "arducopter-sitl.toml", &ports));
    ended(simulator(folder.path(), SILENT, &format!("tcpin:127.0.0.1:{tcp}"), 34)).await;
    let (report, log) = running.stop();
    from_the_east(&report);
    assert!(report["observers"].as_array().is_some_and(|o| o.len() >= 3), "{report:#}");
    no_warnings(&log);
}

#[tokio::test]
async fn px4s_simulator_with_qgroundcontrol_beside_it() {
    let folder = tempfile::tempdir().expect("a folder");
    let station = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let port = free_port();
    let ports = [
        ("127.0.0.1:14540", format!("127.0.0.1:{port}")),
        ("127.0.0.1:14551", station.local_addr().expect("bound").to_string()),
    ];
    let running = Running::start(&config(folder.path(), "px4-sitl.toml", &ports));
    ended(simulator(folder.path(), "px4-wind", &format!("udpout:127.0.0.1:{port}"), 34)).await;
    let (report, log) = running.stop();
    wind(&report);
    no_warnings(&log);
    let mut heard = BTreeSet::new();
    let mut buffer = [0; 2048];
    while let Ok(length) = station.try_recv(&mut buffer) {
        for event in datagram(&buffer[..length]) {
            if let Event::Frame(frame) = event {
                heard.insert((frame.component_id(), frame.message_id()));
            }
        }
    }
    let of_vehicle: Vec<_> = heard.iter().filter(|(component, _)| *component == 1).collect();
    assert_eq!(of_vehicle, [&(1, 0)], "the vehicle's own telemetry reaches QGroundControl by itself");
    assert!(heard.contains(&(191, 44_101)) && heard.contains(&(191, 0)), "{heard:?}");
}

#[tokio::test]
async fn a_log_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let port = free_port();
    let running =
        Running::start(&config(folder.path(), "log-only.toml", &[("0.0.0.0:14560", format!("127.0.0.1:{port}"))]));
    // a vehicle that was asked already, by whoever mirrors its telemetry
    let vehicle = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let radio = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let air = radio.local_addr().expect("bound");
    let flight = simulator(folder.path(), "wind-steps", &format!("udpout:{air}"), 24);
    let mirror = tokio::spawn(async move {
        let mut buffer = [0; 2048];
        loop {
            let length = radio.recv(&mut buffer).await.expect("receives");
            vehicle.send_to(&buffer[..length], ("127.0.0.1", port)).await.expect("sent");
            assert!(vehicle.try_recv(&mut [0; 1]).is_err(), "something was sent to the vehicle");
        }
    });
    ended(flight).await;
    mirror.abort();
    let (report, log) = running.stop();
    wind(&report);
    no_warnings(&log);
    let records = std::fs::read_dir(folder.path().join("logs")).expect("made").flatten();
    let records: Vec<_> = records.map(|f| f.file_name().into_string().expect("UTF-8")).collect();
    assert!(["Z.tlog", ".mcap"].iter().all(|end| records.iter().any(|name| name.ends_with(end))), "{records:?}");
}

/// A serial line: what comes by UDP goes out at the other end of `device`, at its speed, and back.
async fn serial_line(device: &Path, bytes_per_s: f64) -> (SocketAddr, tokio::task::JoinHandle<()>) {
    let terminals = || -> BTreeSet<PathBuf> {
        let files = std::fs::read_dir("/proc/self/fd").expect("Linux").flatten();
        files.filter_map(|f| std::fs::read_link(f.path()).ok()).filter(|f| f.starts_with("/dev/pts")).collect()
    };
    let before = terminals();
    let (ours, theirs) = serial2_tokio::SerialPort::pair().expect("a pseudo-terminal");
    let after = terminals();
    let name = after.difference(&before).find(|name| !name.ends_with("ptmx")).expect("its name");
    std::os::unix::fs::symlink(name, device).expect("linked");
    let socket = UdpSocket::bind("127.0.0.1:0").await.expect("a free port");
    let address = socket.local_addr().expect("bound");
    let line = tokio::spawn(async move {
        // the daemon opens it by its name; until then somebody has to hold it
        let _theirs = theirs;
        let (mut from_air, mut from_line) = ([0; 2048], [0; 2048]);
        let (mut vehicle, mut free_at) = (None, Instant::now());
        loop {
            tokio::select! {
                received = socket.recv_from(&mut from_air) => {
                    let (length, from) = received.expect("receives");
                    vehicle = Some(from);
                    let now = Instant::now();
                    // a full buffer loses whole frames
                    if free_at.saturating_duration_since(now).as_secs_f64() * bytes_per_s < 2_048.0 {
                        free_at = free_at.max(now) + Duration::from_secs_f64(length as f64 / bytes_per_s);
                        ours.write_all(&from_air[..length]).await.expect("written");
                    }
                }
                received = ours.read(&mut from_line) => {
                    let length = received.expect("reads");
                    if let Some(vehicle) = vehicle {
                        // the simulator puts the frames together again
                        socket.send_to(&from_line[..length], vehicle).await.expect("sent");
                    }
                }
            }
        }
    });
    (address, line)
}

#[tokio::test]
async fn a_companion_on_the_serial_port() {
    let folder = tempfile::tempdir().expect("a folder");
    let device = folder.path().join("ttyAMA0");
    let (air, line) = serial_line(&device, 92_160.0).await;
    let replaced =
        [("/dev/ttyAMA0", device.display().to_string()), ("0.0.0.0:14550", format!("127.0.0.1:{}", free_port()))];
    let running = Running::start(&config(folder.path(), "companion-serial.toml", &replaced));
    ended(simulator(folder.path(), SILENT, &format!("udpout:{air}"), 34)).await;
    let (report, log) = running.stop();
    line.abort();
    from_the_east(&report);
    no_warnings(&log);
}

#[tokio::test]
async fn on_the_ground_behind_a_slow_radio() {
    let folder = tempfile::tempdir().expect("a folder");
    let device = folder.path().join("ttyUSB0");
    // twice the speed of the line, as time passes twice as fast
    let (air, line) = serial_line(&device, 11_520.0).await;
    let replaced =
        [("/dev/ttyUSB0", device.display().to_string()), ("127.0.0.1:14551", format!("127.0.0.1:{}", free_port()))];
    let running = Running::start(&config(folder.path(), "ground-side.toml", &replaced));
    ended(simulator(folder.path(), SILENT, &format!("udpout:{air}"), 40)).await;
    let (report, log) = running.stop();
    line.abort();
    from_the_east(&report);
    no_warnings(&log);
    let radio = &report["links"][0];
    assert!(radio["lost_in"].as_u64() < Some(20), "{radio:#}");
}

/// What a user types to see whether a vehicle is paired well.
#[tokio::test]
async fn check_live_tells_what_was_found_and_decided() {
    let folder = tempfile::tempdir().expect("a folder");
    let port = free_port();
    let mut flight = simulator(folder.path(), SILENT, &format!("udpout:127.0.0.1:{port}"), 60);
    let output = tokio::task::spawn_blocking(move || {
        Command::new(cargo_bin!("mavobserver"))
            .args([
                "-q",
                "check",
                "--live",
                "15",
                "--vehicle",
                "px4-x500",
                "--link",
                &format!("udpin:127.0.0.1:{port}"),
            ])
            .output()
            .expect("runs")
    })
    .await
    .expect("no panic");
    let _ = flight.kill();
    flight.wait().expect("ended");
    let (text, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{text}{errors}");
    for part in ["ArduPilot 4.6.3", "23 of 23 read", "HIGHRES_IMU granted at 50.0 Hz, was off", "! model"] {
        assert!(text.contains(part), "{part} is missing of\n{text}");
    }
}

/// A recorded link with two stations and no vehicle is nobody to pair with.
#[test]
fn check_live_says_when_nobody_is_there() {
    let Some(log) = flight("real/marslab_mav.tlog") else { return };
    let output = Command::new(cargo_bin!("mavobserver"))
        .args(["-q", "check", "--live", "1", "--vehicle", "px4-sih", "--link"])
        .arg(format!("tlog:{}?speed=max", log.display()))
        .output()
        .expect("runs");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("no autopilot of a multirotor was heard"));
}
