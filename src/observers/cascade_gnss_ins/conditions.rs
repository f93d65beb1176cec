//! Assumption 4 of the paper, condition by condition, each with its reason.

use super::norm::eigenvalues;
use super::plant::Plant;
use nalgebra::{Complex, DMatrix};
use std::fmt;

/// Singular values below this share of the largest count as zero, once rows and columns are brought to unit size.
const RANK_TOLERANCE: f64 = 1e-9;
/// Real parts down to this share of the system's size count as not stable.
const STABLE: f64 = 1e-9;
/// Zeros beyond this multiple of the system's size are taken as infinite: rounding makes such out of chains of
/// integrators.
const INFINITE: f64 = 2e3;

/// What keeps a plant from being designed for.
#[derive(Debug, Clone, PartialEq)]
pub enum Breach {
    /// A mode that does not decay and that no output shows.
    Undetectable { mode: Complex<f64> },
    /// Two different z may give the same output: the rank of the Rosenbrock matrix is smaller than n_w + p_z at
    /// every frequency.
    NotLeftInvertible { rank: usize, needed: usize },
    /// A constant z that the output does not show.
    ZeroAtOrigin,
}

impl fmt::Display for Breach {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Undetectable { mode } => write!(
                f,
                "(A, C) is not detectable: the mode at {} does not decay and no output shows it",
                Display(*mode)
            ),
            Self::NotLeftInvertible { rank, needed } => write!(
                f,
                "(A, B_z, C, D_z) is not left-invertible: its Rosenbrock matrix has rank {rank} of {needed} at every \
                 frequency, so two different z may give the same output"
            ),
            Self::ZeroAtOrigin => f.write_str(
                "(A, B_z, C, D_z) has an invariant zero at the origin: the output does not show some constant z",
            ),
        }
    }
}

/// A complex number as text.
struct Display(Complex<f64>);

impl fmt::Display for Display {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.4}", self.0.re)?;
        if self.0.im != 0.0 { write!(f, " ± {:.4}j", self.0.im.abs()) } else { Ok(()) }
    }
}

/// What was found of Assumption 4, and of the minimum-phase condition of Theorem 2.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditions {
    /// Empty when Assumption 4 holds.
    pub breaches: Vec<Breach>,
    /// Finite invariant zeros of (A, B_z, C, D_z).
    pub zeros: Vec<Complex<f64>>,
    /// All zeros decay: then every γ > 0 can be met (Theorem 2).
    pub minimum_phase: bool,
}

impl Conditions {
    /// Examines a plant whose shapes fit.
    pub fn of(plant: &Plant) -> Self {
        let (n_w, p_z, _) = plant.sizes();
        let mut breaches = Vec::new();
        let size = plant.a.amax().max(1e-3);
        for mode in eigenvalues(&plant.a).unwrap_or_default() {
            if mode.re > -STABLE * size && mode.im >= 0.0 {
                let shown = rank(&pencil(&plant.a, None, &plant.c, None, mode));
                if shown < n_w {
                    breaches.push(Breach::Undetectable { mode });
                }
            }
        }
        let at = |s| rank(&rosenbrock(plant, s));
        // the rank at a point drawn at random is the normal rank, but for a set of measure zero
        let generic = [Complex::new(0.731, 1.237), Complex::new(-1.913, 0.411), Complex::new(0.377, -2.719)];
        let normal = generic.iter().map(|s| at(s * size)).max().unwrap_or(0);
        let needed = n_w + p_z;
        let mut zeros = Vec::new();
        if normal < needed {
            breaches.push(Breach::NotLeftInvertible { rank: normal, needed });
        } else {
            zeros = invariant_zeros(plant, size);
            if at(Complex::new(0.0, 0.0)) < needed {
                breaches.push(Breach::ZeroAtOrigin);
            }
        }
        let minimum_phase = normal == needed && zeros.iter().all(|z| z.re < -STABLE * size);
        Self { breaches, zeros, minimum_phase }
    }
}

/// `[A − sI, B; C, D]` as a real matrix of twice the size: every rank is doubled.
fn pencil(
    a: &DMatrix<f64>,
    b: Option<&DMatrix<f64>>,
    c: &DMatrix<f64>,
    d: Option<&DMatrix<f64>>,
    s: Complex<f64>,
) -> DMatrix<f64> {
    let (n, m, p) = (a.nrows(), b.map_or(0, DMatrix::ncols), c.nrows());
    let mut re = DMatrix::zeros(n + p, n + m);
    re.view_mut((0, 0), (n, n)).copy_from(&(a - DMatrix::identity(n, n) * s.re));
    re.view_mut((n, 0), (p, n)).copy_from(c);
    if let (Some(b), Some(d)) = (b, d) {
        re.view_mut((0, n), (n, m)).copy_from(b);
        re.view_mut((n, n), (p, m)).copy_from(d);
    }
    let mut im = DMatrix::zeros(n + p, n + m);
    for i in 0..n {
        im[(i, i)] = -s.im;
    }
    let (rows, cols) = re.shape();
    let mut out = DMatrix::zeros(2 * rows, 2 * cols);
    out.view_mut((0, 0), (rows, cols)).copy_from(&re);
    out.view_mut((rows, cols), (rows, cols)).copy_from(&re);
    out.view_mut((0, cols), (rows, cols)).copy_from(&-&im);
    out.view_mut((rows, 0), (rows, cols)).copy_from(&im);
    out
}

/// The Rosenbrock system matrix at s.
fn rosenbrock(plant: &Plant, s: Complex<f64>) -> DMatrix<f64> {
    pencil(&plant.a, Some(&plant.b_z), &plant.c, Some(&plant.d_z), s)
}

/// Rank of the complex matrix of which `doubled` is the real form, whatever the units of rows and columns.
fn rank(doubled: &DMatrix<f64>) -> usize {
    let mut m = doubled.clone();
    for _ in 0..4 {
        for mut row in m.row_iter_mut() {
            let size = row.amax();
            if size > 0.0 {
                row /= size;
            }
        }
        for mut column in m.column_iter_mut() {
            let size = column.amax();
            if size > 0.0 {
                column /= size;
            }
        }
    }
    let values = m.singular_values();
    let largest = values.iter().copied().fold(0.0, f64::max);
    values.iter().filter(|v| **v > RANK_TOLERANCE * largest).count().div_ceil(2)
}

/// The finite s at which the Rosenbrock matrix loses column rank.
///
/// Outputs are mixed down to as many as there are inputs, with weights drawn once: the zeros of that square system
/// contain those of the plant, and are sorted out by the rank of the plant's own matrix. At a σ that is no zero,
/// P(s) = P(σ) − (s − σ)E is singular where 1/(s − σ) is an eigenvalue of P(σ)⁻¹E.
fn invariant_zeros(plant: &Plant, size: f64) -> Vec<Complex<f64>> {
    let (n, p_z, p_y) = plant.sizes();
    let needed = n + p_z;
    let mix = DMatrix::from_fn(p_z, p_y, |i, j| (1.0 + 0.618 * i as f64 + 1.414 * j as f64).sin());
    let (c, d) = (&mix * &plant.c, &mix * &plant.d_z);
    let sigma = 0.737 * size;
    let mut at_sigma = DMatrix::zeros(needed, needed);
    at_sigma.view_mut((0, 0), (n, n)).copy_from(&(&plant.a - DMatrix::identity(n, n) * sigma));
    at_sigma.view_mut((0, n), (n, p_z)).copy_from(&plant.b_z);
    at_sigma.view_mut((n, 0), (p_z, n)).copy_from(&c);
    at_sigma.view_mut((n, n), (p_z, p_z)).copy_from(&d);
    let mut e = DMatrix::zeros(needed, needed);
    e.view_mut((0, 0), (n, n)).fill_with_identity();
    let Some(m) = at_sigma.lu().solve(&e) else { return Vec::new() };
    let mut zeros: Vec<Complex<f64>> = Vec::new();
    for mu in eigenvalues(&m).unwrap_or_default() {
        let s = Complex::new(sigma, 0.0) + mu.inv();
        let finite = s.norm() < INFINITE * size && s.im >= 0.0;
        if finite && rank(&rosenbrock(plant, s)) < needed {
            zeros.push(s);
        }
    }
    zeros
}

#[cfg(test)]
mod tests {
    use super::super::plant::Measures;
    use super::*;
    use nalgebra::dmatrix;

    #[test]
    fn the_papers_systems_satisfy_everything() {
        for plant in Measures::ALL.map(Plant::navigation).into_iter().chain([Plant::example_1()]) {
            let c = Conditions::of(&plant);
            assert_eq!(c.breaches, [], "{plant:?}");
            assert!(c.minimum_phase && c.zeros.is_empty(), "{c:?}");
        }
    }

    #[test]
    fn velocity_alone_leaves_the_position_undetected() {
        let mut p = Plant::axis(1.0, None);
        p.c = dmatrix![0.0, 1.0];
        let c = Conditions::of(&p);
        assert!(matches!(c.breaches.as_slice(), [Breach::Undetectable { .. }, ..]), "{c:?}");
        assert!(c.breaches[0].to_string().contains("not detectable"));
    }

    #[test]
    fn two_inputs_behind_one_output_cannot_be_told_apart() {
        let p = Plant {
            a: dmatrix![-1.0, 0.0; 0.0, -2.0],
            b_z: DMatrix::identity(2, 2),
            c: dmatrix![1.0, 1.0],
            d_z: dmatrix![0.0, 0.0],
            n: dmatrix![1.0],
        };
        assert_eq!(Conditions::of(&p).breaches, [Breach::NotLeftInvertible { rank: 3, needed: 4 }]);
    }

    #[test]
    fn zeros_are_found_where_they_were_put() {
        // y = (s − z)/((s + 1)(s + 2)) in controllable form
        for (zero, minimum_phase) in [(0.0, false), (0.5, false), (-0.7, true)] {
            for unit in [1.0, 1e6, 1e-6] {
                let p = Plant {
                    a: dmatrix![0.0, 1.0; -2.0, -3.0],
                    b_z: dmatrix![0.0; unit],
                    c: dmatrix![-zero, 1.0],
                    d_z: dmatrix![0.0],
                    n: dmatrix![1.0],
                };
                let c = Conditions::of(&p);
                assert_eq!(c.breaches.contains(&Breach::ZeroAtOrigin), zero == 0.0, "{c:?}");
                assert_eq!(c.minimum_phase, minimum_phase, "{c:?}");
                assert!(c.zeros.len() == 1 && (c.zeros[0].re - zero).abs() < 1e-6, "{c:?}");
            }
        }
    }

    #[test]
    fn a_decaying_mode_may_be_hidden() {
        let p = Plant {
            a: dmatrix![-1.0, 0.0; 0.0, -2.0],
            b_z: dmatrix![1.0; 0.0],
            c: dmatrix![1.0, 0.0],
            d_z: dmatrix![0.0],
            n: dmatrix![1.0],
        };
        assert_eq!(Conditions::of(&p).breaches, []);
    }
}
