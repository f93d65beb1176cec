//! Telemetry log to MCAP: messages a second on one core, and beside it `mavlogdump.py --format json` on the same log where
//! pymavlink is installed (`MAVOBSERVER_PYTHON` names another interpreter than `python3`).
//!
//! `MAVOBSERVER_DATA` names a folder of flights, of which `px4/wind_dev.tlog` (226 250 messages) is taken; without it a
//! simulated flight serves.

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use mavobserver::record::{Encoding, log_to_mcap, mcap_to_log};
use mavobserver::sim::{Run, RunOptions, scenario};
use std::hint::black_box;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

fn simulated(path: &Path) {
    let mut run = Run::new(&scenario::resolve("wind-steps").unwrap(), &RunOptions::default()).unwrap();
    let mut log = Vec::new();
    while run.now_s() < 60.0 {
        run.advance(&mut |r| {
            log.extend_from_slice(&r.unix_us.to_be_bytes());
            log.extend_from_slice(r.bytes);
        });
    }
    std::fs::write(path, log).unwrap();
}

fn log(folder: &Path) -> PathBuf {
    let root = std::env::var_os("MAVOBSERVER_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let real = root.join("px4/wind_dev.tlog");
    if real.exists() {
        return real;
    }
    eprintln!("SKIPPED: no {}; a simulated flight instead", real.display());
    let path = folder.join("sim.tlog");
    simulated(&path);
    path
}

fn convert(log: &Path) -> (u64, Vec<u8>) {
    let sink = Cursor::new(Vec::with_capacity(64 << 20));
    let (converted, sink) = log_to_mcap(log, sink, Encoding::Protobuf, &mut |_| {}).unwrap();
    (converted.counts.frames, sink.into_inner())
}

/// One run of the peer, printed as a ratio: it takes minutes, which no sampling needs.
fn beside(log: &Path, messages: u64) {
    let python = std::env::var("MAVOBSERVER_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let begin = Instant::now();
    let dump = ["-m", "pymavlink.tools.mavlogdump", "--format", "json"];
    let peer = Command::new(&python).args(dump).arg(log).stdout(Stdio::null()).stderr(Stdio::null()).status();
    let theirs = begin.elapsed().as_secs_f64();
    if !peer.is_ok_and(|status| status.success()) {
        eprintln!("SKIPPED: {python} with pymavlink's mavlogdump is not here");
        return;
    }
    let begin = Instant::now();
    black_box(convert(log));
    let ours = begin.elapsed().as_secs_f64();
    eprintln!(
        "{messages} messages: mavlogdump {theirs:.1} s, convert {ours:.3} s, {:.0} times as fast; {:.0} messages/s",
        theirs / ours,
        messages as f64 / ours
    );
}

fn record(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let (messages, recording) = convert(&log);
    let path = folder.path().join("x.mcap");
    std::fs::write(&path, recording).unwrap();
    beside(&log, messages);
    let mut group = c.benchmark_group("record");
    group.sample_size(10).throughput(Throughput::Elements(messages));
    group.bench_function("tlog to mcap", |b| b.iter(|| black_box(convert(&log))));
    group.bench_function("mcap to tlog", |b| {
        b.iter_batched(
            Vec::new,
            |sink| black_box(mcap_to_log(&path, sink, &mut |_| {}).unwrap()),
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

criterion_group!(benches, record);
criterion_main!(benches);
