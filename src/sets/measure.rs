use super::products::{combine, gram};
use super::rounding::{gamma, is_positive, up};
use super::{Overlap, Zonotope};
use nalgebra::{SMatrix, SVector};

/// A strip across one axis: `|x_axis − offset| ≤ half_width`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisStrip {
    pub axis: usize,
    pub offset: f64,
    pub half_width: f64,
}

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// How a strip across an axis lies to this set, given the [`Self::row_sums`].
    fn axis_overlap(&self, strip: &AxisStrip, sums: &SVector<f64, N>) -> Overlap {
        let residual = strip.offset - self.centre[strip.axis];
        let reach = sums[strip.axis] + self.slack[strip.axis] + strip.half_width.abs();
        Overlap { residual, admissible: up(reach + gamma(1) * residual.abs(), 4) }
    }

    /// Writes over `out` a set that holds the intersection with strips across axes, at most N of them, with the gain
    /// `K = PCᵀ(CPCᵀ + Q_v)⁻¹` of least Frobenius radius: eqs. (6)–(7) of Wang and Puig without the step of the model.
    /// For every K whatever, `x = c + K(y − Cc) + (I − KC)(x − c) − Kv`; so the rounding of K itself does no harm.
    ///
    /// `told` receives how each strip lies to this set. A strip that is proven to miss it is left out.
    pub fn intersect_axes_into(&self, strips: &[AxisStrip], told: &mut [Overlap], out: &mut Self) {
        let sums = self.row_sums();
        let (gain, used) = self.gain(strips, told, &sums);
        let count = strips.len().min(N);
        let taken = || (0..count).filter(|k| used[*k]);
        out.len = self.len;
        for a in 0..N {
            let (mut moved, mut size) = (0.0, self.centre[a].abs() + sums[a]);
            for k in taken() {
                let (l, strip) = (gain[(a, k)], &strips[k]);
                moved += l * told[k].residual;
                let parts = told[k].residual.abs() + strip.offset.abs() + self.centre[strip.axis].abs();
                size += l.abs() * (parts + sums[strip.axis] + strip.half_width.abs());
            }
            out.centre[a] = self.centre[a] + moved;
            // row a of I − KC
            let mut row = SVector::<f64, N>::zeros();
            row[a] = 1.0;
            taken().for_each(|k| row[strips[k].axis] -= gain[(a, k)]);
            let slack: f64 = row.iter().zip(self.slack.iter()).map(|(m, s)| (m.abs() + gamma(N)) * s).sum();
            out.slack[a] = up(slack + gamma(N + 4) * up(size, 8 * N), 2 * N);
        }
        self.combine(strips, &gain, &used, out);
        for k in taken() {
            out.push(&(gain.column(k) * strips[k].half_width));
        }
    }

    /// The gain, strip by strip: a column each, and whether the strip is used.
    fn gain(
        &self,
        strips: &[AxisStrip],
        told: &mut [Overlap],
        sums: &SVector<f64, N>,
    ) -> (SMatrix<f64, N, N>, [bool; N]) {
        let mut p = SMatrix::<f64, N, N>::from(gram(&self.rows, self.len));
        let mut gain = SMatrix::<f64, N, N>::zeros();
        let mut used = [false; N];
        for (k, (strip, told)) in strips.iter().zip(told).enumerate().take(N) {
            *told = self.axis_overlap(strip, sums);
            let across = p.column(strip.axis).into_owned();
            let variance = across[strip.axis] + strip.half_width * strip.half_width;
            if !told.touches() || !is_positive(variance) {
                continue;
            }
            let next = across / variance;
            p.ger(-1.0, &next, &across, 1.0);
            for earlier in 0..k {
                let at = gain[(strip.axis, earlier)];
                if at != 0.0 {
                    for a in 0..N {
                        gain[(a, earlier)] -= next[a] * at;
                    }
                }
            }
            gain.set_column(k, &next);
            used[k] = true;
        }
        (gain, used)
    }

    /// `out.rows` becomes H − K·CH.
    fn combine(&self, strips: &[AxisStrip], gain: &SMatrix<f64, N, N>, used: &[bool; N], out: &mut Self) {
        let mut sources = [&self.rows[0]; N];
        let mut factors = [[0.0; N]; N];
        let mut n = 0;
        for (k, strip) in strips.iter().enumerate().take(N).filter(|(k, _)| used[*k]) {
            sources[n] = &self.rows[strip.axis];
            factors.iter_mut().zip(gain.column(k).iter()).for_each(|(row, g)| row[n] = -*g);
            n += 1;
        }
        combine(&self.rows, &factors, &sources[..n], self.len, &mut out.rows);
    }
}
