/// The scalarised trade-off between a small bound and a fast convergence (eqs. 21–23).
///
/// J_μ = μ·J₁ + (1 − μ)·J₂, each objective scaled to 0 at its best and 1 at its nadir: J₁ by the volume, smallest at
/// some α† and, at the best rate α*, at its worst; J₂ by the rate, best at α*, at its nadir at α†.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TradeOff {
    /// (α†, volume): the smallest bound.
    pub smallest: (f64, f64),
    /// (α*, volume): the fastest rate that is considered.
    pub fastest: (f64, f64),
}

impl TradeOff {
    /// From (α, volume) pairs; `None` without any.
    pub fn of(front: &[(f64, f64)]) -> Option<Self> {
        let smallest = front.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let fastest = front.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Self { smallest, fastest })
    }

    /// J_μ of a design.
    pub fn cost(&self, mu: f64, (alpha, volume): (f64, f64)) -> f64 {
        // where both objectives are best at the same rate there is nothing to trade
        let share = |x: f64, best: f64, nadir: f64| if nadir == best { 0.0 } else { (x - best) / (nadir - best) };
        let j1 = share(volume, self.smallest.1, self.fastest.1);
        let j2 = share(alpha, self.fastest.0, self.smallest.0);
        mu * j1 + (1.0 - mu) * j2
    }

    /// The pair of a front with the least J_μ; of equals the fastest.
    pub fn choose(&self, mu: f64, front: &[(f64, f64)]) -> Option<(f64, f64)> {
        let key = |p: &(f64, f64)| (self.cost(mu, *p), -p.0);
        front.iter().copied().min_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1))
        })
    }
}

/// The place of the least value of a function on an interval, to a share of its width, if it has one minimum there
/// (golden section).
pub(super) fn minimise(mut lo: f64, mut hi: f64, share: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    let width = hi - lo;
    let (mut a, mut b) = (hi - golden * (hi - lo), lo + golden * (hi - lo));
    let (mut fa, mut fb) = (f(a), f(b));
    while hi - lo > share * width {
        if fa <= fb {
            (hi, b, fb) = (b, a, fa);
            a = hi - golden * (hi - lo);
            fa = f(a);
        } else {
            (lo, a, fa) = (a, b, fb);
            b = lo + golden * (hi - lo);
            fb = f(b);
        }
    }
    0.5 * (lo + hi)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_the_trade_off_are_the_ends_of_the_front() {
        let front: Vec<(f64, f64)> = (1..=100).map(|k| 0.1 * k as f64).map(|a| (a, (a - 2.0).powi(2) + 1.0)).collect();
        let t = TradeOff::of(&front).unwrap();
        assert!((t.smallest.0 - 2.0).abs() < 1e-9 && (t.fastest.0 - 10.0).abs() < 1e-9);
        assert!((t.choose(1.0, &front).unwrap().0 - 2.0).abs() < 1e-9);
        assert!((t.choose(0.0, &front).unwrap().0 - 10.0).abs() < 1e-9);
        // dJ/dα = 0: μ·2(α−2)/64 = (1−μ)/8
        let mu = 0.8;
        assert!((t.choose(mu, &front).unwrap().0 - (2.0 + 4.0 * (1.0 - mu) / mu)).abs() < 0.06);
        assert_eq!((t.cost(0.5, t.smallest), t.cost(0.5, t.fastest)), (0.5, 0.5));
    }

    #[test]
    fn a_front_that_only_improves_with_the_rate_has_nothing_to_trade() {
        let front = [(1.0, 3.0), (2.0, 2.0), (3.0, 1.0)];
        let t = TradeOff::of(&front).unwrap();
        assert_eq!(t.choose(0.5, &front), Some((3.0, 1.0)));
        assert_eq!(TradeOff::of(&[]), None);
    }

    #[test]
    fn golden_section_finds_the_minimum() {
        assert!((minimise(-1.0, 5.0, 1e-6, |x| (x - 1.3).powi(2)) - 1.3).abs() < 1e-5);
    }
}
