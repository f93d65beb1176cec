/// Time constant of the averages, s: a change of rate shows after a few seconds.
const MEMORY_S: f64 = 5.0;

/// How regularly something arrives: rate, jitter, longest silence.
///
/// Intervals between arrivals are averaged with a weight that fades with age (time constant 5 s), so bursts count with
/// the pause before them and the rate of a bursty stream comes out right.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Cadence {
    count: u64,
    first_us: u64,
    last_us: u64,
    longest_us: u64,
    // sums over intervals, each with its faded weight: 1, interval (s), interval²
    weight: f64,
    sum: f64,
    sum_of_squares: f64,
}

impl Cadence {
    /// Something arrived. Time that goes back counts as no time.
    pub(super) fn tick(&mut self, now_us: u64) {
        if self.count == 0 {
            self.first_us = now_us;
        } else {
            let interval_us = now_us.saturating_sub(self.last_us);
            self.longest_us = self.longest_us.max(interval_us);
            let interval = interval_us as f64 * 1e-6;
            let fade = (-interval / MEMORY_S).exp();
            self.weight = self.weight * fade + 1.0;
            self.sum = self.sum * fade + interval;
            self.sum_of_squares = self.sum_of_squares * fade + interval * interval;
        }
        self.count += 1;
        self.last_us = now_us;
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// When it was last seen, µs.
    pub fn last_us(&self) -> Option<u64> {
        (self.count > 0).then_some(self.last_us)
    }

    /// Longest time between two arrivals, s.
    pub fn longest_silence_s(&self) -> f64 {
        self.longest_us as f64 * 1e-6
    }

    /// Arrivals per second, lately. Falls when nothing comes any more; 0 before the second arrival.
    pub fn rate_hz(&self, now_us: u64) -> f64 {
        let mean = self.mean_interval_s();
        let silence = now_us.saturating_sub(self.last_us) as f64 * 1e-6;
        if mean > 0.0 { 1.0 / mean.max(silence) } else { 0.0 }
    }

    /// Arrivals per second from the first to the last; 0 before the second arrival.
    pub fn mean_rate_hz(&self) -> f64 {
        let span = self.last_us.saturating_sub(self.first_us) as f64 * 1e-6;
        if span > 0.0 { (self.count - 1) as f64 / span } else { 0.0 }
    }

    /// Standard deviation of the recent intervals, s.
    pub fn jitter_s(&self) -> f64 {
        if self.weight == 0.0 {
            return 0.0;
        }
        let mean = self.mean_interval_s();
        (self.sum_of_squares / self.weight - mean * mean).max(0.0).sqrt()
    }

    fn mean_interval_s(&self) -> f64 {
        if self.weight > 0.0 { self.sum / self.weight } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrivals(times_us: impl IntoIterator<Item = u64>) -> Cadence {
        let mut cadence = Cadence::default();
        for t in times_us {
            cadence.tick(t);
        }
        cadence
    }

    #[test]
    fn a_steady_stream_has_its_rate_and_no_jitter() {
        let cadence = arrivals((0..500).map(|i| i * 20_000));
        let now = 499 * 20_000;
        assert!((cadence.rate_hz(now) - 50.0).abs() < 1e-6);
        assert!((cadence.mean_rate_hz() - 50.0).abs() < 1e-6);
        assert!(cadence.jitter_s() < 1e-6);
        // and the rate falls once it has stopped
        assert!((cadence.rate_hz(now + 2_000_000) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn bursts_keep_the_rate_and_show_as_jitter() {
        let cadence = arrivals((0..1000u64).map(|i| (i / 10) * 100_000));
        assert!((cadence.rate_hz(99 * 100_000) - 100.0).abs() < 2.0);
        assert!((cadence.jitter_s() - 0.03).abs() < 0.002);
    }

    #[test]
    fn a_new_rate_is_learnt_within_seconds() {
        let slow = (0..100u64).map(|i| i * 100_000);
        let fast = (1..1500u64).map(|i| 9_900_000 + i * 20_000);
        let cadence = arrivals(slow.chain(fast));
        assert!((cadence.rate_hz(9_900_000 + 1499 * 20_000) - 50.0).abs() < 0.5);
    }

    #[test]
    fn one_arrival_has_no_rate() {
        assert_eq!(arrivals([7]).rate_hz(8), 0.0);
        assert_eq!(Cadence::default().jitter_s(), 0.0);
        assert_eq!(arrivals([9, 3]).longest_silence_s(), 0.0);
    }
}
