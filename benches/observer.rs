//! Cost of the observers and of the offline chain. `cargo bench --bench observer`

#[path = "../tests/hover/mod.rs"]
mod hover;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mavobserver::observers::{Options, REGISTRY, build};
use mavobserver::pipeline::{Event, Fleet, FleetSettings};
use mavobserver::signal::Measurement;
use mavobserver::vehicle;
use std::hint::black_box;
use std::sync::Arc;

fn measurements() -> Vec<Measurement> {
    let model = Arc::new(vehicle::resolve("arducopter-sitl").expect("a preset"));
    let mut fleet = Fleet::new(FleetSettings::standard(model)).expect("designs");
    let mut out = Vec::new();
    for (received, frame) in hover::frames(500) {
        fleet.frame(frame.as_ref(), received, &mut |event| {
            if let Event::Snapshot(_, m) = event {
                out.push(*m);
            }
        });
    }
    out
}

/// Each observer by itself, and all of them on every measurement.
fn step(c: &mut Criterion) {
    let model = vehicle::resolve("arducopter-sitl").expect("a preset");
    let measurements = measurements();
    let mut group = c.benchmark_group("step");
    group.throughput(Throughput::Elements(measurements.len() as u64));
    let mut all = Vec::new();
    for registration in REGISTRY {
        // one that this vehicle's file has not enough for is left out
        let Ok(mut observer) = build(registration.name, &model, Options::default()) else { continue };
        all.push(observer.fresh());
        group.bench_function(registration.name, |b| {
            b.iter(|| {
                observer.reset();
                for m in &measurements {
                    black_box(observer.step(black_box(m)).is_ok());
                }
            });
        });
    }
    group.bench_function("all together", |b| {
        b.iter(|| {
            all.iter_mut().for_each(|observer| observer.reset());
            for m in &measurements {
                for observer in &mut all {
                    black_box(observer.step(black_box(m)).is_ok());
                }
            }
        });
    });
    group.finish();
}

fn chain(c: &mut Criterion) {
    let model = Arc::new(vehicle::resolve("arducopter-sitl").expect("a preset"));
    let frames = hover::frames(500);
    let mut group = c.benchmark_group("chain");
    group.throughput(Throughput::Elements(frames.len() as u64));
    group.bench_function("frames to snapshots", |b| {
        let mut fleet = Fleet::new(FleetSettings::standard(Arc::clone(&model))).expect("designs");
        b.iter(|| {
            let mut n = 0;
            for (received, frame) in &frames {
                fleet.frame(frame.as_ref(), *received, &mut |_| n += 1);
            }
            n
        });
    });
    group.finish();
}

criterion_group!(benches, step, chain);
criterion_main!(benches);
