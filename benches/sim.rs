//! What a simulated second costs: the physics alone, one vehicle with everything, and a hundred of them.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use mavobserver::sim::control::Leg;
use mavobserver::sim::scenario;
use mavobserver::sim::{FlightPlan, Run, RunOptions, SimVehicle};
use mavobserver::vehicle::resolve;
use std::hint::black_box;
use std::time::Duration;

fn advance(run: &mut Run, seconds: f64) -> u64 {
    let (mut bytes, end) = (0, run.now_s() + seconds);
    while run.now_s() < end {
        run.advance(&mut |received| bytes += received.bytes.len() as u64);
    }
    bytes
}

/// In the air, with sensors, turbulence and streams; the mission hovers for ever.
fn airborne(name: &str, vehicles: u8) -> Run {
    let mut scenario = scenario::resolve(name).expect("bundled");
    scenario.vehicles = vehicles;
    scenario.duration_s = f64::INFINITY;
    let mut run = Run::new(&scenario, &RunOptions::default()).expect("valid");
    advance(&mut run, 15.0);
    run
}

fn flights(c: &mut Criterion) {
    let mut group = c.benchmark_group("one simulated second");
    group.throughput(Throughput::Elements(1)).measurement_time(Duration::from_secs(3)).sample_size(20);
    group.bench_function("vehicle without messages", |b| {
        let vehicle = resolve("arducopter-sitl").expect("preset");
        let mission = vec![Leg::Takeoff { height_m: 20.0 }, Leg::Hover { seconds: f64::INFINITY }];
        let mut v = SimVehicle::new(&FlightPlan { mission, ..FlightPlan::calm(vehicle, 1) }).expect("valid");
        b.iter(|| {
            for _ in 0..400 {
                black_box(v.advance());
            }
        });
    });
    for (label, name) in [("ArduPilot-like, 300 messages", "turbulence"), ("PX4-like, 680 messages", "px4-wind")] {
        let mut run = airborne(name, 1);
        group.bench_function(label, |b| b.iter(|| black_box(advance(&mut run, 1.0))));
    }
    group.finish();

    let mut group = c.benchmark_group("a hundred vehicles");
    group.measurement_time(Duration::from_secs(5)).sample_size(10);
    let mut run = airborne("turbulence", 100);
    group.bench_function("one simulated second", |b| b.iter(|| black_box(advance(&mut run, 1.0))));
    group.finish();
}

criterion_group!(benches, flights);
criterion_main!(benches);
