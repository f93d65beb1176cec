//! How long designs take: `cargo bench --bench design`.

use criterion::{Criterion, criterion_group, criterion_main};
use mavobserver::observers::fuzzy_polynomial::{Method, Options, Plant, design, front, paper as table};
use mavobserver::observers::quadratic_bounded::{
    Cache, NoiseBlock, SampledPlant, choose_rates, design_continuous, design_sampled, paper, step_nodes,
};
use nalgebra::{DMatrix, dmatrix};
use std::hint::black_box;

/// One axis of the online observer.
fn axis() -> SampledPlant {
    SampledPlant {
        a: dmatrix![0.0, 1.0; 0.0, 0.0],
        process: vec![NoiseBlock::scalar(2, 0, 0.5), NoiseBlock::scalar(2, 1, 10.0)],
        c: DMatrix::identity(2, 2),
        output: vec![NoiseBlock::scalar(2, 0, 0.3), NoiseBlock::scalar(2, 1, 1.5)],
        e1: dmatrix![0.0, 1.0],
    }
}

fn designs(c: &mut Criterion) {
    let mut group = c.benchmark_group("design");
    group.sample_size(10);
    let plant = paper::hummingbird(paper::PAPER_ORDER);
    group.bench_function("paper's plant, 24 states", |b| b.iter(|| design_continuous(black_box(&plant), 2.0)));
    group.bench_function("trade-off over the rate, 24 states", |b| {
        b.iter(|| choose_rates(black_box(&plant), 20.0, &[0.95]));
    });
    let nodes = step_nodes(0.004, 0.1, 8);
    group.bench_function("one axis, sampled, 8 nodes", |b| b.iter(|| design_sampled(black_box(&axis()), 4.0, &nodes)));
    let directory = std::env::temp_dir().join(format!("mavobserver-bench-{}", std::process::id()));
    let cache = Cache::Directory(directory.clone());
    group.bench_function("one axis from the cache, proven anew", |b| {
        b.iter(|| cache.sampled(black_box(&axis()), 4.0, &nodes));
    });
    let rig = Plant::quanser();
    for method in [Method::LinearDesign, Method::EightGains, Method::OneGain, Method::SumsOfSquares] {
        let name = format!("fuzzy-polynomial, {} at 18", method.name());
        group.bench_function(name, |b| b.iter(|| design(black_box(&rig), method, 18.0, Options::default())));
    }
    group.bench_function("fuzzy-polynomial, the table's 36 designs on all cores", |b| {
        b.iter(|| front(black_box(&rig), &Method::ALL, &table::ALPHAS, Options::default(), |_, _| ()));
    });
    group.bench_function("fuzzy-polynomial, SOS-2G from the cache, proven anew", |b| {
        b.iter(|| cache.sums_of_squares(black_box(&rig), 18.0, Options::default()));
    });
    group.finish();
    // best effort: the system clears it otherwise
    let _ = std::fs::remove_dir_all(directory);
}

criterion_group!(benches, designs);
criterion_main!(benches);
