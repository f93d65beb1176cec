use nalgebra::Vector3;

/// One instant of one quantity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Instant {
    pub t_s: f64,
    pub truth: Vector3<f64>,
    pub estimate: Vector3<f64>,
}

/// How long changes took to be followed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settling {
    /// One time for each change that was followed, s.
    pub times_s: Vec<f64>,
    /// Changes that never were.
    pub missed: u32,
}

/// A change is followed when the error stays below this share of it.
const SHARE: f64 = 0.2;
/// How long after a change the truth has reached its new value, s: gusts and ramps take a while.
const REACHED_S: f64 = 3.0;
/// A change that is not followed within this time is missed, s.
const PATIENCE_S: f64 = 15.0;
/// An error that is still large this shortly before the end of its time has not settled, s.
const QUIET_S: f64 = 0.5;

impl Settling {
    pub fn merge(&mut self, other: &Self) {
        self.times_s.extend_from_slice(&other.times_s);
        self.missed += other.missed;
    }

    /// `None` when nothing was followed.
    pub fn median_s(&self) -> Option<f64> {
        let mut times = self.times_s.clone();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied()
    }
}

/// Settling times after the given changes (s, in order). Changes of the truth smaller than `least` are passed over.
pub fn settle(series: &[Instant], changes: &[f64], least: f64) -> Settling {
    let mut out = Settling::default();
    let end = series.last().map_or(0.0, |i| i.t_s);
    let truth_at = |t: f64| series.get(series.partition_point(|i| i.t_s < t)).map(|i| i.truth);
    for (index, &start) in changes.iter().enumerate() {
        let next = changes.get(index + 1).copied().unwrap_or(f64::INFINITY);
        let stop = next.min(start + PATIENCE_S).min(end);
        let (Some(before), Some(after)) = (truth_at(start - 0.1), truth_at((start + REACHED_S).min(stop - 0.1))) else {
            continue;
        };
        let size = (after - before).norm();
        let seen_before = series.first().is_some_and(|i| i.t_s < start - 0.1);
        if !seen_before || stop - start < 2.0 * QUIET_S || size < least {
            continue;
        }
        let mut span = series.iter().filter(|i| start <= i.t_s && i.t_s < stop);
        let last_wrong = span.rfind(|i| (i.estimate - i.truth).norm() > SHARE * size);
        match last_wrong {
            None => out.times_s.push(0.0),
            Some(i) if stop - i.t_s > QUIET_S => out.times_s.push(i.t_s - start),
            Some(_) => out.missed += 1,
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of 4 at 10 s, followed with a first-order lag.
    fn series(lag_s: f64) -> Vec<Instant> {
        (0..2000)
            .map(|i| {
                let t_s = f64::from(i) * 0.02;
                let after = t_s - 10.0;
                let truth = Vector3::x() * if after >= 0.0 { 4.0 } else { 0.0 };
                let estimate = Vector3::x() * if after >= 0.0 { 4.0 * (1.0 - (-after / lag_s).exp()) } else { 0.0 };
                Instant { t_s, truth, estimate }
            })
            .collect()
    }

    #[test]
    fn a_first_order_lag_settles_after_its_time() {
        // e^(−t/τ) = .2 after 1.609 τ
        let s = settle(&series(1.0), &[10.0], 0.5);
        assert!((s.median_s().unwrap() - 1.609).abs() < 0.03, "{s:?}");
        assert_eq!(settle(&series(20.0), &[10.0], 0.5).missed, 1);
    }

    #[test]
    fn small_changes_and_those_unseen_are_passed_over() {
        assert_eq!(settle(&series(1.0), &[10.0], 5.0), Settling::default());
        assert_eq!(settle(&series(1.0), &[0.0, 39.9], 0.5), Settling::default());
    }
}
