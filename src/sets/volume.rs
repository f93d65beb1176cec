use super::Zonotope;
use nalgebra::{SMatrix, SVector};

/// More parallelotopes than this are not added up.
const MOST_TERMS: u64 = 1_000_000;

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// Volume: 2ᴺ·Σ|det| over every choice of N generators (Shephard, *Combinatorial properties of associated
    /// zonotopes*, Canadian J. Math. 26, 1974), the slack counted as generators. `None` where that are more than a
    /// million determinants. A figure for comparisons: its rounding is not bounded.
    pub fn volume(&self) -> Option<f64> {
        let axes = (0..N).filter(|&i| self.slack[i] > 0.0).map(|i| {
            let mut g = SVector::<f64, N>::zeros();
            g[i] = self.slack[i];
            g
        });
        let columns: Vec<SVector<f64, N>> = self.generators().chain(axes).collect();
        if columns.len() < N {
            return Some(0.0);
        }
        let mut terms: u64 = 1;
        for k in 0..N as u64 {
            terms = terms.checked_mul(columns.len() as u64 - k)? / (k + 1);
            if terms > MOST_TERMS {
                return None;
            }
        }
        let mut choice: [usize; N] = std::array::from_fn(|k| k);
        let mut sum = 0.0;
        loop {
            sum += determinant(SMatrix::<f64, N, N>::from_fn(|i, k| columns[choice[k]][i])).abs();
            // the next choice in lexicographic order
            let Some(k) = (0..N).rev().find(|&k| choice[k] < columns.len() - N + k) else { break };
            choice[k] += 1;
            for later in k + 1..N {
                choice[later] = choice[later - 1] + 1;
            }
        }
        Some(2.0_f64.powi(N as i32) * sum)
    }
}

/// By elimination with partial pivoting.
pub(super) fn determinant<const N: usize>(mut a: SMatrix<f64, N, N>) -> f64 {
    let mut product = 1.0;
    for k in 0..N {
        let row = (k..N).max_by(|p, q| a[(*p, k)].abs().total_cmp(&a[(*q, k)].abs())).unwrap_or(k);
        if a[(row, k)] == 0.0 {
            return 0.0;
        }
        if row != k {
            a.swap_rows(row, k);
            product = -product;
        }
        product *= a[(k, k)];
        for i in k + 1..N {
            let factor = a[(i, k)] / a[(k, k)];
            for j in k..N {
                a[(i, j)] -= factor * a[(k, j)];
            }
        }
    }
    product
}
