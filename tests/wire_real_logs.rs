//! Logs of real and simulated flights, counted against pymavlink 2.4.50 (`mavutil.mavlogfile`, dialect `all`).
//!
//! The logs are not part of this repository: they are looked for in `$MAVOBSERVER_DATA` or `../shared/data`.

use mavobserver::wire::stats::{LinkStats, Losses};
use mavobserver::wire::tlog::{LogFormat, TlogReader};
use std::path::{Path, PathBuf};

/// What pymavlink counts, and the losses that we count.
struct Expected {
    file: &'static str,
    /// Messages, without `BAD_DATA` and without `UNKNOWN_n`.
    good: u64,
    bad: u64,
    /// Messages that its dialects lack (here LINK_NODE_STATUS, TIME_ESTIMATE_TO_TARGET, EVENT, CURRENT_EVENT_SEQUENCE).
    unknown: u64,
    /// `mav_loss`.
    loss: u64,
    /// Ours.
    lost: u64,
    late: u64,
    restarts: u64,
}

#[rustfmt::skip]
const STAMPED: [Expected; 19] = [
    // One component sends DISTANCE_SENSOR by a definition that differs (1949 bad), so 1955 of the lost frames came, but
    // unreadable. The ground station counts its frames for each of its links: pymavlink takes every change between those
    // counters for a loss of about 256, we do not.
    Expected { file: "real/ardusub_pymavlink_bug.tlog", good: 50136, bad: 1967, unknown: 0, loss: 11522, lost: 2591, late: 12, restarts: 0 },
    // A ground station with three counters. Where two of them meet at the same numbers they cannot be told apart, so a
    // part of these 17 and of the late frames is an artefact.
    Expected { file: "real/crate_mavlink_log.tlog", good: 1426, bad: 0, unknown: 0, loss: 10645, lost: 17, late: 128, restarts: 0 },
    Expected { file: "real/eaics.tlog", good: 8164, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "real/magfit.tlog", good: 2632, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "real/marslab_mav.tlog", good: 270, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    // The vehicle rebooted once, which pymavlink counts as 217 lost frames: 3051 - 217 = 2834. The radio adds 6, which
    // pymavlink leaves out. A serial radio reorders nothing: the 11 late ones are long gaps, which a counter of 8 bits
    // cannot tell from frames up to 96 places late.
    Expected { file: "real/phoenix_m1.tlog", good: 29475, bad: 0, unknown: 0, loss: 3051, lost: 2840, late: 11, restarts: 1 },
    Expected { file: "real/sitl_uavsysid_mav.tlog", good: 6948, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/default_streams.tlog", good: 7430, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/force_dev.tlog", good: 88294, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/mavlink1_req4.tlog", good: 17715, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/motor_degrade.tlog", good: 115079, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/rotor_dev.tlog", good: 48434, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/sensor_dev.tlog", good: 94810, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/wind_dev.tlog", good: 114046, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    Expected { file: "sitl/wind_turb.tlog", good: 145114, bad: 0, unknown: 0, loss: 0, lost: 0, late: 0, restarts: 0 },
    // PX4 sends some replies a few places late; pymavlink counts 256 lost for each. Here bursts were really lost.
    Expected { file: "px4/default_streams.tlog", good: 51629, bad: 0, unknown: 244, loss: 1614, lost: 602, late: 3, restarts: 0 },
    Expected { file: "px4/motor_degrade.tlog", good: 157192, bad: 0, unknown: 308, loss: 3892, lost: 0, late: 14, restarts: 0 },
    Expected { file: "px4/payload.tlog", good: 141321, bad: 0, unknown: 279, loss: 1303, lost: 0, late: 4, restarts: 0 },
    Expected { file: "px4/wind_dev.tlog", good: 225858, bad: 0, unknown: 392, loss: 2952, lost: 0, late: 10, restarts: 0 },
];

fn data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let root = std::env::var_os("MAVOBSERVER_DATA").map_or_else(beside, PathBuf::from);
    if root.is_dir() {
        return Some(root);
    }
    eprintln!("SKIPPED: no flight logs in {} (set MAVOBSERVER_DATA)", root.display());
    None
}

fn count(path: &Path) -> (LogFormat, LinkStats) {
    let mut reader = TlogReader::open(path).unwrap();
    let format = reader.format();
    let mut stats = LinkStats::new();
    let mut now_us = 0;
    while let Some(record) = reader.next().unwrap() {
        now_us = record.received_unix_us.unwrap_or(now_us);
        stats.event(now_us, &record.event);
    }
    (format, stats)
}

#[test]
fn stamped_logs_are_counted_as_pymavlink_counts_them() {
    let Some(root) = data() else { return };
    let mut differences = Vec::new();
    for expected in STAMPED {
        let (format, stats) = count(&root.join(expected.file));
        let file = expected.file;
        assert_eq!(format, LogFormat::Stamped, "{file}");
        assert_eq!(stats.totals().frames, expected.good + expected.unknown, "frames of {file}");
        assert_eq!(stats.totals().unknown, 0, "unknown messages of {file}");
        assert_eq!(stats.bad_frames(), expected.bad, "bad frames of {file}");
        let Losses { lost, late, restarts, naive_lost, .. } = stats.losses();
        // pymavlink does not look at the number of an unknown message and then misses it: one loss each
        assert_eq!(naive_lost, expected.loss - expected.unknown, "losses of {file} as pymavlink counts them");
        let (found, known) = ((lost, late, restarts), (expected.lost, expected.late, expected.restarts));
        if found != known {
            differences.push(format!("{file}: {found:?} in place of {known:?} (lost, late, restarts)"));
        }
    }
    assert!(differences.is_empty(), "{differences:#?}");
}

/// After damage pymavlink skips as many bytes as the damaged header says, we go on at the next byte: of the same
/// stream pymavlink finds 24092 messages, one unknown message in the damage and 44 bad stretches with 509 bytes.
#[test]
fn an_unstamped_log_gives_more_frames_than_pymavlink_finds() {
    let Some(root) = data() else { return };
    let (format, stats) = count(&root.join("real/phoenix_m1.rlog"));
    assert_eq!(format, LogFormat::Raw);
    assert_eq!(stats.totals().frames, 24_092 + 17);
    assert_eq!((stats.bad_frames(), stats.bad_bytes()), (16, 205));
    // 4 of the 17 are the vehicle's, the others the radio's, which pymavlink leaves out of its count of 3035
    assert_eq!(stats.losses().naive_lost, 3035 - 4);
    assert_eq!(stats.losses().restarts, 1);
}

#[test]
fn logs_of_other_kinds_are_refused() {
    let Some(root) = data() else { return };
    for (file, kind) in [
        ("real/copter_3_6_4.bin", "an ArduPilot dataflash log (.bin)"),
        ("px4/px4_events.ulg", "a PX4 ULog"),
        ("sitl/wind_dev.events.csv", "a text file"),
    ] {
        let error = TlogReader::open(&root.join(file)).unwrap_err().to_string();
        assert!(error.contains(kind), "{file}: {error}");
    }
}
