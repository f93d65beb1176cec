/// Slower messages are left as they are, Hz: all of them together fill no link.
const FAST_HZ: f64 = 4.0;
/// Below this part of what was asked for a message comes too slowly.
const SHORT: f64 = 0.85;
/// A larger part must come once less is asked for: else the link loses frames whatever is asked for.
const HELPED: f64 = 0.1;
/// Beside one slow message there may be another reason; from so many on it is the link.
const SEVERAL: usize = 2;
/// Part of what the link was seen to carry that is asked for: it needs room for the rest.
const MARGIN: f64 = 0.95;
const LEAST: f64 = 0.05;
/// How much more is tried, and after how long; twice as long after every try that failed.
const RAISE: f64 = 1.5;
const FIRST_REST_MS: u64 = 60_000;
const LONGEST_REST_MS: u64 = 960_000;

pub(super) fn is_fast(hz: f64) -> bool {
    hz > FAST_HZ
}

/// What came of what was asked for.
#[derive(Debug, Default)]
pub(super) struct Observed {
    asked_hz: f64,
    came_hz: f64,
    short: usize,
}

impl Observed {
    /// One granted message. What does not come at all says nothing of the link.
    pub fn add(&mut self, asked_hz: f64, came_hz: f64) {
        if is_fast(asked_hz) && came_hz > 0.0 {
            self.asked_hz += asked_hz;
            self.came_hz += came_hz.min(asked_hz);
            self.short += usize::from(came_hz < SHORT * asked_hz);
        }
    }
}

/// Which part of the wanted rates is asked for.
#[derive(Debug)]
pub(super) struct Pace {
    factor: f64,
    changed_ms: u64,
    rest_ms: u64,
    /// The part that came before the last slowing.
    before: Option<f64>,
    /// Slowing does not help here.
    lossy: bool,
}

impl Default for Pace {
    fn default() -> Self {
        Self { factor: 1.0, changed_ms: 0, rest_ms: FIRST_REST_MS, before: None, lossy: false }
    }
}

impl Pace {
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// The rate to ask for where this one is wanted, Hz.
    pub fn of(&self, wanted_hz: f64) -> f64 {
        if is_fast(wanted_hz) { (wanted_hz * self.factor).max(FAST_HZ) } else { wanted_hz }
    }

    /// Learns from rates that have settled; true if they are to be asked for anew.
    pub fn adapt(&mut self, observed: &Observed, now_ms: u64) -> bool {
        let share = if observed.asked_hz > 0.0 { observed.came_hz / observed.asked_hz } else { 1.0 };
        if observed.short >= SEVERAL && share < SHORT && self.factor > LEAST && !self.lossy {
            if self.before.is_some_and(|before| share < before + HELPED) {
                *self = Self { lossy: true, ..Self::default() };
                return true;
            }
            self.before = Some(share);
            if self.changed_ms > 0 && now_ms.saturating_sub(self.changed_ms) < FIRST_REST_MS {
                // more was tried, or the link got worse: longer until the next try
                self.rest_ms = (self.rest_ms * 2).min(LONGEST_REST_MS);
            }
            self.factor = (self.factor * share * MARGIN).max(LEAST);
            self.changed_ms = now_ms;
            return true;
        }
        if self.factor < 1.0 && now_ms.saturating_sub(self.changed_ms) >= self.rest_ms {
            self.factor = (self.factor * RAISE).min(1.0);
            self.changed_ms = now_ms;
            self.before = None;
            return true;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn observed(rates: &[(f64, f64)]) -> Observed {
        let mut all = Observed::default();
        rates.iter().for_each(|&(asked, came)| all.add(asked, came));
        all
    }

    #[test]
    fn a_full_link_slows_all_down_to_what_it_carries_and_one_slow_message_does_not() {
        let mut pace = Pace::default();
        assert!(!pace.adapt(&observed(&[(50.0, 20.0), (50.0, 49.0), (50.0, 50.0)]), 1_000), "one is slow by itself");
        assert!(!pace.adapt(&observed(&[(50.0, 0.0), (50.0, 0.0)]), 1_000), "silent ones are no sign");
        assert!(pace.adapt(&observed(&[(50.0, 20.0), (50.0, 20.0), (1.0, 0.2)]), 1_000));
        assert!((pace.of(50.0) - 19.0).abs() < 1e-9);
        assert_eq!(pace.of(1.0), 1.0);
    }

    #[test]
    fn a_link_that_loses_a_fifth_of_whatever_is_sent_is_not_slowed() {
        let mut pace = Pace::default();
        for second in 1..600 {
            let asked = pace.of(50.0);
            pace.adapt(&observed(&[(asked, 0.8 * asked), (asked, 0.8 * asked)]), 1_000 * second);
        }
        assert_eq!(pace.of(50.0), 50.0);
    }

    #[test]
    fn more_is_tried_ever_later() {
        let (mut pace, mut now_ms, mut tries) = (Pace::default(), 1_000, Vec::new());
        // the link carries 20 Hz of each for ever
        for _ in 0..3_600 {
            let asked = pace.of(50.0);
            if pace.adapt(&observed(&[(asked, asked.min(20.0)), (asked, asked.min(20.0))]), now_ms) && asked < 20.0 {
                tries.push(now_ms);
            }
            now_ms += 1_000;
        }
        assert!((3..12).contains(&tries.len()), "{tries:?}");
        assert!(tries.windows(3).all(|t| t[2] - t[1] >= t[1] - t[0]), "{tries:?}");
    }

    #[test]
    fn a_link_that_recovers_gets_all_again() {
        let mut pace = Pace::default();
        assert!(pace.adapt(&observed(&[(50.0, 10.0), (50.0, 10.0)]), 1_000));
        let mut now_ms = 1_000;
        while now_ms < 900_000 {
            now_ms += 1_000;
            let asked = pace.of(50.0);
            pace.adapt(&observed(&[(asked, asked), (asked, asked)]), now_ms);
        }
        assert_eq!(pace.factor(), 1.0);
    }
}
