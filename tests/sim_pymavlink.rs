//! Every message the simulator sends, as pymavlink decodes it. Needs `python3` with pymavlink; says so and passes where
//! it is absent.

use mavobserver::sim::scenario;
use mavobserver::sim::{Run, RunOptions};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};

/// Prints `NAME COUNT` for every kind of message in the log, and fails on damage or on what it does not know.
const READER: &str = r#"
import collections, os, sys
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
log, seen = mavutil.mavlink_connection(sys.argv[1]), collections.Counter()
while (m := log.recv_match()) is not None:
    seen[m.get_type()] += 1
for name, n in seen.items():
    print(name, n)
"#;

/// A ground station: lists the parameters, then arms and takes off. Prints how many parameters came of how many, by
/// place in the list, the results of the commands, and the height reached.
const STATION: &str = r#"
import os, sys, time
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
link = mavutil.mavlink_connection("udpin:127.0.0.1:" + sys.argv[1], source_system=255)
print("ready", flush=True)
link.wait_heartbeat(timeout=30)
link.param_fetch_all()
places, count, end = set(), None, time.time() + 120
while time.time() < end and (count is None or len(places) < count):
    m = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1)
    if m is not None:
        count = m.param_count
        places.add(m.param_index)
    elif count is None:
        link.param_fetch_all()
    else:
        # this socket overflows when the machine is busy
        for i in sorted(set(range(count)) - places)[:10]:
            link.mav.param_request_read_send(link.target_system, 1, b"", i)
print("parameters", len(places), count)
def command(id, *params):
    for attempt in range(6):
        link.mav.command_long_send(link.target_system, 1, id, attempt, *params)
        ack = link.recv_match(type="COMMAND_ACK", blocking=True, timeout=10)
        if ack is not None:
            return ack.result
mav = mavutil.mavlink
print("arm", command(mav.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0, 0, 0, 0, 0, 0))
print("interval", command(mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 100000, 0, 0, 0, 0, 0))
print("takeoff", command(mav.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 12))
# a minute of the vehicle's own time, however slowly that passes here
highest, began, now = 0, None, 0
while highest < 11.5 and now < 60:
    m = link.recv_match(type="GLOBAL_POSITION_INT", blocking=True, timeout=60)
    if m is None:
        break
    began = m.time_boot_ms if began is None else began
    now = (m.time_boot_ms - began) / 1000
    highest = max(highest, m.relative_alt / 1000)
print("height", highest > 11.5)
"#;

fn pymavlink_is_here() -> bool {
    let here = Command::new("python3").args(["-c", "import pymavlink"]).output().is_ok_and(|o| o.status.success());
    if !here {
        eprintln!("SKIPPED: python3 with pymavlink is not here");
    }
    here
}

#[test]
fn a_pymavlink_ground_station_lists_parameters_and_flies() {
    if !pymavlink_is_here() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for stack in ["ardupilot", "px4"] {
        let file = folder.path().join("idle.toml");
        let text = "name = 'idle'\nvehicle = 'arducopter-sitl'\nduration_s = 900\n";
        std::fs::write(&file, format!("{text}autopilot = '{stack}'\n")).unwrap();
        let port = std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let mut station =
            Command::new("python3").args(["-c", STATION, &port.to_string()]).stdout(Stdio::piped()).spawn().unwrap();
        let mut lines = BufReader::new(station.stdout.take().unwrap()).lines().map(Result::unwrap);
        assert_eq!(lines.next().as_deref(), Some("ready"));
        let mut sim = Command::new(env!("CARGO_BIN_EXE_mavobserver"))
            .args(["sim", "--speed", "10", "--quiet", "--link", &format!("udpout:127.0.0.1:{port}"), "-c"])
            .arg(&file)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let said: Vec<String> = lines.collect();
        sim.kill().unwrap();
        sim.wait().unwrap();
        assert!(station.wait().unwrap().success());
        println!("{stack}: {}", said.join(", "));
        let [parameters, commands @ ..] = &said[..] else { panic!("nothing said") };
        let counts: Vec<&str> = parameters.split(' ').skip(1).collect();
        assert!(counts[0] == counts[1] && counts[0].parse::<u32>().unwrap() > 50, "{stack}: {parameters}");
        assert_eq!(commands, ["arm 0", "interval 0", "takeoff 0", "height True"], "{stack}");
    }
}

#[test]
fn pymavlink_decodes_every_message_of_both_stacks() {
    if !pymavlink_is_here() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["wind-steps", "px4-wind", "hexa"] {
        let mut scenario = scenario::resolve(name).unwrap();
        // everything this stack has, not only what the scenario asks for
        scenario.streams = mavobserver::sim::feed::names().map(|n| (n.to_owned(), 10.0)).collect();
        let mut run = Run::new(&scenario, &RunOptions::default()).unwrap();
        let (mut log, mut sent) = (Vec::new(), BTreeMap::<String, usize>::new());
        while run.now_s() < 20.0 {
            run.advance(&mut |r| {
                log.extend_from_slice(&r.unix_us.to_be_bytes());
                log.extend_from_slice(r.bytes);
                let id = u32::from_le_bytes([r.bytes[7], r.bytes[8], r.bytes[9], 0]);
                let info = mavobserver::wire::message_info(id).unwrap();
                *sent.entry(info.name.to_owned()).or_default() += 1;
            });
        }
        let path = folder.path().join(format!("{name}.tlog"));
        std::fs::write(&path, log).unwrap();
        let output = Command::new("python3").args(["-c", READER]).arg(&path).output().unwrap();
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let read: BTreeMap<String, usize> = text
            .lines()
            .filter_map(|l| l.split_once(' '))
            .map(|(name, n)| (name.to_owned(), n.parse().unwrap()))
            .collect();
        println!("{name}: {} kinds, {} messages", read.len(), read.values().sum::<usize>());
        assert_eq!(read, sent);
    }
}
