//! Points sampled from sets never escape the results of operations on those sets.
//!
//! A million points for each operation in release builds, fifty thousand in debug builds. Membership in the result is
//! decided by the facets of the zonotope, computed here and not by the code under test.

use mavobserver::sets::{AxisStrip, Ellipsoid, Interval, Membership, Overlap, Reduction, Strip, Zonotope};
use nalgebra::{SMatrix, SVector, Vector2, Vector3, vector};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const POINTS: usize = if cfg!(debug_assertions) { 50_000 } else { 1_000_000 };
const SETS: usize = 100;
/// Rounding of this file's own dot products, as a share of their terms.
const OWN_ROUNDING: f64 = 1e-14;

type Z3 = Zonotope<3, 24>;

fn uniform(rng: &mut impl Rng) -> f64 {
    // ends of the range are where points would escape
    match rng.random_range(0..4) {
        0 => -1.0,
        1 => 1.0,
        _ => rng.random_range(-1.0..=1.0),
    }
}

fn some<const N: usize>(rng: &mut impl Rng, size: f64) -> SVector<f64, N> {
    SVector::from_fn(|_, _| rng.random_range(-size..=size))
}

/// Centre far from the origin, generators of very different lengths: where rounding would show.
fn zonotope(rng: &mut impl Rng, generators: usize) -> Z3 {
    let mut z = Z3::point(some(rng, 1e3));
    for _ in 0..generators {
        let length = 10.0_f64.powi(rng.random_range(-4..=1));
        z.push(&some(rng, length));
    }
    z.add_box(&some(rng, 0.1));
    z
}

fn point<const N: usize, const M: usize>(rng: &mut impl Rng, z: &Zonotope<N, M>) -> SVector<f64, N> {
    let slack = SVector::from_fn(|i, _| z.slack()[i] * uniform(rng));
    z.generators().fold(z.centre() + slack, |x, g| x + g * uniform(rng))
}

/// The zonotope between pairs of parallel planes.
struct Facets {
    centre: Vector3<f64>,
    planes: Vec<(Vector3<f64>, f64)>,
}

impl Facets {
    fn of<const M: usize>(z: &Zonotope<3, M>) -> Self {
        let axes = (0..3).map(|i| Vector3::from_fn(|k, _| if k == i { z.slack()[i] } else { 0.0 }));
        let columns: Vec<Vector3<f64>> = z.generators().chain(axes).collect();
        let mut planes = Vec::new();
        for (i, a) in columns.iter().enumerate() {
            for b in &columns[i + 1..] {
                let n = a.cross(b);
                if n.norm() > 1e-12 * a.norm() * b.norm() && n.norm() > 0.0 {
                    let n = n.normalize();
                    planes.push((n, columns.iter().map(|h| n.dot(h).abs()).sum()));
                }
            }
        }
        Self { centre: *z.centre(), planes }
    }

    fn assert_holds(&self, x: &Vector3<f64>, what: &str) {
        let e = x - self.centre;
        let own = OWN_ROUNDING * (x.norm() + self.centre.norm());
        for (n, reach) in &self.planes {
            assert!(n.dot(&e).abs() <= reach * (1.0 + OWN_ROUNDING) + own, "{what}: {x} escapes by {}", n.dot(&e));
        }
    }
}

/// Calls `each` for [`SETS`] random sets, with the number of points to sample of each.
fn sets(seed: u64, mut each: impl FnMut(&mut ChaCha8Rng, usize)) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..SETS).for_each(|_| each(&mut rng, POINTS / SETS));
}

#[test]
fn linear_maps_keep_every_point() {
    sets(1, |rng, n| {
        let z = zonotope(rng, 8);
        let l = SMatrix::<f64, 3, 3>::from_fn(|_, _| rng.random_range(-2.0..2.0));
        let image = Facets::of(&z.map(&l));
        (0..n).for_each(|_| image.assert_holds(&(l * point(rng, &z)), "map"));
    });
}

#[test]
fn sums_keep_every_point() {
    sets(2, |rng, n| {
        let (a, b) = (zonotope(rng, 6), zonotope(rng, 6));
        let mut both = a.clone();
        both.minkowski_sum(&b);
        let facets = Facets::of(&both);
        (0..n).for_each(|_| facets.assert_holds(&(point(rng, &a) + point(rng, &b)), "sum"));
    });
}

#[test]
fn a_full_set_grows_instead_of_failing() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut small = Zonotope::<3, 4>::point(Vector3::zeros());
    let all: Vec<Vector3<f64>> = (0..9).map(|_| some(&mut rng, 1.0)).collect();
    all.iter().for_each(|g| small.push(g));
    assert_eq!(small.len(), 4);
    let facets = Facets::of(&small);
    for _ in 0..POINTS {
        let x = all.iter().fold(Vector3::zeros(), |x, g| x + g * uniform(&mut rng));
        facets.assert_holds(&x, "full");
    }
}

#[test]
fn every_reduction_keeps_every_point() {
    for kind in Reduction::ALL {
        sets(4, |rng, n| {
            let z = zonotope(rng, 20);
            let mut reduced = z.clone();
            reduced.reduce(kind, rng.random_range(1..=3), &vector![1.0, 2.0, 0.5]);
            assert!(reduced.len() <= 9, "{kind:?} left {}", reduced.len());
            let facets = Facets::of(&reduced);
            (0..n).for_each(|_| facets.assert_holds(&point(rng, &z), &format!("{kind:?}")));
        });
    }
}

#[test]
fn strips_lose_no_point_that_lies_in_both() {
    sets(5, |rng, n| {
        let z = zonotope(rng, 8);
        let normal: Vector3<f64> = some(rng, 1.0);
        let inside = point(rng, &z);
        let strip = Strip { normal, offset: normal.dot(&inside) + rng.random_range(-0.05..0.05), half_width: 0.1 };
        let mut cut = z.clone();
        let overlap = cut.intersect_strip(&strip).expect("they share a point");
        assert!(overlap.touches() && overlap.ratio() <= 1.0);
        assert!(cut.frobenius_radius() <= z.frobenius_radius() * (1.0 + 1e-9));
        let facets = Facets::of(&cut);
        // most points miss the strip: these are drawn near it
        for _ in 0..n {
            let x = inside + (point(rng, &z) - inside) * rng.random_range(0.0..0.2);
            if (normal.dot(&x) - strip.offset).abs() <= strip.half_width {
                facets.assert_holds(&x, "strip");
            }
        }
    });
}

#[test]
fn strips_across_axes_at_once_give_what_they_give_one_after_another() {
    sets(6, |rng, n| {
        let mut z = zonotope(rng, 8);
        z.spread();
        let inside = point(rng, &z);
        let strips = [1, 0].map(|axis| AxisStrip { axis, offset: inside[axis], half_width: 0.2 });
        let mut one = z.clone();
        for s in &strips {
            let normal = Vector3::from_fn(|i, _| f64::from(i == s.axis));
            one.intersect_strip(&Strip { normal, offset: s.offset, half_width: s.half_width }).expect("a shared point");
        }
        let mut other = Z3::point(Vector3::zeros());
        let mut told = [Overlap::default(); 2];
        z.intersect_axes_into(&strips, &mut told, &mut other);
        assert!(told.iter().all(|t| t.touches()));
        for i in 0..3 {
            assert!((one.radius(i) - other.radius(i)).abs() < 1e-7 * one.radius(i));
            assert!((one.centre()[i] - other.centre()[i]).abs() < 1e-7);
        }
        let facets = Facets::of(&other);
        for _ in 0..n {
            let x = inside + (point(rng, &z) - inside) * rng.random_range(0.0..0.2);
            if strips.iter().all(|s| (x[s.axis] - s.offset).abs() <= s.half_width) {
                facets.assert_holds(&x, "axis strips");
            }
        }
        // one that misses is left out, and the other still counts
        let mut far = strips;
        far[0].offset = z.centre()[1] + z.radius(1) + 0.3;
        z.intersect_axes_into(&far, &mut told, &mut other);
        assert!(!told[0].touches() && told[1].touches());
        let alone = Facets::of(&other);
        alone.assert_holds(&inside, "the strip that agrees");
    });
}

#[test]
fn a_strip_that_misses_the_set_is_told_and_one_that_touches_is_not() {
    sets(7, |rng, _| {
        let z = zonotope(rng, 8);
        let normal: Vector3<f64> = some(rng, 1.0);
        let end = z.support(&normal);
        let size = end.abs().max(1.0);
        for (gap, expected) in [(1e-9, false), (-1e-9, true)] {
            let strip = Strip { normal, offset: end + 0.1 + gap * size, half_width: 0.1 };
            assert_eq!(z.clone().intersect_strip(&strip).is_some(), expected, "gap {gap}");
        }
    });
}

#[test]
fn hulls_and_supports_hold_every_point() {
    sets(8, |rng, n| {
        let z = zonotope(rng, 8);
        let (hull, d) = (z.interval_hull(), some(rng, 1.0));
        let support = z.support(&d);
        for _ in 0..n {
            let x = point(rng, &z);
            let own = OWN_ROUNDING * 2e3;
            assert!((0..3).all(|i| hull[i].lo() - own <= x[i] && x[i] <= hull[i].hi() + own));
            assert!(d.dot(&x) <= support + own);
        }
    });
}

#[test]
fn membership_agrees_with_the_facets() {
    let (mut inside, mut outside, mut undecided) = (0, 0, 0);
    sets(9, |rng, n| {
        let z = zonotope(rng, 6);
        let facets = Facets::of(&z);
        for _ in 0..n / 100 {
            let away = if rng.random_bool(0.5) { 1.0 } else { rng.random_range(1.0..2.0) };
            let x = z.centre() + (point(rng, &z) - z.centre()) * away;
            let e = x - z.centre();
            let excess = facets.planes.iter().map(|(n, r)| (n.dot(&e).abs() - r) / r).fold(f64::NEG_INFINITY, f64::max);
            match z.membership(&x, 1e-9) {
                Membership::Inside => {
                    inside += 1;
                    assert!(excess < 1e-6);
                }
                Membership::Outside => {
                    outside += 1;
                    assert!(excess > -1e-9);
                }
                Membership::Undecided => undecided += 1,
            }
        }
    });
    assert!(inside > 4 * undecided && outside > 4 * undecided, "{inside} in, {outside} out, {undecided} undecided");
}

#[test]
fn volumes() {
    let cube = Zonotope::<3, 8>::from_box(&[Interval::new(-1.0, 1.0); 3]);
    assert!((cube.volume().unwrap() - 8.0).abs() < 1e-9);
    let hexagon = Zonotope::<2, 8>::new(
        Vector2::zeros(),
        &SMatrix::<f64, 2, 3>::from_columns(&[vector![1.0, 0.0], vector![0.0, 1.0], vector![1.0, 1.0]]),
    );
    // 4·(|1·1| + |1·1 − 0·1| + |0·1 − 1·1|)
    assert_eq!(hexagon.volume().unwrap(), 12.0);
    assert_eq!(Zonotope::<3, 8>::point(Vector3::zeros()).volume(), Some(0.0));
    let ball = Ellipsoid::new(Vector3::zeros(), SMatrix::<f64, 3, 3>::identity() * 4.0);
    assert!((ball.volume() - 4.0 / 3.0 * std::f64::consts::PI * 8.0).abs() < 1e-12);
}

fn ellipsoid(rng: &mut impl Rng) -> (Ellipsoid<3>, SMatrix<f64, 3, 3>) {
    let l = SMatrix::<f64, 3, 3>::from_fn(|_, _| rng.random_range(-1.0..1.0));
    (Ellipsoid::new(some(rng, 10.0), l * l.transpose()), l)
}

fn on(rng: &mut impl Rng, e: &Ellipsoid<3>, l: &SMatrix<f64, 3, 3>) -> Vector3<f64> {
    let direction: Vector3<f64> = some(rng, 1.0);
    let radius: f64 = if rng.random_bool(0.5) { 1.0 } else { rng.random_range(0.0..1.0) };
    e.centre() + l * direction.normalize() * radius
}

#[test]
fn ellipsoids_keep_every_point() {
    let holds = |e: &Ellipsoid<3>, x: &Vector3<f64>, what: &str| {
        let level = e.level(x).expect("a shape of full rank");
        assert!(level <= 1.0 + 1e-6, "{what}: level {level}");
    };
    sets(10, |rng, n| {
        let ((a, la), (b, lb)) = (ellipsoid(rng), ellipsoid(rng));
        let m = SMatrix::<f64, 3, 3>::from_fn(|_, _| rng.random_range(-2.0..2.0));
        let (image, sum, hull) = (a.map(&m), a.minkowski_sum(&b), a.interval_hull());
        let d: Vector3<f64> = some(rng, 1.0);
        let middle = on(rng, &a, &la);
        let strip = Strip { normal: d, offset: d.dot(&middle), half_width: 0.1 };
        let cut = a.intersect_strip(&strip).expect("they share a point");
        assert!(cut.volume() <= a.volume() * (1.0 + 1e-6));
        let mut far = strip;
        far.offset = a.support(&d) + 0.11;
        assert!(a.intersect_strip(&far).is_none());
        for _ in 0..n {
            let (x, y) = (on(rng, &a, &la), on(rng, &b, &lb));
            holds(&image, &(m * x), "map");
            holds(&sum, &(x + y), "sum");
            assert!((0..3).all(|i| hull[i].contains(x[i])) && d.dot(&x) <= a.support(&d));
            if (d.dot(&x) - strip.offset).abs() <= strip.half_width {
                holds(&cut, &x, "strip");
            }
        }
    });
}

#[test]
fn an_ellipsoid_around_a_zonotope_holds_it() {
    sets(11, |rng, n| {
        let z = zonotope(rng, 5);
        let e = Ellipsoid::around(&z);
        for _ in 0..n {
            let x = point(rng, &z);
            assert!(e.level(&x).expect("a shape of full rank") <= 1.0 + 1e-9);
        }
    });
}

#[test]
fn what_is_not_finite_claims_nothing() {
    let mut z = Z3::point(Vector3::new(f64::NAN, 0.0, 0.0));
    z.push(&vector![1.0, f64::INFINITY, 0.0]);
    z.add_box(&vector![0.0, 0.0, f64::NAN]);
    assert!(z.interval_hull().iter().all(|i| *i == Interval::ENTIRE));
}
