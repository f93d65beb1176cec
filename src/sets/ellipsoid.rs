use super::rounding::{gamma, is_positive, up};
use super::volume::determinant;
use super::{Interval, Overlap, Strip, Zonotope};
use nalgebra::{SMatrix, SVector};

/// The ellipsoid `{c + e : eᵀQ⁻¹e ≤ 1}` in N dimensions, with Q ⪰ 0: one that is flat in some direction is allowed.
///
/// Rounding is put into Q: a computed Q̃ whose entries err by at most E is replaced by Q̃ + ‖E‖∞·I ⪰ Q.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ellipsoid<const N: usize> {
    centre: SVector<f64, N>,
    shape: SMatrix<f64, N, N>,
}

impl<const N: usize> Ellipsoid<N> {
    /// With this centre and shape Q, which must be symmetric and positive semidefinite.
    pub fn new(centre: SVector<f64, N>, shape: SMatrix<f64, N, N>) -> Self {
        Self { centre, shape }
    }

    /// One that holds a zonotope: its m generators, slack included, give Q = m·HHᵀ, since ‖ξ‖² ≤ m.
    pub fn around<const M: usize>(z: &Zonotope<N, M>) -> Self {
        let mut shape = SMatrix::<f64, N, N>::zeros();
        let mut m = 0_usize;
        for g in z.generators() {
            shape += g * g.transpose();
            m += 1;
        }
        for i in 0..N {
            if z.slack()[i] > 0.0 {
                shape[(i, i)] += z.slack()[i].powi(2);
                m += 1;
            }
        }
        Self { centre: *z.centre(), shape: inflated(shape * m as f64, gamma(m + N + 3) * m as f64 * shape.trace()) }
    }

    pub fn centre(&self) -> &SVector<f64, N> {
        &self.centre
    }

    /// Q.
    pub fn shape(&self) -> &SMatrix<f64, N, N> {
        &self.shape
    }

    /// The image `{Lx}`.
    pub fn map<const K: usize>(&self, l: &SMatrix<f64, K, N>) -> Ellipsoid<K> {
        let size = l.abs() * self.shape.abs() * l.abs().transpose();
        let shape = l * self.shape * l.transpose();
        let centre_error = (l.abs() * self.centre.abs()) * (2.0 * gamma(N + 1));
        let shape = (shape + shape.transpose()) * 0.5;
        Ellipsoid { centre: l * self.centre, shape: inflated(shape, 2.0 * gamma(2 * N + 4) * row_norm(&size)) }
            .widened(&centre_error)
    }

    /// The ellipsoid of least trace of Q that holds the Minkowski sum: (1 + 1/β)Q₁ + (1 + β)Q₂ with
    /// β = √(tr Q₁/tr Q₂) (Kurzhanski, Vályi, *Ellipsoidal Calculus for Estimation and Control*, 1997).
    pub fn minkowski_sum(&self, other: &Self) -> Self {
        let centre = self.centre + other.centre;
        let (a, b) = (self.shape.trace(), other.shape.trace());
        let shape = if a > 0.0 && b > 0.0 {
            let beta = (a / b).sqrt();
            self.shape * (1.0 + 1.0 / beta) + other.shape * (1.0 + beta)
        } else {
            self.shape + other.shape
        };
        let rounding = 4.0 * gamma(6) * shape.trace();
        Self { centre, shape: inflated(shape, rounding) }.widened(&(centre.abs() * gamma(2)))
    }

    /// The smallest box that holds the ellipsoid: c ± √Qᵢᵢ.
    pub fn interval_hull(&self) -> [Interval; N] {
        std::array::from_fn(|i| Interval::centred(self.centre[i], up(self.shape[(i, i)].max(0.0).sqrt(), 1)))
    }

    /// At least `max {d·x}`: d·c + √(dᵀQd).
    pub fn support(&self, direction: &SVector<f64, N>) -> f64 {
        let size = (direction.abs().transpose() * self.shape.abs() * direction.abs())[0];
        let square = direction.dot(&(self.shape * direction)) + 2.0 * gamma(2 * N + 2) * size;
        let middle = direction.dot(&self.centre);
        let rounding = 2.0 * gamma(N + 2) * direction.abs().dot(&self.centre.abs());
        middle + up(up(square.max(0.0), 2).sqrt() + rounding + 2.0 * f64::EPSILON * middle.abs(), 4)
    }

    /// eᵀQ⁻¹e of a point, at most 1 inside; `None` where Q is singular. Rounding is not bounded: it grows with the
    /// condition of Q.
    pub fn level(&self, x: &SVector<f64, N>) -> Option<f64> {
        let e = x - self.centre;
        let solved = solve(self.shape, e)?;
        Some(e.dot(&solved))
    }

    /// An ellipsoid that holds the intersection with a strip, the one of least volume in the family of Fogel and Huang
    /// (*On the value of information in system identification*, Automatica 18, 1982). `None` when ellipsoid and
    /// strip are proven to be disjoint.
    pub fn intersect_strip(&self, strip: &Strip<N>) -> Option<Self> {
        let q_n = self.shape * strip.normal;
        let g = strip.normal.dot(&q_n);
        let overlap = self.overlap(strip, g);
        if !overlap.touches() {
            return None;
        }
        let sigma2 = strip.half_width * strip.half_width;
        if !is_positive(g) || !is_positive(sigma2) {
            return Some(*self);
        }
        // λ ≥ 0 weighs the strip; the result is Q − λ'·QnnᵀQ, times a level that the residual lowers
        let after = |lambda: f64| {
            let denominator = sigma2 + lambda * g;
            (1.0 + lambda - lambda * overlap.residual.powi(2) / denominator, lambda / denominator)
        };
        let log_volume = |lambda: f64| {
            let (level, _) = after(lambda);
            N as f64 * level.max(f64::MIN_POSITIVE).ln() + (sigma2 / (sigma2 + lambda * g)).ln()
        };
        let lambda = least(log_volume);
        if log_volume(lambda) >= log_volume(0.0) {
            return Some(*self);
        }
        let (level, share) = after(lambda);
        // a level below zero would prove the sets disjoint; rounding may bring it there
        let level = level.max(0.0) + 8.0 * gamma(N + 8) * (1.0 + lambda);
        let shape = (self.shape - q_n * q_n.transpose() * share) * level;
        let centre = self.centre + q_n * (share * overlap.residual);
        let error = (q_n.abs() * (share * (overlap.residual.abs() + strip.offset.abs())) + self.centre.abs())
            * (4.0 * gamma(2 * N + 8));
        let rounding = 8.0 * gamma(4 * N + 16) * self.shape.trace() * (1.0 + level);
        Some(Self { centre, shape: inflated(shape, rounding) }.widened(&error))
    }

    fn overlap(&self, strip: &Strip<N>, g: f64) -> Overlap {
        let residual = strip.offset - strip.normal.dot(&self.centre);
        let size = strip.normal.abs().dot(&self.centre.abs()) + strip.offset.abs();
        let spread = strip.normal.abs().dot(&(self.shape.abs() * strip.normal.abs()));
        let reach = up(g.max(0.0) + 2.0 * gamma(2 * N + 2) * spread, 3).sqrt();
        Overlap { residual, admissible: up(reach + strip.half_width.abs() + 2.0 * gamma(N + 2) * size, 4) }
    }

    /// Volume: that of the unit ball times √det Q. A figure for comparisons: its rounding is not bounded.
    pub fn volume(&self) -> f64 {
        // V₀ = 1, V₁ = 2, Vₙ = 2π/n·Vₙ₋₂
        let ball = |n: usize| {
            let first = if n.is_multiple_of(2) { 1.0 } else { 2.0 };
            (1..=n).filter(|k| k % 2 == n % 2 && *k > 1).fold(first, |v, k| v * std::f64::consts::TAU / k as f64)
        };
        ball(N) * determinant(self.shape).max(0.0).sqrt()
    }

    /// The Minkowski sum with a tiny box, for errors of the centre.
    fn widened(self, radius: &SVector<f64, N>) -> Self {
        let r2 = radius.norm_squared();
        if r2 == 0.0 {
            return self;
        }
        // (1 + β)Q + (1 + 1/β)r²I holds Q's ellipsoid plus a ball of radius r, for any β
        let beta = (r2 * N as f64 / self.shape.trace().max(f64::MIN_POSITIVE)).sqrt().clamp(f64::EPSILON, 1.0);
        let shape = self.shape * (1.0 + beta);
        let ball = up((1.0 + 1.0 / beta) * r2, 2 * N) + gamma(4) * shape.trace();
        Self { centre: self.centre, shape: inflated(shape, ball) }
    }
}

fn inflated<const N: usize>(mut shape: SMatrix<f64, N, N>, by: f64) -> SMatrix<f64, N, N> {
    for i in 0..N {
        shape[(i, i)] = up(shape[(i, i)] + by, 3);
    }
    shape
}

fn row_norm<const K: usize>(a: &SMatrix<f64, K, K>) -> f64 {
    a.row_iter().map(|r| r.iter().map(|x| x.abs()).sum::<f64>()).fold(0.0, f64::max)
}

/// A λ > 0 at which a function with one valley is near its least, by golden sections of ln λ.
fn least(f: impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_894_9;
    let (mut lo, mut hi) = (-30.0_f64, 30.0_f64);
    for _ in 0..60 {
        let (a, b) = (hi - RATIO * (hi - lo), lo + RATIO * (hi - lo));
        if f(a.exp()) < f(b.exp()) { hi = b } else { lo = a }
    }
    (0.5 * (lo + hi)).exp()
}

/// x with Qx = e, by elimination with partial pivoting.
fn solve<const N: usize>(mut q: SMatrix<f64, N, N>, mut e: SVector<f64, N>) -> Option<SVector<f64, N>> {
    for k in 0..N {
        let row = (k..N).max_by(|a, b| q[(*a, k)].abs().total_cmp(&q[(*b, k)].abs()))?;
        if q[(row, k)] == 0.0 {
            return None;
        }
        q.swap_rows(row, k);
        e.swap_rows(row, k);
        for i in k + 1..N {
            let factor = q[(i, k)] / q[(k, k)];
            for j in k..N {
                q[(i, j)] -= factor * q[(k, j)];
            }
            e[i] -= factor * e[k];
        }
    }
    for k in (0..N).rev() {
        let sum: f64 = (k + 1..N).map(|j| q[(k, j)] * e[j]).sum();
        e[k] = (e[k] - sum) / q[(k, k)];
    }
    Some(e)
}
