//! Frames per second and core: our framing beside the reader of `mavlink-core`, on the same bytes in the same run.
//!
//! The goal is a million frames of 40 bytes (ATTITUDE, MAVLink 2) per second; `ours/chunks of 1400` against
//! `mavlink-core/raw` is the fair pair, both check every checksum and give whole frames.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mavlink_core::MavlinkReader;
use mavobserver::wire::dialect::ardupilotmega::{ATTITUDE_DATA, MavMessage};
use mavobserver::wire::stats::LinkStats;
use mavobserver::wire::tlog::{TlogReader, TlogWriter};
use mavobserver::wire::{Encoder, Event, FrameBuf, FrameRef, Parser, datagram, decode};
use std::hint::black_box;

const FRAMES: usize = 10_000;

fn attitude(i: usize) -> ATTITUDE_DATA {
    let angle = 1e-3 * i as f32 + 0.1;
    ATTITUDE_DATA {
        time_boot_ms: 20 * i as u32,
        roll: angle,
        pitch: -angle,
        yaw: 2.0 * angle,
        rollspeed: 0.3,
        pitchspeed: -0.2,
        yawspeed: 0.1,
    }
}

fn flight() -> Vec<FrameBuf> {
    let mut encoder = Encoder::new(1, 1);
    let frames: Vec<_> = (0..FRAMES).map(|i| encoder.encode(&attitude(i))).collect();
    assert!(frames.iter().all(|frame| frame.bytes().len() == 40));
    frames
}

/// Pushes a stream in packets as large as a network gives them; returns how many frames came out.
fn parse(bytes: &[u8], mut each: impl FnMut(FrameRef<'_>)) -> usize {
    let mut parser = Parser::new();
    let mut frames = 0;
    for chunk in bytes.chunks(1400) {
        parser.push(chunk);
        while let Some(event) = parser.next() {
            if let Event::Frame(frame) = event {
                frames += 1;
                each(frame);
            }
        }
    }
    frames
}

fn decoding(c: &mut Criterion) {
    let frames = flight();
    let stream: Vec<u8> = frames.iter().flat_map(|frame| frame.bytes().to_vec()).collect();
    let mut log = TlogWriter::new(Vec::new());
    for (i, frame) in frames.iter().enumerate() {
        log.write(20_000 * i as u64, frame.as_ref()).expect("memory takes any amount");
    }
    let log = log.into_inner();

    let mut group = c.benchmark_group("decode 40-byte frames");
    group.throughput(Throughput::Elements(FRAMES as u64));
    group.bench_function("ours/chunks of 1400", |b| {
        b.iter(|| {
            let count = parse(&stream, |frame| {
                black_box(frame.bytes());
            });
            assert_eq!(count, FRAMES);
        });
    });
    group.bench_function("ours/datagrams", |b| {
        b.iter(|| {
            let count = frames.iter().flat_map(|frame| datagram(black_box(frame.bytes()))).count();
            assert_eq!(count, FRAMES);
        });
    });
    group.bench_function("ours/typed", |b| {
        b.iter(|| {
            parse(&stream, |frame| {
                black_box(decode::<ATTITUDE_DATA>(frame));
            })
        });
    });
    group.bench_function("ours/with statistics", |b| {
        b.iter(|| {
            let mut stats = LinkStats::new();
            let mut now_us = 0;
            parse(&stream, |frame| {
                now_us += 20_000;
                stats.frame(now_us, frame);
            });
            assert_eq!(stats.losses().lost, 0);
        });
    });
    group.bench_function("ours/tlog", |b| {
        b.iter(|| {
            let mut reader = TlogReader::new(&log[..]).expect("a log");
            let mut count = 0;
            while let Ok(Some(record)) = reader.next() {
                count += usize::from(matches!(black_box(record).event, Event::Frame(_)));
            }
            assert_eq!(count, FRAMES);
        });
    });
    group.bench_function("mavlink-core/raw", |b| {
        b.iter(|| {
            let mut reader = MavlinkReader::new(&stream[..]);
            let mut count = 0;
            while let Ok(frame) = reader.read_any_raw_message::<MavMessage>() {
                black_box(&frame);
                count += 1;
            }
            assert_eq!(count, FRAMES);
        });
    });
    group.bench_function("mavlink-core/typed", |b| {
        b.iter(|| {
            let mut reader = MavlinkReader::new(&stream[..]);
            let mut count = 0;
            while let Ok(message) = reader.read_any_message::<MavMessage>() {
                black_box(&message);
                count += 1;
            }
            assert_eq!(count, FRAMES);
        });
    });
    group.finish();
}

fn encoding(c: &mut Criterion) {
    let mut group = c.benchmark_group("encode 40-byte frames");
    group.throughput(Throughput::Elements(1));
    let mut encoder = Encoder::new(1, 1);
    let message = attitude(7);
    group.bench_function("ours", |b| b.iter(|| encoder.encode(black_box(&message))));
    group.finish();
}

criterion_group!(benches, decoding, encoding);
criterion_main!(benches);
