//! The products of matrices that a set's updates spend their time in, with the widest registers that the processor has.
//!
//! Rows are slices of one length. How sums are ordered, and whether a product is rounded before it is added, depends on
//! the processor; the bounds on rounding that the callers add cover each of these.

use pulp::{Arch, Simd, WithSimd};
use std::array::from_fn;

/// Rows and columns of one tile of a Gram matrix: what is loaded is used three times, and the sums fit the registers.
const TILE: usize = 3;
/// Rows, and registers along each, that are updated together: enough sums for none to wait for the one before.
const TALL: usize = 4;
const PAIR: usize = 2;

/// `rows·rowsᵀ`, over the first `len` columns.
pub(super) fn gram<const N: usize, const M: usize>(rows: &[[f64; M]; N], len: usize) -> [[f64; N]; N] {
    Arch::new().dispatch(Gram { rows, len: len.min(M) })
}

/// `target = rows + factors·sources`, over at least the first `len` columns: `factors` holds one row for each row, of
/// which as many entries count as there are sources. What lies behind `len` is left with any value.
pub(super) fn combine<const N: usize, const M: usize>(
    rows: &[[f64; M]; N],
    factors: &[[f64; N]; N],
    sources: &[&[f64; M]],
    len: usize,
    target: &mut [[f64; M]; N],
) {
    Arch::new().dispatch(Combine { rows, factors, sources, len: len.min(M), target });
}

struct Gram<'a, const N: usize, const M: usize> {
    rows: &'a [[f64; M]; N],
    len: usize,
}

impl<const N: usize, const M: usize> WithSimd for Gram<'_, N, M> {
    type Output = [[f64; N]; N];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut products = [[0.0; N]; N];
        // rows behind the last stand for it, and their products are left out
        let tile = |first: usize| -> [&[f64]; TILE] { from_fn(|k| &self.rows[(first + k).min(N - 1)][..self.len]) };
        for i in (0..N).step_by(TILE) {
            for j in (0..=i).step_by(TILE) {
                let (x, y) = (tile(i), tile(j));
                let (a, b) = (x.map(|r| S::as_simd_f64s(r)), y.map(|r| S::as_simd_f64s(r)));
                let (whole, rest) = (a[0].0.len(), a[0].1.len());
                let (u, v) = (a.map(|r| &r.0[..whole]), b.map(|r| &r.0[..whole]));
                let mut sums = [[simd.splat_f64s(0.0); TILE]; TILE];
                for q in 0..whole {
                    let (u, v): ([_; TILE], [_; TILE]) = (from_fn(|k| u[k][q]), from_fn(|k| v[k][q]));
                    for (line, u) in sums.iter_mut().zip(u) {
                        for (sum, v) in line.iter_mut().zip(v) {
                            *sum = simd.mul_add_f64s(u, v, *sum);
                        }
                    }
                }
                for k in 0..TILE.min(N - i) {
                    for l in 0..TILE.min(N - j) {
                        let behind: f64 = (0..rest).map(|m| a[k].1[m] * b[l].1[m]).sum();
                        let product = simd.reduce_sum_f64s(sums[k][l]) + behind;
                        products[i + k][j + l] = product;
                        products[j + l][i + k] = product;
                    }
                }
            }
        }
        products
    }
}

struct Combine<'a, const N: usize, const M: usize> {
    rows: &'a [[f64; M]; N],
    factors: &'a [[f64; N]; N],
    sources: &'a [&'a [f64; M]],
    len: usize,
    target: &'a mut [[f64; M]; N],
}

impl<const N: usize, const M: usize> WithSimd for Combine<'_, N, M> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rows, factors, sources, len, target } = self;
        let (high_rows, rows) = rows.as_chunks::<TALL>();
        let (high_factors, factors) = factors.as_chunks::<TALL>();
        let (high_target, target) = target.as_chunks_mut::<TALL>();
        for ((rows, factors), target) in high_rows.iter().zip(high_factors).zip(high_target) {
            band(simd, rows, factors, sources, len, target);
        }
        for ((row, factor), target) in rows.iter().zip(factors).zip(target) {
            band(simd, &[*row], &[*factor], sources, len, std::array::from_mut(target));
        }
    }
}

/// [`combine`] for a few rows, over two registers' columns at a time.
#[inline(always)]
fn band<S: Simd, const T: usize, const N: usize, const M: usize>(
    simd: S,
    rows: &[[f64; M]; T],
    factors: &[[f64; N]; T],
    sources: &[&[f64; M]],
    len: usize,
    target: &mut [[f64; M]; T],
) {
    let blocks = len.div_ceil(PAIR * S::F64_LANES).min(M / (PAIR * S::F64_LANES));
    let whole = |row| &pairs::<S>(row)[..blocks];
    let mut all = [whole(&rows[0]); N];
    all.iter_mut().zip(sources).for_each(|(all, source)| *all = whole(source.as_slice()));
    let all = &all[..sources.len().min(N)];
    let own: [_; T] = from_fn(|k| whole(&rows[k]));
    for q in 0..blocks {
        let mut sums: [_; T] = from_fn(|k| own[k][q]);
        for (m, source) in all.iter().enumerate() {
            let [near, far] = source[q];
            for (sum, factors) in sums.iter_mut().zip(factors) {
                let factor = simd.splat_f64s(factors[m]);
                *sum = [simd.mul_add_f64s(factor, near, sum[0]), simd.mul_add_f64s(factor, far, sum[1])];
            }
        }
        for (target, sum) in target.iter_mut().zip(sums) {
            S::as_mut_simd_f64s(target).0.as_chunks_mut::<PAIR>().0[q] = sum;
        }
    }
    // a capacity that is no multiple of two registers
    for ((row, factors), target) in rows.iter().zip(factors).zip(target) {
        for j in M - M % (PAIR * S::F64_LANES)..M {
            target[j] = row[j] + sources.iter().zip(factors).map(|(s, f)| f * s[j]).sum::<f64>();
        }
    }
}

/// A row by pairs of registers, as far as there are whole ones.
#[inline(always)]
fn pairs<S: Simd>(row: &[f64]) -> &[[S::f64s; PAIR]] {
    S::as_simd_f64s(row).0.as_chunks().0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows<const N: usize, const M: usize>() -> [[f64; M]; N] {
        from_fn(|i| from_fn(|j| ((i * 31 + j * 17) % 97) as f64 / 97.0 - 0.5))
    }

    fn check<const N: usize, const M: usize>(len: usize, sources: usize) {
        let rows: [[f64; M]; N] = rows();
        let products = gram(&rows, len);
        let factors: [[f64; N]; N] = from_fn(|i| from_fn(|j| 0.1 * (i as f64) - 0.07 * (j as f64)));
        let of: Vec<&[f64; M]> = (0..sources).map(|k| &rows[(k * 2) % N]).collect();
        let mut target = [[f64::NAN; M]; N];
        combine(&rows, &factors, &of, len, &mut target);
        for i in 0..N {
            for j in 0..N {
                let exact: f64 = (0..len).map(|k| rows[i][k] * rows[j][k]).sum();
                assert!((products[i][j] - exact).abs() < 1e-12, "{N}×{M}, {len}: {i} {j}");
            }
            for j in 0..len {
                let exact = rows[i][j] + (0..sources).map(|k| factors[i][k] * of[k][j]).sum::<f64>();
                assert!((target[i][j] - exact).abs() < 1e-12, "{N}×{M}, {len}: {i} {j}");
            }
        }
    }

    #[test]
    fn any_size_gives_the_same_as_the_definition() {
        check::<12, 264>(186, 12);
        check::<12, 264>(264, 3);
        check::<2, 24>(7, 1);
        check::<3, 25>(25, 3);
        check::<5, 11>(10, 4);
        check::<1, 3>(3, 1);
        check::<4, 9>(0, 2);
    }
}
