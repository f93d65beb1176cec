use super::Zonotope;
use super::rounding::{gamma, up};
use nalgebra::SVector;

/// Rounds of coordinate descent before a point near the border counts as undecided.
const ROUNDS: usize = 200;

/// Whether a point lies in a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Membership {
    /// A combination of the generators reaches it within the tolerance asked for.
    Inside,
    /// A plane separates it from the set.
    Outside,
    /// Neither was found: it lies at the border.
    Undecided,
}

impl<const N: usize, const M: usize> Zonotope<N, M> {
    /// Does the set hold `x`, within `tolerance` of the same unit in each dimension?
    ///
    /// No linear program: coordinate descent brings `c + Hξ + s` as near to x as the bounds on ξ and s admit. What
    /// remains at the nearest point is the normal of a plane, and that plane is checked with rounding accounted for.
    pub fn membership(&self, x: &SVector<f64, N>, tolerance: f64) -> Membership {
        let target = x - self.centre;
        let mut xi = [0.0; M];
        let mut slack = SVector::<f64, N>::zeros();
        let mut rest = target;
        for _ in 0..ROUNDS {
            for (s, (r, bound)) in slack.iter_mut().zip(rest.iter_mut().zip(self.slack.iter())) {
                let next = (*s + *r).clamp(-bound.abs(), bound.abs());
                *r -= next - *s;
                *s = next;
            }
            for (j, xi) in xi[..self.len].iter_mut().enumerate() {
                let g = SVector::<f64, N>::from_fn(|i, _| self.rows[i][j]);
                let length = g.norm_squared();
                if length > 0.0 {
                    let next = (*xi + g.dot(&rest) / length).clamp(-1.0, 1.0);
                    rest -= g * (next - *xi);
                    *xi = next;
                }
            }
            if rest.amax() <= 0.5 * tolerance {
                return self.reaches(&target, &xi, &slack, tolerance);
            }
            if self.separates(&rest, &target, x) {
                return Membership::Outside;
            }
        }
        Membership::Undecided
    }

    /// True when the set lies inside a box of these half-widths about the origin.
    pub fn within_box(&self, half_widths: &SVector<f64, N>) -> bool {
        self.interval_hull().iter().zip(half_widths.iter()).all(|(i, h)| i.mag() <= *h)
    }

    /// The descent updates what remains little by little; the final word is computed afresh.
    fn reaches(&self, target: &SVector<f64, N>, xi: &[f64; M], slack: &SVector<f64, N>, tolerance: f64) -> Membership {
        let missed = SVector::<f64, N>::from_fn(|i, _| {
            let sum: f64 = self.rows[i][..self.len].iter().zip(xi).map(|(h, x)| h * x).sum();
            target[i] - sum - slack[i]
        });
        if missed.amax() <= tolerance { Membership::Inside } else { Membership::Undecided }
    }

    fn separates(&self, normal: &SVector<f64, N>, target: &SVector<f64, N>, x: &SVector<f64, N>) -> bool {
        let size: f64 = (0..N).map(|i| normal[i].abs() * (target[i].abs() + x[i].abs() + self.centre[i].abs())).sum();
        normal.dot(target) > up(self.reach(normal) + gamma(N + 2) * size, N + 4)
    }
}
