use super::Zonotope;
use super::rounding::{dot, gamma, is_positive, up};
use nalgebra::SVector;
use std::cmp::Ordering;

/// The points with `|normal·x − offset| ≤ half_width`: what one bounded measurement says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Strip<const N: usize> {
    pub normal: SVector<f64, N>,
    pub offset: f64,
    pub half_width: f64,
}

/// How a strip met a set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Overlap {
    /// `offset − normal·centre`, before the intersection: the centre of the residual's interval.
    pub residual: f64,
    /// Largest size of that at which set and strip can still touch, rounded up.
    pub admissible: f64,
}

impl Overlap {
    /// True unless set and strip are proven to be disjoint: 0 ∈ R, eq. (11) of Wang and Puig for one output.
    pub fn touches(self) -> bool {
        // a NaN proves nothing
        self.residual.abs().partial_cmp(&self.admissible) != Some(Ordering::Greater)
    }

    /// Residual over its admissible size: above 1 set and strip are disjoint.
    pub fn ratio(self) -> f64 {
        self.residual.abs() / self.admissible
    }
}

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// How a strip lies to this set.
    pub fn overlap(&self, strip: &Strip<N>) -> Overlap {
        let inner = strip.normal.dot(&self.centre);
        let residual = strip.offset - inner;
        let size: f64 = strip.normal.iter().zip(self.centre.iter()).map(|(c, x)| (c * x).abs()).sum();
        let rounding = gamma(N + 2) * (size + strip.offset.abs() + residual.abs());
        Overlap { residual, admissible: up(self.reach(&strip.normal) + strip.half_width.abs() + rounding, N + 4) }
    }

    /// Replaces the set by one that holds its intersection with a strip, the smallest in Frobenius radius among
    /// `⟨c + λr, [(I − λnᵀ)H, λσ]⟩` (Alamo, Bravo, Camacho, *Automatica* 41, 2005, proposition 2). The λ of least
    /// radius is the Kalman gain `HHᵀn/(nᵀHHᵀn + σ²)`, eq. (7) of Wang and Puig for one output: taking the outputs
    /// one after another gives the same set as all at once when their noises are independent.
    ///
    /// `None`, and the set unchanged, when the two are proven to be disjoint.
    pub fn intersect_strip(&mut self, strip: &Strip<N>) -> Option<Overlap> {
        let overlap = self.overlap(strip);
        if !overlap.touches() {
            return None;
        }
        self.spread();
        let mut along = [0.0; M];
        for (row, n) in self.rows.iter().zip(strip.normal.iter()).filter(|(_, n)| **n != 0.0) {
            for (a, h) in along[..self.len].iter_mut().zip(row) {
                *a += n * h;
            }
        }
        self.update(strip, &along, overlap.residual);
        Some(overlap)
    }

    /// The update with `along` = nᵀH.
    fn update(&mut self, strip: &Strip<N>, along: &[f64; M], residual: f64) {
        let along = &along[..self.len];
        let sums = self.row_sums();
        let sigma = strip.half_width.abs();
        let variance = dot(along, along) + sigma * sigma;
        if !is_positive(variance) {
            return;
        }
        let gain = SVector::<f64, N>::from_fn(|k, _| dot(&self.rows[k][..self.len], along) / variance);
        // nᵀH was itself computed, in N roundings of terms of this total size
        let reach: f64 = strip.normal.iter().zip(sums.iter()).map(|(n, s)| n.abs() * s).sum();
        let offset_size: f64 = strip.normal.iter().zip(self.centre.iter()).map(|(n, c)| (n * c).abs()).sum();
        let slack_along: f64 = strip.normal.iter().zip(self.slack.iter()).map(|(n, s)| n.abs() * s).sum();
        for k in 0..N {
            let l = gain[k];
            if l == 0.0 {
                continue;
            }
            for (h, a) in self.rows[k][..self.len].iter_mut().zip(along) {
                *h -= l * a;
            }
            let moved = l.abs() * up(reach, 2 * N + 2);
            let centre = self.centre[k];
            self.centre[k] = centre + l * residual;
            let rounding = gamma(N + 4)
                * (sums[k]
                    + moved
                    + centre.abs()
                    + l.abs() * (offset_size + strip.offset.abs() + residual.abs() + sigma));
            // what is still slack goes through I − λnᵀ as a box
            let own = (1.0 - l * strip.normal[k]).abs() * self.slack[k];
            let others = l.abs() * (slack_along - strip.normal[k].abs() * self.slack[k]).max(0.0);
            let slack_rounding = gamma(2 * N + 8) * (self.slack[k] + l.abs() * slack_along);
            self.slack[k] = up(own + others + 2.0 * slack_rounding + rounding, 2 * N + 20);
        }
        if sigma > 0.0 {
            self.push(&(gain * sigma));
        }
    }
}
