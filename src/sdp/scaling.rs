use super::expr::Affine;
use super::problem::Problem;

/// A change of units: each constraint block F becomes D·F·D, each unknown x becomes c·x̃.
///
/// Both are powers of two, so they add no rounding. Congruence keeps definiteness, so the problem stays the same; only
/// the solver's tolerances come to mean the same in every row.
#[derive(Debug, Clone)]
pub(super) struct Scales {
    /// D's diagonal by constraint; the log dets' matrices come last.
    pub(super) blocks: Vec<Vec<f64>>,
    /// c by unknown.
    pub(super) unknowns: Vec<f64>,
}

fn blocks(problem: &Problem) -> impl Iterator<Item = &Affine> {
    problem.blocks().map(|(_, e)| e)
}

/// The power of two nearest to x > 0 on a logarithmic scale; 1 for anything else.
fn power_of_two(x: f64) -> f64 {
    if x.is_normal() && x > 0.0 { x.log2().round().clamp(-500.0, 500.0).exp2() } else { 1.0 }
}

impl Scales {
    pub(super) fn none(problem: &Problem) -> Self {
        Self {
            blocks: blocks(problem).map(|e| vec![1.0; e.shape().0]).collect(),
            unknowns: vec![1.0; problem.unknown_count()],
        }
    }

    /// Equilibrates the coefficients (Ruiz's iteration, kept symmetric): afterwards the largest entry of each block
    /// row and of each unknown's coefficients is about one.
    pub(super) fn from_coefficients(problem: &Problem) -> Self {
        let mut s = Self::none(problem);
        for _ in 0..20 {
            s.balance_unknowns(problem, 0.5);
            for (e, d) in blocks(problem).zip(&mut s.blocks) {
                let mut largest = vec![0.0_f64; d.len()];
                let mut see = |i: usize, j: usize, v: f64| {
                    largest[i] = largest[i].max(v);
                    largest[j] = largest[j].max(v);
                };
                for (j, column) in e.constant_part().column_iter().enumerate() {
                    for (i, v) in column.iter().enumerate() {
                        see(i, j, (v * d[i] * d[j]).abs());
                    }
                }
                for (&k, f) in e.terms() {
                    for (&(i, j), v) in f {
                        see(i, j, (v * s.unknowns[k] * d[i] * d[j]).abs());
                    }
                }
                for (d, m) in d.iter_mut().zip(largest) {
                    if m > 0.0 {
                        *d /= m.sqrt();
                    }
                }
            }
        }
        s.rounded()
    }

    /// Brings the rows of every block to unit size at a point, and the unknowns' coefficients to one. `None` when the
    /// point is useless for that.
    ///
    /// A row's size is that of the terms on its diagonal before they cancel: an inequality that is tight at the point
    /// has a small diagonal, which says nothing about its units.
    pub(super) fn at_point(&self, problem: &Problem, x: &[f64]) -> Option<Self> {
        if x.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let mut s = self.clone();
        for (e, d) in blocks(problem).zip(&mut s.blocks) {
            let mut sizes: Vec<f64> = e.constant_part().diagonal().iter().map(|v| v.abs()).collect();
            for (&k, f) in e.terms() {
                for (&(i, j), v) in f {
                    if i == j {
                        sizes[i] += (v * x[k]).abs();
                    }
                }
            }
            // an entry that is (nearly) zero keeps its scale
            let typical = d.iter().zip(&sizes).map(|(d, v)| v * d * d).fold(0.0, f64::max);
            for (d, v) in d.iter_mut().zip(sizes) {
                if v * *d * *d > 1e-12 * typical {
                    *d = v.sqrt().recip();
                }
            }
        }
        s.balance_unknowns(problem, 1.0);
        Some(s.rounded())
    }

    fn balance_unknowns(&mut self, problem: &Problem, exponent: f64) {
        let mut largest = vec![0.0_f64; self.unknowns.len()];
        for (e, d) in blocks(problem).zip(&self.blocks) {
            for (&k, f) in e.terms() {
                for (&(i, j), v) in f {
                    largest[k] = largest[k].max((v * self.unknowns[k] * d[i] * d[j]).abs());
                }
            }
        }
        for (c, m) in self.unknowns.iter_mut().zip(largest) {
            if m > 0.0 {
                *c /= m.powf(exponent);
            }
        }
    }

    fn rounded(mut self) -> Self {
        self.blocks.iter_mut().flatten().chain(&mut self.unknowns).for_each(|x| *x = power_of_two(*x));
        self
    }
}
