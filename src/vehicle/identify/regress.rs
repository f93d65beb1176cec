use super::series::median;
use nalgebra::{DMatrix, DVector};

/// Residuals beyond this many standard deviations lose weight (Huber).
const HUBER: f64 = 3.0;

/// A linear regression `y ≈ X·β` over rows that fall into clusters (stretches of flight).
pub struct Rows {
    pub x: DMatrix<f64>,
    pub y: DVector<f64>,
    pub cluster: Vec<usize>,
}

/// What a regression gives.
pub struct Fit {
    pub beta: DVector<f64>,
    /// Of `beta`, from the scatter between clusters: rows of one cluster may be correlated as they like.
    pub covariance: DMatrix<f64>,
    /// Share of the (weighted) variance that is explained, 0..1.
    pub explained: f64,
    /// (Weighted) sum of squares that is left, and of the weights.
    pub left: f64,
    pub weight: f64,
    /// Diagonal of the inverse of the normal matrix.
    inverse: DVector<f64>,
}

impl Fit {
    pub fn sigma(&self, i: usize) -> f64 {
        self.covariance[(i, i)].max(0.0).sqrt()
    }

    /// Sum of squares that column `i` explains beyond all others.
    pub fn alone(&self, i: usize) -> f64 {
        self.beta[i] * self.beta[i] / self.inverse[i].max(f64::MIN_POSITIVE)
    }
}

impl Rows {
    /// Takes each cluster's mean off every column: constants that differ between clusters drop out.
    pub fn without_means(mut self) -> Self {
        let clusters = self.cluster.iter().max().map_or(0, |m| m + 1);
        let mut count = vec![0.0; clusters];
        for c in &self.cluster {
            count[*c] += 1.0;
        }
        let centre = |column: &mut [f64], cluster: &[usize]| {
            let mut mean = vec![0.0; clusters];
            for (v, c) in column.iter().zip(cluster) {
                mean[*c] += *v / count[*c];
            }
            for (v, c) in column.iter_mut().zip(cluster) {
                *v -= mean[*c];
            }
        };
        centre(self.y.as_mut_slice(), &self.cluster);
        for mut column in self.x.column_iter_mut() {
            centre(column.as_mut_slice(), &self.cluster);
        }
        self
    }

    /// Robust least squares: Huber's weights, repeated; covariance by the sandwich over clusters.
    ///
    /// `None` where the rows do not determine every coefficient.
    pub fn fit(&self) -> Option<Fit> {
        let (n, p) = self.x.shape();
        if n < 4 * p {
            return None;
        }
        let mut w = DVector::from_element(n, 1.0);
        let mut beta = DVector::zeros(p);
        let mut residual = self.y.clone();
        for _ in 0..12 {
            beta = solve(&self.normal(&w), &self.moment(&w))?;
            residual = &self.y - &self.x * &beta;
            let mut sizes: Vec<f64> = residual.iter().map(|r| r.abs()).collect();
            let scale = 1.4826 * median(&mut sizes)?;
            for (w, r) in w.iter_mut().zip(residual.iter()) {
                *w = (HUBER * scale / r.abs().max(1e-300)).min(1.0);
            }
        }
        let bread = self.normal(&w).try_inverse()?;
        let clusters = self.cluster.iter().max().map_or(0, |m| m + 1);
        let mut scores = DMatrix::zeros(p, clusters);
        for (i, c) in self.cluster.iter().enumerate() {
            let mut score = scores.column_mut(*c);
            score += self.x.row(i).transpose() * (w[i] * residual[i]);
        }
        let spread = clusters as f64 / (clusters as f64 - 1.0).max(1.0);
        let covariance = &bread * (&scores * scores.transpose()) * &bread * spread;
        let weighted = |v: &DVector<f64>| w.iter().zip(v.iter()).map(|(w, x)| w * x * x).sum::<f64>();
        let total = weighted(&self.y);
        let left = weighted(&residual);
        let explained = if total > 0.0 { 1.0 - left / total } else { 0.0 };
        Some(Fit { beta, covariance, explained, left, weight: w.sum(), inverse: bread.diagonal() })
    }

    /// The share of the variance that plain least squares explains.
    pub fn plain_explained(&self) -> Option<f64> {
        let moment = self.x.tr_mul(&self.y);
        let beta = solve(&self.x.tr_mul(&self.x), &moment)?;
        let total = self.y.norm_squared();
        (total > 0.0).then(|| beta.dot(&moment) / total)
    }

    fn normal(&self, w: &DVector<f64>) -> DMatrix<f64> {
        let mut weighted = self.x.clone();
        for mut column in weighted.column_iter_mut() {
            column.component_mul_assign(w);
        }
        self.x.tr_mul(&weighted)
    }

    fn moment(&self, w: &DVector<f64>) -> DVector<f64> {
        self.x.tr_mul(&self.y.component_mul(w))
    }
}

/// Solves a symmetric positive definite system; `None` where it is (nearly) singular.
pub fn solve(a: &DMatrix<f64>, b: &DVector<f64>) -> Option<DVector<f64>> {
    // equilibrated, so that "nearly" does not depend on units
    let d = DVector::from_iterator(a.nrows(), a.diagonal().iter().map(|x| x.max(1e-300).sqrt().recip()));
    let scaled = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] * d[i] * d[j]);
    let factor = scaled.cholesky()?;
    let smallest = factor.l_dirty().diagonal().min();
    (smallest > 1e-6).then(|| factor.solve(&b.component_mul(&d)).component_mul(&d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn rows(outliers: bool) -> Rows {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let n = 400;
        let x = DMatrix::from_fn(n, 2, |_, _| random.random_range(-1.0..1.0));
        let offsets: Vec<f64> = (0..10).map(|_| random.random_range(-5.0..5.0)).collect();
        let cluster: Vec<usize> = (0..n).map(|i| i / 40).collect();
        let y = DVector::from_fn(n, |i, _| {
            let wild = if outliers && i % 25 == 0 { 50.0 } else { 0.0 };
            2.0 * x[(i, 0)] - 3.0 * x[(i, 1)] + offsets[cluster[i]] + random.random_range(-0.1..0.1) + wild
        });
        Rows { x, y, cluster }
    }

    #[test]
    fn finds_coefficients_beside_cluster_offsets() {
        let fit = rows(false).without_means().fit().unwrap();
        for (i, truth) in [2.0, -3.0].into_iter().enumerate() {
            assert!((fit.beta[i] - truth).abs() < 4.0 * fit.sigma(i).max(1e-3), "{}", fit.beta);
        }
        assert!(fit.explained > 0.99);
    }

    #[test]
    fn outliers_have_little_weight() {
        let fit = rows(true).fit().unwrap();
        assert!((fit.beta[0] - 2.0).abs() < 1.0 && (fit.beta[1] + 3.0).abs() < 1.0, "{}", fit.beta);
    }

    #[test]
    fn what_is_not_determined_is_not_invented() {
        let x = DMatrix::from_fn(50, 2, |i, _| i as f64);
        assert!(Rows { y: x.column(0).into(), x, cluster: vec![0; 50] }.fit().is_none());
    }
}
