use super::Rate;

/// Lets messages through at a rate. Time comes from the messages' receive stamps, in µs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limiter {
    period_us: Option<u64>,
    next_us: u64,
}

impl Limiter {
    pub(super) fn new(rate: Rate) -> Self {
        Self { period_us: rate.period_us(), next_us: 0 }
    }

    /// True if a message may go at `now_us`, which then counts as sent.
    ///
    /// The schedule is kept, so that input at 50 Hz with jitter gives 10 Hz and not 8.3; after a pause, or when the
    /// clock was set back, it begins anew.
    pub(super) fn pass(&mut self, now_us: u64) -> bool {
        let Some(period) = self.period_us else { return false };
        let clock_went_back = self.next_us > now_us.saturating_add(period.saturating_mul(2));
        if now_us < self.next_us && !clock_went_back {
            return false;
        }
        let on_schedule = now_us >= self.next_us && now_us - self.next_us < period;
        self.next_us = if on_schedule { self.next_us } else { now_us }.saturating_add(period);
        true
    }

    /// Makes the next message due at once.
    pub(super) fn hasten(&mut self) {
        self.next_us = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn passed(rate: Rate, times_us: impl IntoIterator<Item = u64>) -> usize {
        let mut limiter = Limiter::new(rate);
        times_us.into_iter().filter(|&t| limiter.pass(t)).count()
    }

    #[test]
    fn jitter_does_not_lower_the_rate() {
        // 50 Hz for 10 s, every other message 9 ms late
        let times = (0..500).map(|k| 1_700_000_000_000_000 + k * 20_000 + (k % 2) * 9_000);
        let count = passed(Rate::hz(10.0), times);
        assert!((99..=101).contains(&count), "{count}");
    }

    #[test]
    fn off_sends_nothing_and_every_sends_all() {
        assert_eq!(passed(Rate::OFF, 0..100), 0);
        assert_eq!(passed(Rate::EVERY, [5, 5, 6, 3, 1_000]), 5);
    }

    #[test]
    fn a_clock_set_back_does_not_silence_it() {
        let times = [1_000_000_000_u64, 5_000_000, 5_050_000, 5_100_000];
        assert_eq!(passed(Rate::hz(10.0), times), 3);
    }

    proptest! {
        #[test]
        fn never_above_the_rate(gaps in prop::collection::vec(0_u64..400_000, 1..300), hz in 0.5_f64..50.0) {
            let mut now = 10_000_000;
            let times: Vec<u64> = gaps.iter().map(|gap| { now += gap; now }).collect();
            let span_s = (times[times.len() - 1] - times[0]) as f64 * 1e-6;
            let count = passed(Rate::hz(hz), times);
            // one to begin with, and one more where the schedule catches up with a late message
            prop_assert!(count as f64 <= span_s * hz + 2.0, "{count} in {span_s} s at {hz} Hz");
        }
    }
}
