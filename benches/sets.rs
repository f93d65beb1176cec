//! Cost and tightness of set operations. `cargo bench --bench sets`
//!
//! Before the timings it prints how wide a set becomes under each reduction: a 12-dimensional set, turned and
//! measured for 200 steps, as in a zonotopic filter.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use mavobserver::sets::{AxisStrip, Overlap, Reduction, Zonotope};
use nalgebra::{SMatrix, SVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::hint::black_box;
use std::time::Instant;

const N: usize = 12;
const M: usize = 264;
type Z = Zonotope<N, M>;

/// A stable, coupled map: double integrators with cross terms.
fn dynamics() -> SMatrix<f64, N, N> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut a = SMatrix::<f64, N, N>::identity() * 0.995;
    for i in 0..N / 2 {
        a[(i, i + N / 2)] = 0.02;
        a[(i + N / 2, (i + 1) % (N / 2))] = rng.random_range(-0.05..0.05);
    }
    a
}

/// One step: map, disturbance, reduction, measurement of the first half of the states.
fn step(z: &mut Z, next: &mut Z, a: &SMatrix<f64, N, N>, kind: Reduction, order: usize) {
    z.spread();
    z.map_into(a, next);
    std::mem::swap(z, next);
    z.add_box(&SVector::repeat(0.01));
    z.reduce(kind, order, &SVector::repeat(1.0));
    measure(z, next, N / 2);
}

fn measure(z: &mut Z, next: &mut Z, outputs: usize) {
    z.spread();
    let strips: [AxisStrip; N] = std::array::from_fn(|axis| AxisStrip { axis, offset: 0.0, half_width: 0.1 });
    let mut told = [Overlap::default(); N];
    z.intersect_axes_into(&strips[..outputs], &mut told, next);
    std::mem::swap(z, next);
    black_box(told);
}

fn widths() {
    println!("kind, order: mean half-width of measured and unmeasured states after 200 steps, time per step");
    for kind in Reduction::ALL {
        for order in [3, 10, 15, 20] {
            let mut z = Z::point(SVector::zeros());
            z.add_box(&SVector::repeat(0.3));
            let mut next = z.clone();
            let a = dynamics();
            let begin = Instant::now();
            (0..200).for_each(|_| step(&mut z, &mut next, &a, kind, order));
            let each = begin.elapsed().as_secs_f64() / 200.0;
            let mean = |r: std::ops::Range<usize>| r.map(|i| z.radius(i)).sum::<f64>() / 6.0;
            println!("{kind:?}, {order}: {:.4} {:.4} {:.1} µs", mean(0..6), mean(6..12), 1e6 * each);
        }
    }
}

fn reduce_and_update(c: &mut Criterion) {
    widths();
    let a = dynamics();
    let mut grown = Z::point(SVector::zeros());
    grown.add_box(&SVector::repeat(0.3));
    let mut next = grown.clone();
    // columns of a set in use: order 15, then one more step without reduction
    (0..60).for_each(|_| step(&mut grown, &mut next, &a, Reduction::Combastel, 15));
    grown.add_box(&SVector::repeat(0.01));
    let mut group = c.benchmark_group("n = 12, order 15");
    for kind in Reduction::ALL {
        group.bench_function(format!("reduce {kind:?}"), |b| {
            b.iter_batched_ref(|| grown.clone(), |z| z.reduce(kind, 15, &SVector::repeat(1.0)), BatchSize::SmallInput);
        });
    }
    for outputs in [3, 6, 12] {
        group.bench_function(format!("reduce and update, {outputs} outputs"), |b| {
            b.iter_batched_ref(
                || grown.clone(),
                |z| {
                    z.reduce(Reduction::Combastel, 15, &SVector::repeat(1.0));
                    measure(z, &mut next, outputs);
                },
                BatchSize::SmallInput,
            );
        });
    }
    group.bench_function("map", |b| b.iter(|| black_box(&grown).map_into(&a, &mut next)));
    group.finish();
}

criterion_group!(benches, reduce_and_update);
criterion_main!(benches);
