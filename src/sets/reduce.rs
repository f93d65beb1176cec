use super::Zonotope;
use super::rounding::{gamma, up};
use nalgebra::{SMatrix, SVector};
use std::cmp::Ordering;

/// How a zonotope with many generators is enclosed by one with few.
///
/// Every kind keeps the largest generators and encloses the sum of the others; they differ in what is "large" and in
/// the shape of the enclosure. `benches/sets.rs` compares them in width and time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reduction {
    /// Girard, *Reachability of uncertain linear systems using zonotopes* (HSCC 2005): those with the smallest
    /// ‖h‖₁ − ‖h‖∞ go into a box. The cheapest, and good where generators lie along the axes.
    Girard,
    /// Combastel, *A state bounding observer based on zonotopes* (ECC 2003): those with the smallest ‖h‖₂ go into a
    /// box. The operator ↓q of Wang and Puig.
    Combastel,
    /// As Combastel, but the box lies along the principal axes of what it encloses (Stursberg, Krogh, *Efficient
    /// representation and computation of reachable sets for hybrid systems*, HSCC 2003; named PCA by Kopetzki,
    /// Schürmann, Althoff, CDC 2017). Better for long, thin, oblique sets.
    Pca,
    /// Scott, Raimondo, Marseglia, Braatz, *Constrained zonotopes* (Automatica 69, 2016), §4: a parallelotope of N
    /// pivotal generators grows by one generator after another, the one that adds the least volume first. The
    /// tightest in few dimensions, and the most expensive.
    Scott,
}

impl Reduction {
    pub const ALL: [Self; 4] = [Self::Girard, Self::Combastel, Self::Pca, Self::Scott];
}

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// Encloses the set by one with at most `order·N` columns, the box of slack counted as N of them. `weights`
    /// (one for each dimension, such as 1/typical size) make lengths comparable where units differ.
    pub fn reduce(&mut self, kind: Reduction, order: usize, weights: &SVector<f64, N>) {
        let keep = order.max(1).saturating_sub(1) * N;
        match kind {
            Reduction::Girard | Reduction::Combastel => self.fold(kind, keep, weights),
            Reduction::Pca => {
                self.spread();
                self.fold_along_principal_axes(keep, weights);
            }
            Reduction::Scott => {
                self.spread();
                if !self.grow_parallelotope(keep + N, weights) {
                    self.fold(Reduction::Girard, keep, weights);
                }
            }
        }
    }

    /// The columns, the `keep` largest in front; otherwise in no order.
    fn largest_first(&self, kind: Reduction, keep: usize, weights: &SVector<f64, N>) -> [usize; M] {
        let mut size = [0.0; M];
        let used = &mut size[..self.len];
        if kind == Reduction::Girard {
            let mut largest = [0.0_f64; M];
            for (row, w) in self.rows.iter().zip(weights.iter()) {
                for ((s, m), h) in used.iter_mut().zip(&mut largest).zip(row) {
                    let x = (w * h).abs();
                    *s += x;
                    *m = m.max(x);
                }
            }
            used.iter_mut().zip(&largest).for_each(|(s, m)| *s -= m);
        } else {
            for (row, w) in self.rows.iter().zip(weights.iter()) {
                for (s, h) in used.iter_mut().zip(row) {
                    *s += (w * h) * (w * h);
                }
            }
        }
        let mut order = std::array::from_fn(|j| j);
        if keep == 0 || keep >= self.len {
            return order;
        }
        // the smallest size that is kept; sizes alone are selected from, as an order by places costs twice as much
        let mut sizes = size;
        let (_, &mut least, _) = sizes[..self.len].select_nth_unstable_by(keep - 1, |a, b| b.total_cmp(a));
        let larger = size[..self.len].iter().filter(|s| s.total_cmp(&least).is_gt()).count();
        let mut equals = keep - larger;
        let (mut front, mut back) = (0, keep);
        for (j, s) in size[..self.len].iter().enumerate() {
            let stays = match s.total_cmp(&least) {
                Ordering::Greater => true,
                Ordering::Less => false,
                Ordering::Equal => {
                    let room = equals > 0;
                    equals = equals.saturating_sub(1);
                    room
                }
            };
            let place = if stays { &mut front } else { &mut back };
            order[*place] = j;
            *place += 1;
        }
        order
    }

    fn fold(&mut self, kind: Reduction, keep: usize, weights: &SVector<f64, N>) {
        if self.len <= keep {
            return;
        }
        let order = self.largest_first(kind, keep, weights);
        for (row, slack) in self.rows.iter_mut().zip(self.slack.iter_mut()) {
            let folded: f64 = order[keep..self.len].iter().map(|&j| row[j].abs()).sum();
            *slack = up(*slack + folded, M);
        }
        self.retain(&order[..keep]);
    }

    /// Keeps these columns, in any order, and forgets the others.
    fn retain(&mut self, columns: &[usize]) {
        let keep = columns.len();
        let mut stays = [false; M];
        columns.iter().for_each(|&j| stays[j] = true);
        // what is kept of the columns behind fills the gaps in front
        let mut gap = 0;
        for &from in columns.iter().filter(|j| **j >= keep) {
            while stays[gap] {
                gap += 1;
            }
            self.rows.iter_mut().for_each(|row| row[gap] = row[from]);
            gap += 1;
        }
        self.len = keep;
    }

    fn fold_along_principal_axes(&mut self, keep: usize, weights: &SVector<f64, N>) {
        if self.len <= keep + N {
            return;
        }
        let order = self.largest_first(Reduction::Combastel, keep, weights);
        let folded = &order[keep..self.len];
        let column = |j: usize| SVector::<f64, N>::from_fn(|i, _| self.rows[i][j]);
        let mut covariance = SMatrix::<f64, N, N>::zeros();
        for &j in folded {
            let g = column(j).component_mul(weights);
            covariance += g * g.transpose();
        }
        // axes in weighted coordinates, taken back; `back`·`forth` is the identity up to rounding
        let axes = principal_axes(covariance);
        let back = SMatrix::<f64, N, N>::from_fn(|i, k| axes[(i, k)] / weights[i]);
        let forth = SMatrix::<f64, N, N>::from_fn(|k, i| axes[(i, k)] * weights[i]);
        let mut half = SVector::<f64, N>::zeros();
        let mut missed = SVector::<f64, N>::zeros();
        for &j in folded {
            let g = column(j);
            let along = forth * g;
            half += along.abs();
            missed += beyond(&g, &back, &along);
        }
        let half = half.map(|h| up(h, M));
        self.retain(&order[..keep]);
        for k in 0..N {
            self.push(&(back.column(k) * half[k]));
        }
        // the product of a column with its half-width is rounded too
        let rounding = (back.abs() * half) * (2.0 * gamma(N + 1));
        self.add_box(&(missed.map(|m| up(m, M + 2 * N)) + rounding));
    }

    /// Scott's reduction to `columns` generators. False, and nothing done, when the generators do not span the space.
    fn grow_parallelotope(&mut self, columns: usize, weights: &SVector<f64, N>) -> bool {
        if self.len <= columns {
            return true;
        }
        let Some((order, mut shares)) = self.in_pivotal_coordinates(weights) else { return false };
        // `order[..N]` is the parallelotope T, `shares` holds T⁻¹g of the others
        let pivots = SMatrix::<f64, N, N>::from_fn(|i, k| self.rows[i][order[k]]);
        let mut base = pivots;
        let mut scale = SVector::<f64, N>::repeat(1.0);
        let mut missed = SVector::<f64, N>::zeros();
        let mut dropped = [false; M];
        for _ in columns..self.len {
            let volume = |j: &usize| {
                let r = shares.iter().map(|row: &[f64; M]| row[*j].abs());
                r.clone().map(|x| 1.0 + x).product::<f64>() - 1.0 - r.sum::<f64>()
            };
            let rest = (N..self.len).filter(|j| !dropped[*j]);
            let Some(j) = rest.min_by(|a, b| volume(a).total_cmp(&volume(b))) else { break };
            dropped[j] = true;
            let r = SVector::<f64, N>::from_fn(|k, _| shares[k][j]);
            let g = SVector::<f64, N>::from_fn(|i, _| self.rows[i][order[j]]);
            missed += beyond(&g, &base, &r);
            for k in 0..N {
                let grown = 1.0 + r[k].abs();
                scale[k] = up(scale[k] * grown, 2);
                for x in &mut shares[k][N..self.len] {
                    *x /= grown;
                }
            }
            base = SMatrix::from_fn(|i, k| pivots[(i, k)] * scale[k]);
        }
        let mut kept = [0; M];
        let mut n = 0;
        for j in (N..self.len).filter(|j| !dropped[*j]) {
            kept[n] = order[j];
            n += 1;
        }
        self.retain(&kept[..n]);
        for k in 0..N {
            self.push(&base.column(k).into_owned());
        }
        // base is pivots·scale, rounded once in each of at most M products
        let rounding = base.abs() * SVector::<f64, N>::repeat(gamma(4 * M));
        self.add_box(&(missed.map(|m| up(m, M + 2 * N)) + rounding));
        true
    }

    /// N pivotal columns by Gauss-Jordan elimination with full pivoting, then the others; and the coordinates of all
    /// columns, in that order, in the basis of the pivotal ones.
    fn in_pivotal_coordinates(&self, weights: &SVector<f64, N>) -> Option<([usize; M], [[f64; M]; N])> {
        let mut order: [usize; M] = std::array::from_fn(|j| j);
        let mut a = self.rows;
        for (row, w) in a.iter_mut().zip(weights.iter()) {
            row[..self.len].iter_mut().for_each(|x| *x *= w);
        }
        let mut largest: f64 = 0.0;
        for k in 0..N {
            let places = (k..N).flat_map(|i| (k..self.len).map(move |j| (i, j)));
            let (i, j) = places.max_by(|p, q| a[p.0][p.1].abs().total_cmp(&a[q.0][q.1].abs()))?;
            let pivot = a[i][j];
            largest = largest.max(pivot.abs());
            if pivot.is_nan() || pivot.abs() <= 1e-12 * largest {
                return None;
            }
            a.swap(k, i);
            a.iter_mut().for_each(|row| row.swap(k, j));
            order.swap(k, j);
            a[k][..self.len].iter_mut().for_each(|x| *x /= pivot);
            let line = a[k];
            for (_, row) in a.iter_mut().enumerate().filter(|(i, _)| *i != k) {
                let factor = row[k];
                for (x, l) in row[..self.len].iter_mut().zip(&line) {
                    *x -= factor * l;
                }
            }
        }
        Some((order, a))
    }
}

/// At least |g − B·r| for each row: what a generator has beyond its expression in a basis.
fn beyond<const N: usize>(g: &SVector<f64, N>, b: &SMatrix<f64, N, N>, r: &SVector<f64, N>) -> SVector<f64, N> {
    let size = b.abs() * r.abs() + g.abs();
    (g - b * r).abs() + size * (2.0 * gamma(N + 2))
}

/// Orthonormal eigenvectors, as columns, by cyclic Jacobi rotations.
fn principal_axes<const N: usize>(mut a: SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let mut v = SMatrix::<f64, N, N>::identity();
    // converges quadratically; ten sweeps are far more than matrices of this size need, and exactness is not needed
    for _ in 0..10 {
        for p in 0..N {
            for q in p + 1..N {
                if a[(p, q)].abs() <= 1e-15 * (a[(p, p)] * a[(q, q)]).abs().sqrt() {
                    continue;
                }
                let t = {
                    let x = (a[(q, q)] - a[(p, p)]) / (2.0 * a[(p, q)]);
                    x.signum() / (x.abs() + (x * x + 1.0).sqrt())
                };
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for k in 0..N {
                    let (x, y) = (a[(k, p)], a[(k, q)]);
                    (a[(k, p)], a[(k, q)]) = (c * x - s * y, s * x + c * y);
                    let (x, y) = (v[(k, p)], v[(k, q)]);
                    (v[(k, p)], v[(k, q)]) = (c * x - s * y, s * x + c * y);
                }
                for k in 0..N {
                    let (x, y) = (a[(p, k)], a[(q, k)]);
                    (a[(p, k)], a[(q, k)]) = (c * x - s * y, s * x + c * y);
                }
            }
        }
    }
    v
}
