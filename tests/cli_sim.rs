//! `mavobserver sim` as a user meets it.

use assert_cmd::cargo::cargo_bin_cmd;
use mavobserver::wire::dialect::ardupilotmega::{
    ATTITUDE_QUATERNION_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, TIMESYNC_DATA,
};
use mavobserver::wire::{Encoder, Event, Parser, decode};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::net::UdpSocket;
use std::path::Path;
use std::time::Duration;

fn sim(args: &[&str]) -> assert_cmd::assert::Assert {
    cargo_bin_cmd!("mavobserver").arg("sim").args(args).assert()
}

fn stdout(a: &assert_cmd::assert::Assert) -> String {
    String::from_utf8(a.get_output().stdout.clone()).unwrap()
}

fn stderr(a: &assert_cmd::assert::Assert) -> String {
    String::from_utf8(a.get_output().stderr.clone()).unwrap()
}

fn path(p: &Path) -> &str {
    p.to_str().unwrap()
}

#[test]
fn the_list_names_every_scenario() {
    let text = stdout(&sim(&["--list"]).success());
    for name in ["hover", "wind-steps", "paper-disturbance", "px4-wind"] {
        assert!(text.contains(name), "{text}");
    }
}

#[test]
fn files_are_the_same_for_the_same_seed() {
    let folder = tempfile::tempdir().unwrap();
    let fly = |name: &str, seed: &str| {
        let (log, truth) = (folder.path().join(format!("{name}.tlog")), folder.path().join(format!("{name}.csv")));
        let args = ["wind-steps", "--duration", "15", "--seed", seed, "--tlog", path(&log), "--truth", path(&truth)];
        sim(&args).success();
        (std::fs::read(log).unwrap(), std::fs::read_to_string(truth).unwrap())
    };
    let (first, again, other) = (fly("a", "5"), fly("b", "5"), fly("c", "6"));
    assert_eq!(first, again);
    assert_ne!(first.0, other.0);
    assert!(first.1.starts_with("t_boot_s,"));
    assert_eq!(first.1.lines().count(), 1 + 15 * 50);
}

#[test]
fn several_vehicles_write_their_own_truth_and_the_summary_counts_them() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("t.csv");
    let out =
        stdout(&sim(&["hover", "--vehicles", "3", "--duration", "10", "--truth", path(&truth), "--json"]).success());
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(report["vehicles"].as_array().unwrap().len(), 3);
    assert!(report["frames"].as_u64().unwrap() > 6_000);
    assert!((1..=3).all(|n| folder.path().join(format!("t.{n}.csv")).is_file()));
}

#[test]
fn many_vehicles_share_one_port_and_each_obeys_its_own_commands() {
    let ground = UdpSocket::bind("127.0.0.1:0").unwrap();
    ground.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let url = format!("udpout:127.0.0.1:{}", ground.local_addr().unwrap().port());
    let flight = std::thread::spawn(move || {
        sim(&["demo", "--vehicles", "12", "--link", &url, "--duration", "10", "--speed", "4"]).success();
    });
    let (mut encoder, mut parser) = (Encoder::new(255, 190), Parser::new());
    let mut datagram = [0; 300];
    let (mut systems, mut attitudes) = (BTreeSet::new(), BTreeMap::<u8, u32>::new());
    while !flight.is_finished() {
        let Ok((len, from)) = ground.recv_from(&mut datagram) else { continue };
        parser.push(&datagram[..len]);
        while let Some(event) = parser.next() {
            let Event::Frame(frame) = event else { continue };
            if systems.insert(frame.system_id()) && frame.system_id() == 7 {
                let ask = COMMAND_LONG_DATA {
                    param1: 31.0,
                    param2: 50_000.0,
                    command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                    target_system: 7,
                    target_component: 1,
                    ..Default::default()
                };
                ground.send_to(encoder.encode(&ask).bytes(), from).unwrap();
            }
            if decode::<ATTITUDE_QUATERNION_DATA>(frame).is_some() {
                *attitudes.entry(frame.system_id()).or_default() += 1;
            }
        }
    }
    flight.join().unwrap();
    assert_eq!(systems, (1..=12).collect());
    assert_eq!(attitudes.keys().copied().collect::<Vec<_>>(), [7], "only the seventh was asked");
    assert!(attitudes[&7] > 100, "{attitudes:?}");
}

#[test]
fn a_link_carries_frames_at_the_pace_asked_for() {
    let ground = UdpSocket::bind("127.0.0.1:0").unwrap();
    ground.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    let url = format!("udpout:127.0.0.1:{}", ground.local_addr().unwrap().port());
    let flight = std::thread::spawn(move || {
        let started = std::time::Instant::now();
        sim(&["hover", "--link", &url, "--duration", "3", "--speed", "3"]).success();
        started.elapsed()
    });
    let mut datagram = [0; 300];
    let mut frames = 0;
    while frames < 500 {
        let (len, _) = ground.recv_from(&mut datagram).unwrap();
        assert_eq!((datagram[0], usize::from(datagram[1]) + 12), (0xFD, len), "one frame, one datagram");
        frames += 1;
    }
    assert!(flight.join().unwrap() >= Duration::from_secs(1));
}

#[test]
fn lock_step_waits_for_the_station_and_loses_nothing() {
    let ground = UdpSocket::bind("127.0.0.1:0").unwrap();
    ground.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    let url = format!("udpout:127.0.0.1:{}", ground.local_addr().unwrap().port());
    let flight = std::thread::spawn(move || {
        let arguments = ["hover", "--link", &url, "--duration", "20", "--lockstep", "10", "--json"];
        stdout(&sim(&arguments).success())
    });
    let (mut encoder, mut parser) = (Encoder::new(255, 190), Parser::new());
    let mut datagram = [0; 300];
    let (mut spoken, mut answered, mut stamps) = (false, 0, Vec::new());
    while !flight.is_finished() {
        let Ok((len, from)) = ground.recv_from(&mut datagram) else { continue };
        if !spoken {
            spoken = true;
            ground.send_to(encoder.encode(&HEARTBEAT_DATA::default()).bytes(), from).unwrap();
        }
        parser.push(&datagram[..len]);
        while let Some(event) = parser.next() {
            let Event::Frame(frame) = event else { continue };
            if let Some(attitude) = decode::<ATTITUDE_QUATERNION_DATA>(frame) {
                stamps.push(attitude.time_boot_ms);
            }
            if let Some(ask) = decode::<TIMESYNC_DATA>(frame).filter(|t| t.tc1 == 0 && t.target_component == 190) {
                assert_eq!(ask.target_system, 255);
                // a slow station: time has to wait for it
                std::thread::sleep(Duration::from_millis(1));
                let answer = TIMESYNC_DATA { tc1: 1, ts1: ask.ts1, ..Default::default() };
                ground.send_to(encoder.encode(&answer).bytes(), from).unwrap();
                answered += 1;
            }
        }
    }
    let report: Value = serde_json::from_str(&flight.join().unwrap()).unwrap();
    // 20 s in slices of 10 ms, less those before the station spoke
    assert!(report["lockstep_slices"].as_u64().unwrap() > 500, "{report}");
    assert!(answered > 500);
    // 50 Hz without a gap, however slow the station; the first frame comes before the grid of the others
    assert!(stamps.len() >= 990 && stamps[1..].windows(2).all(|w| (19..=21).contains(&(w[1] - w[0]))));
}

#[test]
fn what_cannot_be_flown_is_told_with_the_right_code() {
    let unknown = sim(&["wind-step"]).code(2);
    assert!(stderr(&unknown).contains("did you mean `wind-steps`?"));
    sim(&[]).code(2);
    sim(&["hover", "--speed", "0"]).code(2);
    sim(&["hover", "--link", "tlog:x.tlog"]).code(2);
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let url = format!("udpin:127.0.0.1:{}", taken.local_addr().unwrap().port());
    assert!(stderr(&sim(&["hover", "--link", &url]).code(1)).contains(&url));
    assert!(stderr(&sim(&["hover", "--tlog", "no/such/folder/x.tlog"]).code(1)).contains("cannot write"));

    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("bad.toml");
    std::fs::write(&file, "name = 'x'\nvehicle = 'px4-sih'\nduration_s = -1\nsede = 4\n").unwrap();
    let bad = stderr(&sim(&["-c", path(&file)]).code(2));
    assert!(bad.contains("2 problems") && bad.contains("did you mean `seed`?"), "{bad}");
}
