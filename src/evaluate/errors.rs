use serde::Serialize;

/// Errors of one signal, gathered over any number of flights.
#[derive(Debug, Clone, Default)]
pub struct Errors {
    sum: f64,
    sum_of_squares: f64,
    count: u64,
    sizes: Sizes,
    bounded: u64,
    covered: u64,
    width: f64,
}

/// What [`Errors`] come to, in the signal's unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Stats {
    pub samples: u64,
    pub rmse: f64,
    pub bias: f64,
    /// 95 % of all errors are smaller than this.
    pub p95: f64,
    /// Share of the bounds that held; `None` when no bound was given.
    pub coverage: Option<f64>,
    pub mean_half_width: Option<f64>,
}

impl Errors {
    /// One estimate's error and the half-width claimed; an infinite one claims nothing.
    pub fn add(&mut self, error: f64, half_width: f64) {
        self.sum += error;
        self.sum_of_squares += error * error;
        self.count += 1;
        self.sizes.push(error.abs() as f32);
        if half_width.is_finite() {
            self.bounded += 1;
            self.covered += u64::from(error.abs() <= half_width);
            self.width += half_width;
        }
    }

    pub fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.sum_of_squares += other.sum_of_squares;
        self.count += other.count;
        self.sizes.merge(&other.sizes);
        self.bounded += other.bounded;
        self.covered += other.covered;
        self.width += other.width;
    }

    /// `None` without any sample.
    pub fn stats(&self) -> Option<Stats> {
        let n = self.count as f64;
        let p95 = self.sizes.p95()?;
        let of_bounded = |x: f64| (self.bounded > 0).then(|| x / self.bounded as f64);
        Some(Stats {
            samples: self.count,
            rmse: (self.sum_of_squares / n).sqrt(),
            bias: self.sum / n,
            p95: f64::from(p95),
            coverage: of_bounded(self.covered as f64),
            mean_half_width: of_bounded(self.width),
        })
    }
}

/// Absolute errors for their percentile: every one of them at first, every second, fourth, … when there are too many.
#[derive(Debug, Clone)]
struct Sizes {
    kept: Vec<f32>,
    /// One of so many is kept.
    every: u64,
    seen: u64,
}

/// More than this are thinned out: their 95 % is then good to about a thousandth of the samples.
const KEPT: usize = 100_000;

impl Default for Sizes {
    fn default() -> Self {
        Self { kept: Vec::new(), every: 1, seen: 0 }
    }
}

impl Sizes {
    fn push(&mut self, size: f32) {
        if self.seen.is_multiple_of(self.every) {
            if self.kept.len() >= KEPT {
                self.thin_to(2 * self.every);
            }
            self.kept.push(size);
        }
        self.seen += 1;
    }

    fn merge(&mut self, other: &Self) {
        let mut theirs = other.clone();
        let mut every = self.every.max(theirs.every);
        loop {
            self.thin_to(every);
            theirs.thin_to(every);
            if self.kept.len() + theirs.kept.len() <= KEPT {
                break;
            }
            every *= 2;
        }
        self.kept.append(&mut theirs.kept);
        self.seen += theirs.seen;
    }

    fn thin_to(&mut self, every: u64) {
        if every > self.every {
            let keep = usize::try_from(every / self.every).unwrap_or(usize::MAX);
            self.kept = self.kept.iter().copied().step_by(keep).collect();
            self.every = every;
        }
    }

    fn p95(&self) -> Option<f32> {
        let mut sizes = self.kept.clone();
        let at = (sizes.len() * 95).div_ceil(100).checked_sub(1)?;
        let (_, p95, _) = sizes.select_nth_unstable_by(at, f32::total_cmp);
        Some(*p95)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millions_of_errors_take_bounded_room_and_keep_their_percentile() {
        let mut all = Errors::default();
        for part in 0..7_u32 {
            let mut e = Errors::default();
            // uniform over 0..1, in an order that no stride meets
            (0..90_000_u32).for_each(|i| e.add(f64::from((i * 7919 + part) % 10_007) / 10_007.0, 1.0));
            all.merge(&e);
        }
        let s = all.stats().unwrap();
        assert_eq!(s.samples, 630_000);
        assert!((s.p95 - 0.95).abs() < 2e-3, "{}", s.p95);
        assert!(all.sizes.kept.len() <= KEPT);
    }

    #[test]
    fn merged_halves_give_the_same_as_the_whole() {
        let errors: Vec<f64> = (0..100).map(|i| f64::from(i) / 10.0 - 3.0).collect();
        let gather = |part: &[f64]| {
            let mut e = Errors::default();
            part.iter().for_each(|x| e.add(*x, 4.0));
            e
        };
        let mut halves = gather(&errors[..50]);
        halves.merge(&gather(&errors[50..]));
        let (a, b) = (halves.stats().unwrap(), gather(&errors).stats().unwrap());
        assert!((a.rmse - b.rmse).abs() < 1e-12 && a.p95 == b.p95);
        // −3.0 .. 6.9: the mean is 1.95; 4.1 .. 6.9 are not covered; 95 of 100 are at most 6.4
        assert!((b.bias - 1.95).abs() < 1e-9);
        assert_eq!(b.coverage, Some(0.71));
        assert!((b.p95 - 6.4).abs() < 1e-5);
        assert_eq!(Errors::default().stats(), None);
    }

    #[test]
    fn an_open_bound_claims_nothing() {
        let mut e = Errors::default();
        e.add(1.0, f64::INFINITY);
        assert_eq!(e.stats().unwrap().coverage, None);
        e.add(1.0, 2.0);
        assert_eq!(e.stats().unwrap().coverage, Some(1.0));
    }
}
