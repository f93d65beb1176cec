//! What the daemon sends, as pymavlink decodes it. Needs `python3` with pymavlink; says so and passes where it is absent.

mod live_support;

use live_support::*;
use mavobserver::config::LinkUrl;
use mavobserver::daemon::Settings;
use mavobserver::pipeline::{Fleet, FleetSettings, VehicleId};
use mavobserver::wire::Encoder;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

/// Our dialect as pymavlink's generator makes it, and the peer that uses it.
fn start_peer(directory: &Path) -> Option<(Child, BufReader<std::process::ChildStdout>, u16)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let module = directory.join("estimates.py");
    let made = Command::new("python3")
        .args(["-m", "pymavlink.tools.mavgen", "--lang", "Python3", "--wire-protocol", "2.0", "-o"])
        .arg(&module)
        .arg(root.join("dialects/mavobserver.xml"))
        .output();
    if !made.as_ref().is_ok_and(|m| m.status.success() && module.exists()) {
        let missing = Command::new("python3").args(["-c", "import pymavlink"]).status();
        assert!(!missing.is_ok_and(|s| s.success()), "pymavlink is here, but refuses our dialect: {made:?}");
        eprintln!("SKIPPED: python3 with pymavlink is not here");
        return None;
    }
    let mut child = Command::new("python3")
        .arg(root.join("tests/pymavlink_peer.py"))
        .arg(&module)
        .stdout(Stdio::piped())
        .spawn()
        .expect("python starts");
    let mut lines = BufReader::new(child.stdout.take().expect("piped"));
    let mut port = String::new();
    lines.read_line(&mut port).expect("a line");
    Some((child, lines, port.trim().parse().expect("the port")))
}

fn numbers(value: &Value) -> Vec<f32> {
    let number = |v: &Value| match v {
        Value::String(s) => s.parse().expect("inf or nan"),
        other => other.as_f64().expect("a number") as f32,
    };
    value.as_array().expect("a list").iter().map(number).collect()
}

#[tokio::test]
async fn pymavlink_decodes_all_that_leaves() {
    let directory = tempfile::tempdir().expect("a directory");
    let Some((mut child, lines, port)) = start_peer(directory.path()) else { return };
    let station = LinkUrl::UdpOut { host: "127.0.0.1".to_owned(), port };
    let mut echoed = talking(station.clone());
    echoed.output.rates.wind_cov = mavobserver::outputs::Rate::hz(5.0);

    // first known numbers, then a real observer
    let daemon = Running::start(Settings::new(vec![silent(any_port()), echoed]), Echo::default()).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    for frame in flight_of(&mut Encoder::new(7, 1), 150) {
        vehicle.send(frame.bytes()).await;
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    daemon.stop().await;
    let model = Arc::new(mavobserver::vehicle::resolve("arducopter-sitl").expect("a preset"));
    let fleet = Fleet::new(FleetSettings::standard(model)).expect("a design");
    let daemon = Running::start(Settings::new(vec![silent(any_port()), talking(station)]), fleet).await;
    let vehicle = Peer::new(Some(daemon.address(0))).await;
    let mut encoder = Encoder::new(8, 1);
    for k in 0..150 {
        for frame in hover_step(&mut encoder, k) {
            vehicle.send(frame.bytes()).await;
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    daemon.stop().await;

    let messages: Vec<Value> = tokio::task::spawn_blocking(move || {
        let lines: Vec<_> = lines.lines().map(|l| serde_json::from_str(&l.expect("a line")).expect("JSON")).collect();
        child.wait().expect("ended");
        lines
    })
    .await
    .expect("no panic");

    let mut by_name: BTreeMap<(u64, &str), Vec<&Value>> = BTreeMap::new();
    for message in messages.iter().filter(|m| m["component"] == 191) {
        let key = (message["system"].as_u64().expect("an id"), message["name"].as_str().expect("a name"));
        by_name.entry(key).or_default().push(&message["fields"]);
    }
    let heartbeat = &by_name[&(7, "HEARTBEAT")][0];
    assert_eq!((&heartbeat["type"], &heartbeat["autopilot"]), (&Value::from(18), &Value::from(8)));
    let everything = [
        "STATUSTEXT",
        "DEBUG_VECT",
        "DEBUG_FLOAT_ARRAY",
        "NAMED_VALUE_FLOAT",
        "WIND_COV",
        "WRENCH_ESTIMATE",
        "WIND_ESTIMATE",
        "FAULT_STATUS",
    ];
    for name in everything {
        assert!(by_name.contains_key(&(7, name)), "{name} is missing of {:?}", by_name.keys());
    }
    for name in ["STATE_BOUNDS", "OBSERVER_STATUS"] {
        assert!(by_name.contains_key(&(8, name)), "{name} is missing of {:?}", by_name.keys());
    }

    let vehicle = VehicleId { system: 7, component: 1 };
    let truth: BTreeMap<u64, _> = (0..150)
        .map(|k| (1_000 * u64::from(attitude(k).time_boot_ms), Echo::snapshot(vehicle, &attitude(k), 0)))
        .collect();
    let floats = |v: nalgebra::Vector3<f64>| vec![v.x as f32, v.y as f32, v.z as f32];
    for wrench in &by_name[&(7, "WRENCH_ESTIMATE")] {
        let truth = truth[&wrench["time_boot_us"].as_u64().expect("µs")].wrench.expect("always");
        assert_eq!(numbers(&wrench["force_ned"]), floats(truth.force_ned_n));
        assert_eq!(numbers(&wrench["torque_frd"]), floats(truth.torque_frd_nm));
        assert_eq!(numbers(&wrench["torque_half_width"]), [f32::INFINITY; 3]);
        assert_eq!((&wrench["guarantee"], &wrench["verdict"]), (&Value::from(2), &Value::from(0)));
    }
    for array in by_name[&(7, "DEBUG_FLOAT_ARRAY")].iter().filter(|a| a["array_id"] == 1) {
        let snapshot = &truth[&array["time_usec"].as_u64().expect("µs")];
        let data = numbers(&array["data"]);
        assert_eq!(data[0..3], floats(snapshot.wrench.expect("always").force_ned_n));
        assert_eq!(data[12..15], floats(snapshot.wind.expect("always").velocity_ned_mps));
        assert!(data[9].is_nan());
    }
    let names = |name: &str| {
        let named = by_name[&(7, name)].iter();
        named.map(|f| f["name"].as_str().expect("text")).collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(names("DEBUG_VECT"), ["WR_F", "WR_T"].into());
    assert!(names("NAMED_VALUE_FLOAT").contains("WindSpd"));
    assert_eq!(by_name[&(8, "OBSERVER_STATUS")][0]["name"], "quadratic_bounded");

    // and what was bridged is whole too
    let bridged = messages.iter().filter(|m| m["component"] == 1 && m["name"] == "ATTITUDE").count();
    assert_eq!(bridged, 150);
}

fn has(module: &str) -> bool {
    let found = Command::new("python3").args(["-c", &format!("import {module}")]).stderr(Stdio::null()).status();
    let found = found.is_ok_and(|status| status.success());
    if !found {
        eprintln!("SKIPPED: python3 with {module} is not here");
    }
    found
}

/// A script beside this test, with what it prints.
fn python(script: &str, arguments: &[&str]) -> Child {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests").join(script);
    Command::new("python3").arg(script).args(arguments).stdout(Stdio::piped()).spawn().expect("python starts")
}

fn json_of(child: Child) -> Value {
    let output = child.wait_with_output().expect("ended");
    let text = String::from_utf8(output.stdout).expect("text");
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

const PATIENCE_S: &str = "60";

/// Everything that a station and a vehicle do at the start, both ends by pymavlink, through UDP and TCP.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn pymavlink_talks_through_the_bridge_both_ways() {
    if !has("pymavlink") {
        return;
    }
    let server = LinkUrl::TcpIn { host: "127.0.0.1".to_owned(), port: 0 };
    let daemon = Running::start(Settings::new(vec![silent(any_port()), silent(server)]), Idle).await;
    let vehicle = python("bridge_vehicle.py", &[&format!("udpout:{}", daemon.address(0)), PATIENCE_S]);
    let station = python("bridge_station.py", &[&format!("tcp:{}", daemon.address(1)), PATIENCE_S]);
    let (station, vehicle) = tokio::task::spawn_blocking(|| (json_of(station), json_of(vehicle))).await.expect("ended");
    assert_eq!(station["parameters"].as_object().map(|p| p.len()), Some(60), "{station}");
    assert_eq!((&station["set"], &station["acknowledged"]), (&77.0.into(), &0.into()), "{station}");
    assert_eq!((&station["uploaded"], &station["fetched"]), (&0.into(), &true.into()), "{station}");
    assert_eq!(vehicle["mission"].as_array().map(Vec::len), Some(25), "{vehicle}");
    let summary = daemon.stop().await;
    let links = &summary.status.links;
    assert!(links.iter().all(|l| l.bad_in == 0 && l.lost_in == 0 && l.dropped_out == 0), "{links:?}");
}

const MISSION: &str = "QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t47.3977\t8.5456\t488\t1
1\t0\t3\t22\t0\t0\t0\t0\t47.3977\t8.5456\t10\t1
2\t0\t3\t16\t0\t0\t0\t0\t47.3987\t8.5466\t20\t1
";

/// The same vehicle with MAVProxy as its station, which is told what to do as by its user.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn mavproxy_talks_through_the_bridge() {
    if !has("pymavlink") || !has("MAVProxy") {
        return;
    }
    let directory = tempfile::tempdir().expect("a directory");
    std::fs::write(directory.path().join("mission.txt"), MISSION).expect("written");
    let daemon = Running::start(Settings::new(vec![silent(any_port()), silent(any_port())]), Idle).await;
    let proxy = Command::new("mavproxy.py")
        .arg(format!("--master=udpout:{}", daemon.address(1)))
        .arg("--default-modules=param,wp,cmdlong")
        .current_dir(directory.path())
        .env("HOME", directory.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let Ok(mut proxy) = proxy else {
        eprintln!("SKIPPED: mavproxy.py is not here");
        return;
    };
    let mut vehicle = python("bridge_vehicle.py", &[&format!("udpout:{}", daemon.address(0)), PATIENCE_S]);
    let heard = tokio::task::spawn_blocking(move || {
        let mut keyboard = proxy.stdin.take().expect("piped");
        // said again until all of it was heard: MAVProxy refuses while it knows no vehicle
        while vehicle.try_wait().expect("a child").is_none() {
            // it may have ended by itself
            let _ = keyboard.write_all(b"wp load mission.txt\nlong 511 30 100000\n");
            std::thread::sleep(Duration::from_secs(2));
        }
        let _ = proxy.kill();
        proxy.wait().expect("ended");
        json_of(vehicle)
    });
    let heard = heard.await.expect("ended");
    assert!(heard["station_heartbeats"].as_u64() > Some(0), "{heard}");
    assert!(heard["parameters_asked"].as_u64() > Some(0), "{heard}");
    assert!(heard["commands"].as_array().is_some_and(|c| c.contains(&511.into())), "{heard}");
    let mission = heard["mission"].as_array().expect("a list");
    assert_eq!(mission.iter().map(|item| item[0].as_i64()).collect::<Vec<_>>(), [Some(16), Some(22), Some(16)]);
    daemon.stop().await;
}
