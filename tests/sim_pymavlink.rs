//! Every message the simulator sends, as pymavlink decodes it. Needs `python3` with pymavlink; says so and passes where
//! it is absent.

use mavobserver::sim::scenario;
use mavobserver::sim::{Run, RunOptions};
use std::collections::BTreeMap;
use std::process::Command;

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

#[test]
fn pymavlink_decodes_every_message_of_both_stacks() {
    if !Command::new("python3").args(["-c", "import pymavlink"]).output().is_ok_and(|o| o.status.success()) {
        eprintln!("SKIPPED: python3 with pymavlink is not here");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for name in ["wind-steps", "px4-wind"] {
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
