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

/// Sweeps of the least-squares scaling at most.
const SWEEPS: usize = 200;

/// One number of a problem: an entry of F₀ or of an Fₖ.
struct Entry {
    block: usize,
    row: usize,
    col: usize,
    unknown: Option<usize>,
    log: f64,
}

/// Every entry on or above the diagonal that is not zero.
fn entries(problem: &Problem) -> Vec<Entry> {
    let mut out = Vec::new();
    for (block, e) in blocks(problem).enumerate() {
        let mut push = |row: usize, col: usize, unknown, v: f64| {
            if row <= col && v != 0.0 {
                out.push(Entry { block, row, col, unknown, log: v.abs().ln() });
            }
        };
        let constant = e.constant_part();
        (0..constant.ncols()).for_each(|j| (0..=j).for_each(|i| push(i, j, None, constant[(i, j)])));
        for (&k, f) in e.terms() {
            f.iter().for_each(|(&(i, j), &v)| push(i, j, Some(k), v));
        }
    }
    out
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

    /// Makes the coefficients comparable: first in the least-squares sense of logarithms (Curtis and Reid's scaling,
    /// kept symmetric), which also carries the size of constants over to blocks that have none; then so that no entry
    /// exceeds one (Ruiz's iteration).
    pub(super) fn from_coefficients(problem: &Problem) -> Self {
        let mut s = Self::none(problem);
        s.balance_logarithms(&entries(problem));
        for _ in 0..10 {
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
                    // only shrink: what is small already is so by the choice above
                    if m > 1.0 {
                        *d /= m.sqrt();
                    }
                }
            }
        }
        s.rounded()
    }

    /// Minimises Σ (ln|v| + ln c + ln dᵢ + ln dⱼ)² over all entries v, one unknown after the other (Gauss–Seidel).
    fn balance_logarithms(&mut self, entries: &[Entry]) {
        let mut logs = vec![0.0; self.unknowns.len()];
        let mut rows: Vec<Vec<f64>> = self.blocks.iter().map(|d| vec![0.0; d.len()]).collect();
        for _ in 0..SWEEPS {
            let mut sums = vec![(0.0, 0.0); logs.len()];
            for e in entries {
                if let Some(k) = e.unknown {
                    sums[k].0 += e.log + rows[e.block][e.row] + rows[e.block][e.col];
                    sums[k].1 += 1.0;
                }
            }
            let mut moved: f64 = 0.0;
            for (log, (sum, count)) in logs.iter_mut().zip(sums) {
                if count > 0.0 {
                    moved = moved.max((*log + sum / count).abs());
                    *log = -sum / count;
                }
            }
            // a row meets its own entries twice on the diagonal; all rows at once, so each takes half its step
            let mut sums: Vec<Vec<(f64, f64)>> = rows.iter().map(|r| vec![(0.0, 0.0); r.len()]).collect();
            for e in entries {
                let left = e.log + e.unknown.map_or(0.0, |k| logs[k]) + rows[e.block][e.row] + rows[e.block][e.col];
                let weight = if e.row == e.col { 2.0 } else { 1.0 };
                for at in [e.row, e.col] {
                    let sum = &mut sums[e.block][at];
                    *sum = (sum.0 + left, sum.1 + weight);
                }
            }
            for (rows, sums) in rows.iter_mut().zip(sums) {
                for (row, (sum, count)) in rows.iter_mut().zip(sums) {
                    if count > 0.0 {
                        *row -= 0.5 * sum / count;
                        moved = moved.max((sum / count).abs());
                    }
                }
            }
            if moved < 0.1 {
                break;
            }
        }
        for (c, log) in self.unknowns.iter_mut().zip(logs) {
            *c = log.clamp(-300.0, 300.0).exp();
        }
        for (d, log) in self.blocks.iter_mut().flatten().zip(rows.into_iter().flatten()) {
            *d = log.clamp(-300.0, 300.0).exp();
        }
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
            // an entry that is (nearly) zero says nothing about its units and keeps its scale; none moves far at once,
            // for the answer may be zero
            let typical = d.iter().zip(&sizes).map(|(d, v)| v * d * d).fold(0.0, f64::max);
            for (d, v) in d.iter_mut().zip(sizes) {
                let size = v * *d * *d;
                if size > 1e-12 * typical {
                    *d /= size.clamp(1e-6, 1e6).sqrt();
                }
            }
        }
        s.balance_unknowns(problem, 1.0);
        Some(s.rounded())
    }

    /// What one scaled unit of an unknown may change in a linear objective.
    pub(super) fn objective_unit(&self, problem: &Problem) -> f64 {
        problem.objective().linear.iter().map(|(&k, q)| (q * self.unknowns[k]).abs()).fold(0.0, f64::max)
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
