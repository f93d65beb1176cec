use super::Interval;
use super::rounding::{gamma, sum_abs, up};
use nalgebra::{SMatrix, SVector};

/// A zonotope in N dimensions with room for M generators: `{c + Hξ + s : |ξⱼ| ≤ 1, |sᵢ| ≤ slackᵢ}`.
///
/// Beside its generators H it carries a box, the *slack*. There the reductions put what they fold together, there
/// every operation puts the bound on its own rounding, and there goes what does not fit among the generators. So no
/// operation can fail or allocate: when M is exhausted the set becomes larger, never wrong.
///
/// A set that holds a number that is not finite has an infinite hull in that direction.
#[derive(Debug, Clone, PartialEq)]
pub struct Zonotope<const N: usize, const M: usize> {
    pub(super) centre: SVector<f64, N>,
    /// H by rows, so that maps and sums run along memory; the first `len` entries of each are in use.
    pub(super) rows: [[f64; M]; N],
    pub(super) len: usize,
    pub(super) slack: SVector<f64, N>,
}

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// The set of one point.
    pub fn point(centre: SVector<f64, N>) -> Self {
        Self { centre, rows: [[0.0; M]; N], len: 0, slack: SVector::zeros() }
    }

    /// `centre + Hξ`, with the columns of H as generators.
    pub fn new<const K: usize>(centre: SVector<f64, N>, generators: &SMatrix<f64, N, K>) -> Self {
        let mut z = Self::point(centre);
        for g in generators.column_iter() {
            z.push(&g.into_owned());
        }
        z
    }

    /// A box, one interval for each dimension.
    pub fn from_box(sides: &[Interval; N]) -> Self {
        let mut z = Self::point(SVector::from_fn(|i, _| sides[i].mid()));
        z.slack = SVector::from_fn(|i, _| sides[i].radius());
        z
    }

    /// Becomes a box.
    pub fn set_box(&mut self, sides: &[Interval; N]) {
        self.centre = SVector::from_fn(|i, _| sides[i].mid());
        self.slack = SVector::from_fn(|i, _| sides[i].radius());
        self.len = 0;
    }

    pub fn centre(&self) -> &SVector<f64, N> {
        &self.centre
    }

    /// Number of generators, without the slack.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True when the set has no generators; its slack may still be large.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub fn generators(&self) -> impl Iterator<Item = SVector<f64, N>> + '_ {
        (0..self.len).map(|j| SVector::from_fn(|i, _| self.rows[i][j]))
    }

    /// Half-widths of the box that is added to the generators.
    pub fn slack(&self) -> &SVector<f64, N> {
        &self.slack
    }

    /// Adds one generator.
    pub fn push(&mut self, generator: &SVector<f64, N>) {
        if self.len == M {
            self.add_box(&generator.abs());
            return;
        }
        for (row, g) in self.rows.iter_mut().zip(generator.iter()) {
            row[self.len] = *g;
        }
        self.len += 1;
    }

    /// Minkowski sum with the box `|sᵢ| ≤ radiusᵢ`.
    pub fn add_box(&mut self, radius: &SVector<f64, N>) {
        for (s, r) in self.slack.iter_mut().zip(radius.iter()) {
            *s = up(*s + r.abs(), 1);
        }
    }

    /// The set moved by a vector.
    pub fn translate(&mut self, by: &SVector<f64, N>) {
        for i in 0..N {
            let moved = self.centre[i] + by[i];
            self.slack[i] = up(self.slack[i] + moved.abs() * gamma(1), 2);
            self.centre[i] = moved;
        }
    }

    /// Minkowski sum, `{a + b}`: the generators of both, and the sum of centres and slacks.
    pub fn minkowski_sum<const K: usize>(&mut self, other: &Zonotope<N, K>) {
        self.translate(&other.centre);
        self.add_box(&other.slack);
        for g in other.generators() {
            self.push(&g);
        }
    }

    /// Turns the slack into generators along the axes, as far as there is room. The set stays the same; a map then
    /// keeps the box exactly instead of bounding it again.
    pub fn spread(&mut self) {
        for i in 0..N {
            if self.slack[i] > 0.0 && self.len < M {
                self.rows.iter_mut().for_each(|row| row[self.len] = 0.0);
                self.rows[i][self.len] = self.slack[i];
                self.slack[i] = 0.0;
                self.len += 1;
            }
        }
    }

    /// Σⱼ|Hᵢⱼ| for each row, rounded up: the half-widths of the hull without the slack.
    pub fn row_sums(&self) -> SVector<f64, N> {
        SVector::from_fn(|i, _| up(sum_abs(&self.rows[i][..self.len]), self.len))
    }

    /// Half-width of the interval hull along axis i, rounded up.
    pub fn radius(&self, i: usize) -> f64 {
        up(sum_abs(&self.rows[i][..self.len]) + self.slack[i], self.len + 1)
    }

    /// The smallest box that holds the set (the paper's □, rs(H)).
    pub fn interval_hull(&self) -> [Interval; N] {
        std::array::from_fn(|i| {
            let r = self.radius(i);
            if r.is_finite() { Interval::centred(self.centre[i], r) } else { Interval::ENTIRE }
        })
    }

    /// At least `max {d·x}` over the set, and at most that plus the rounding.
    pub fn support(&self, direction: &SVector<f64, N>) -> f64 {
        let middle = direction.dot(&self.centre);
        let size: f64 = direction.iter().zip(self.centre.iter()).map(|(d, c)| (d * c).abs()).sum();
        middle + up(self.reach(direction) + 2.0 * gamma(N + 2) * (size + middle.abs()), 3)
    }

    /// At least `max {d·(x − c)}` over the set.
    pub(super) fn reach(&self, direction: &SVector<f64, N>) -> f64 {
        let mut along = 0.0;
        let mut size = 0.0;
        for j in 0..self.len {
            let mut dot = 0.0;
            for (row, d) in self.rows.iter().zip(direction.iter()) {
                dot += d * row[j];
                size += (d * row[j]).abs();
            }
            along += dot.abs();
        }
        let slack: f64 = direction.iter().zip(self.slack.iter()).map(|(d, s)| d.abs() * s).sum();
        up(along + slack + gamma(N) * up(size, N * M), self.len + N + 2)
    }

    /// Frobenius norm of H with the slack as generators: the size that the optimal gain makes least.
    pub fn frobenius_radius(&self) -> f64 {
        let generators: f64 = self.rows.iter().flat_map(|row| &row[..self.len]).map(|h| h * h).sum();
        (generators + self.slack.norm_squared()).sqrt()
    }
}
