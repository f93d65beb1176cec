//! H∞ norms of strictly proper transfer matrices `(sI − F)⁻¹B`, by eigenvalues of Hamiltonian matrices: the check that
//! no design goes without, apart from the solver that made it.

use nalgebra::{Complex, DMatrix};

/// Real parts below this share of an eigenvalue's size count as zero.
const ON_AXIS: f64 = 1e-8;
/// Share by which the two ends of a norm may differ.
const PRECISION: f64 = 1e-7;
/// Iterations of the bracketing: it converges quadratically.
const ROUNDS: usize = 60;

/// An H∞ norm between two ends: the largest gain found at any frequency, and a value that no frequency reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HinfNorm {
    /// Gain at `peak_rads`.
    pub lower: f64,
    /// The Hamiltonian matrix of this value has no eigenvalue on the imaginary axis.
    pub upper: f64,
    /// rad/s.
    pub peak_rads: f64,
}

/// Eigenvalues; `None` when they cannot be computed.
pub fn eigenvalues(m: &DMatrix<f64>) -> Option<Vec<Complex<f64>>> {
    if m.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let m = faer::Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)]);
    let values = m.eigenvalues().ok()?;
    Some(values.iter().map(|v| Complex::new(v.re, v.im)).collect())
}

/// The largest real part of the eigenvalues: negative for a Hurwitz matrix.
pub fn spectral_abscissa(m: &DMatrix<f64>) -> Option<f64> {
    Some(eigenvalues(m)?.iter().map(|v| v.re).fold(f64::NEG_INFINITY, f64::max))
}

/// Largest singular value of `(jωI − F)⁻¹B`, through the real form of the complex system.
pub fn gain_at(f: &DMatrix<f64>, b: &DMatrix<f64>, omega: f64) -> Option<f64> {
    let n = f.nrows();
    // (jωI − F)(x + jy) = b, for real b: −Fx − ωy = b, ωx − Fy = 0
    let mut m = DMatrix::zeros(2 * n, 2 * n);
    m.view_mut((0, 0), (n, n)).copy_from(&-f);
    m.view_mut((n, n), (n, n)).copy_from(&-f);
    for i in 0..n {
        m[(i, n + i)] = -omega;
        m[(n + i, i)] = omega;
    }
    let mut rhs = DMatrix::zeros(2 * n, b.ncols());
    rhs.view_mut((0, 0), b.shape()).copy_from(b);
    let xy = m.lu().solve(&rhs)?;
    // the columns of [X −Y; Y X] hold every singular value of X + jY twice
    let (x, y) = (xy.rows(0, n), xy.rows(n, n));
    let gram_re = x.transpose() * x + y.transpose() * y;
    let gram_im = x.transpose() * y - y.transpose() * x;
    let k = b.ncols();
    let hermitian = DMatrix::from_fn(2 * k, 2 * k, |i, j| match (i < k, j < k) {
        (true, true) => gram_re[(i, j)],
        (false, false) => gram_re[(i - k, j - k)],
        (true, false) => -gram_im[(i, j - k)],
        (false, true) => gram_im[(i - k, j)],
    });
    let top = hermitian.symmetric_eigenvalues().iter().copied().fold(0.0, f64::max);
    Some(top.sqrt())
}

/// The frequencies at which some singular value of `(jωI − F)⁻¹B` equals γ: imaginary eigenvalues of the Hamiltonian
/// matrix `[F, BBᵀ/γ; −I/γ, −Fᵀ]`.
fn crossings(f: &DMatrix<f64>, b: &DMatrix<f64>, gamma: f64) -> Option<Vec<f64>> {
    let n = f.nrows();
    let mut h = DMatrix::zeros(2 * n, 2 * n);
    h.view_mut((0, 0), (n, n)).copy_from(f);
    h.view_mut((0, n), (n, n)).copy_from(&(b * b.transpose() / gamma));
    h.view_mut((n, n), (n, n)).copy_from(&-f.transpose());
    for i in 0..n {
        h[(n + i, i)] = -1.0 / gamma;
    }
    let size = h.amax();
    let mut at: Vec<f64> = eigenvalues(&h)?
        .into_iter()
        .filter(|v| v.im >= 0.0 && v.re.abs() <= ON_AXIS * v.norm().max(f64::EPSILON * size))
        .map(|v| v.im)
        .collect();
    at.sort_by(f64::total_cmp);
    Some(at)
}

/// `‖(sI − F)⁻¹B‖∞`. `None` unless F is Hurwitz.
///
/// Bruinsma and Steinbuch's bracketing: the gain is evaluated between the frequencies at which it crosses a value a
/// little above the largest gain found; when it crosses nowhere, that value is an upper end.
pub fn hinf_norm(f: &DMatrix<f64>, b: &DMatrix<f64>) -> Option<HinfNorm> {
    if spectral_abscissa(f)? >= 0.0 {
        return None;
    }
    let mut best = HinfNorm { lower: gain_at(f, b, 0.0)?, upper: f64::INFINITY, peak_rads: 0.0 };
    for pole in eigenvalues(f)? {
        best.look(f, b, pole.norm())?;
        best.look(f, b, pole.im.abs())?;
    }
    if best.lower == 0.0 {
        return Some(HinfNorm { upper: 0.0, ..best });
    }
    for _ in 0..ROUNDS {
        let gamma = best.lower * (1.0 + 2.0 * PRECISION);
        let at = crossings(f, b, gamma)?;
        let found = best.lower;
        let ends = std::iter::once(0.0).chain(at.iter().copied());
        for (lo, hi) in ends.zip(at.iter().copied()) {
            best.look(f, b, 0.5 * (lo + hi))?;
        }
        if at.is_empty() || best.lower <= found {
            // the crossings that are left are eigenvalues that only rounding puts on the axis
            best.upper = gamma.max(best.lower * (1.0 + 2.0 * PRECISION));
            return Some(best);
        }
    }
    None
}

impl HinfNorm {
    fn look(&mut self, f: &DMatrix<f64>, b: &DMatrix<f64>, omega: f64) -> Option<()> {
        let gain = gain_at(f, b, omega)?;
        if gain > self.lower {
            (self.lower, self.peak_rads) = (gain, omega);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::dmatrix;
    use proptest::prelude::*;

    #[test]
    fn a_resonance_has_the_known_peak() {
        // x₁ = 1/(s² + 2ζs + 1): peak 1/(2ζ√(1 − ζ²)) at √(1 − 2ζ²); x₂ = s·x₁
        let zeta: f64 = 0.05;
        let f = dmatrix![0.0, 1.0; -1.0, -2.0 * zeta];
        let b = dmatrix![0.0; 1.0];
        let n = hinf_norm(&f, &b).unwrap();
        // |H|² = (1 + ω²)/((1 − ω²)² + 4ζ²ω²), on a fine grid
        let exact = (0..200_000)
            .map(|i| {
                let w = 0.9 + 1e-6 * f64::from(i);
                ((1.0 + w * w) / ((1.0 - w * w).powi(2) + 4.0 * zeta * zeta * w * w)).sqrt()
            })
            .fold(0.0, f64::max);
        assert!((n.lower - exact).abs() < 1e-6 * exact, "{n:?} {exact}");
        assert!(n.lower <= n.upper && n.upper < n.lower * 1.000_001);
    }

    #[test]
    fn an_unstable_system_has_none() {
        assert_eq!(hinf_norm(&dmatrix![0.1], &dmatrix![1.0]), None);
        assert_eq!(hinf_norm(&dmatrix![0.0], &dmatrix![1.0]), None);
    }

    proptest! {
        #[test]
        fn no_frequency_exceeds_the_upper_end(
            entries in prop::collection::vec(-3.0..3.0f64, 16),
            b in prop::collection::vec(-2.0..2.0f64, 8),
            omegas in prop::collection::vec(0.0..30.0f64, 40),
        ) {
            let raw = DMatrix::from_vec(4, 4, entries);
            let shift = spectral_abscissa(&raw).unwrap() + 0.05;
            let f = raw - DMatrix::identity(4, 4) * shift;
            let b = DMatrix::from_vec(4, 2, b);
            let n = hinf_norm(&f, &b).unwrap();
            for w in omegas {
                prop_assert!(gain_at(&f, &b, w).unwrap() <= n.upper);
            }
        }
    }
}
