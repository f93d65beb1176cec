//! The asking side of TIMESYNC (111): how a vehicle's clock relates to ours.
//!
//! We send `tc1 = 0, ts1 = t₀`; the vehicle answers `tc1 = its clock, ts1 = t₀`. Received at t₁, the answer was made
//! somewhere between t₀ and t₁, so ours − theirs = (t₀ + t₁)/2 − tc1, wrong by at most half of the round trip.
//! Questions from the vehicle are left to whoever is its ground station.

use std::collections::VecDeque;

/// Time between two questions once the clocks are related, ns.
const PERIOD_NS: i64 = 1_000_000_000;
/// Time between two questions until then, ns.
const PERIOD_AT_START_NS: i64 = 200_000_000;
/// How many accepted samples relate the clocks.
const SETTLED_SAMPLES: u32 = 5;
/// An answer that took longer is not used, ns.
const LONGEST_ROUND_TRIP_NS: i64 = 2_000_000_000;
/// Round trips remembered to know what a quick one is.
const WINDOW: usize = 32;
/// A round trip may exceed the quickest in the window by this and still be used, ns.
const SLACK_NS: i64 = 500_000;
/// Weight of a new sample after the first ones have been averaged.
const GAIN: f64 = 0.1;
/// This many answers in a row that contradict the estimate mean that a clock was set or the vehicle rebooted.
const CONTRADICTIONS: u32 = 3;
/// Slack beyond half the round trip before an answer contradicts the estimate, ns: both clocks drift, and the boot
/// clock of some autopilots ticks in milliseconds.
const CONTRADICTION_SLACK_NS: i64 = 20_000_000;

/// How the vehicle's clock relates to ours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockOffset {
    /// Our clock minus the vehicle's boot clock, ns.
    pub ours_minus_theirs_ns: i64,
    /// The offset is off by no more than this, as long as the quickest round trip is recent, ns.
    pub uncertainty_ns: i64,
}

/// Asks one vehicle for its time and filters the answers. Time is passed in; nothing is sent from here.
#[derive(Debug, Clone, Default)]
pub struct TimesyncClient {
    /// The question that is still open: our clock when it was sent.
    asked_ns: Option<i64>,
    last_asked_ns: Option<i64>,
    /// (round trip, offset) of the last answers, oldest first.
    window: VecDeque<(i64, i64)>,
    offset_ns: f64,
    accepted: u32,
    contradictions: u32,
}

impl TimesyncClient {
    pub fn new() -> Self {
        Self { window: VecDeque::with_capacity(WINDOW), ..Self::default() }
    }

    /// The `ts1` of a question that is due at `now_ns` (our clock), to be sent at once with `tc1 = 0`.
    pub fn poll(&mut self, now_ns: i64) -> Option<i64> {
        let period = if self.accepted < SETTLED_SAMPLES { PERIOD_AT_START_NS } else { PERIOD_NS };
        // our own clock may be set back: then ask at once, the old question can no longer be timed
        let due = self.last_asked_ns.is_none_or(|last| now_ns < last || now_ns - last >= period);
        if !due {
            return None;
        }
        self.last_asked_ns = Some(now_ns);
        self.asked_ns = Some(now_ns);
        Some(now_ns)
    }

    /// Takes in a TIMESYNC of the vehicle, received at `now_ns`.
    ///
    /// Returns the new estimate if the message answers our open question and was quick enough to be used. Questions
    /// (`tc1 = 0`), answers to other stations and late answers change nothing.
    pub fn answer(&mut self, now_ns: i64, tc1: i64, ts1: i64) -> Option<ClockOffset> {
        if tc1 == 0 || self.asked_ns != Some(ts1) {
            return None;
        }
        self.asked_ns = None;
        let round_trip = now_ns.checked_sub(ts1)?;
        if !(0..=LONGEST_ROUND_TRIP_NS).contains(&round_trip) {
            return None;
        }
        // the midpoint first: ts1 + now would overflow for clocks far from zero
        let sample = (ts1 + round_trip / 2).checked_sub(tc1)?;

        if self.accepted > 0 {
            let distance = (sample as f64 - self.offset_ns).abs();
            if distance > (round_trip / 2 + CONTRADICTION_SLACK_NS) as f64 {
                self.contradictions += 1;
                if self.contradictions < CONTRADICTIONS {
                    return None;
                }
                self.reset();
                self.last_asked_ns = Some(ts1);
            }
        }
        self.contradictions = 0;

        if self.window.len() == WINDOW {
            self.window.pop_front();
        }
        self.window.push_back((round_trip, sample));
        if round_trip > self.quickest_ns() + SLACK_NS {
            return None;
        }
        self.accepted = self.accepted.saturating_add(1);
        let gain = GAIN.max(1.0 / f64::from(self.accepted));
        self.offset_ns += gain * (sample as f64 - self.offset_ns);
        self.offset()
    }

    /// The current estimate, once there is one.
    pub fn offset(&self) -> Option<ClockOffset> {
        (self.accepted > 0).then(|| ClockOffset {
            ours_minus_theirs_ns: self.offset_ns.round() as i64,
            uncertainty_ns: self.quickest_ns() / 2 + SLACK_NS,
        })
    }

    /// Forgets everything, after a reboot of the vehicle for example.
    pub fn reset(&mut self) {
        self.window.clear();
        *self = Self { window: std::mem::take(&mut self.window), ..Self::default() };
    }

    fn quickest_ns(&self) -> i64 {
        self.window.iter().map(|&(round_trip, _)| round_trip).min().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const MS: i64 = 1_000_000;

    /// A vehicle behind a link: its boot clock and the delays of the two directions.
    struct Vehicle {
        booted_ns: i64,
    }

    impl Vehicle {
        /// Asks once at `now`; the answer arrives after both delays.
        fn exchange(&self, client: &mut TimesyncClient, now: i64, there: i64, back: i64) -> Option<ClockOffset> {
            let ts1 = client.poll(now)?;
            client.answer(now + there + back, now + there - self.booted_ns, ts1)
        }
    }

    #[test]
    fn symmetric_delays_give_the_exact_offset() {
        let (mut client, vehicle) = (TimesyncClient::new(), Vehicle { booted_ns: 1_700_000_000 * 1_000 * MS });
        let start = vehicle.booted_ns + 5_000 * MS;
        let offset = vehicle.exchange(&mut client, start, 3 * MS, 3 * MS).expect("first answer counts");
        // f64 holds 1.7e18 to within 256
        assert!((offset.ours_minus_theirs_ns - vehicle.booted_ns).abs() <= 256);
        assert!(client.poll(start + 10 * MS).is_none(), "asks at most five times a second");
    }

    #[test]
    fn slow_answers_are_left_out_and_the_error_stays_within_its_bound() {
        let (mut client, vehicle) = (TimesyncClient::new(), Vehicle { booted_ns: 40_000 * MS });
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut now = 50_000 * MS;
        for _ in 0..200 {
            // a radio link: 5 ms each way at best, often queued for much longer on the way back
            let back =
                5 * MS + if rng.random_bool(0.6) { rng.random_range(0..200 * MS) } else { rng.random_range(0..MS) };
            vehicle.exchange(&mut client, now, 5 * MS + rng.random_range(0..MS / 2), back);
            now += 1_000 * MS;
        }
        let offset = client.offset().expect("there were quick answers");
        let error = (offset.ours_minus_theirs_ns - vehicle.booted_ns).abs();
        assert!(error < MS, "error {error} ns");
        assert!(error <= offset.uncertainty_ns);
    }

    #[test]
    fn only_answers_to_our_open_question_count() {
        let mut client = TimesyncClient::new();
        let ts1 = client.poll(1_000 * MS).expect("the first question is due at once");
        assert_eq!(client.answer(1_001 * MS, 0, ts1), None, "a question");
        assert_eq!(client.answer(1_001 * MS, 7 * MS, ts1 + 1), None, "an answer to another station");
        assert!(client.answer(1_002 * MS, 7 * MS, ts1).is_some());
        assert_eq!(client.answer(1_003 * MS, 8 * MS, ts1), None, "the same answer again");
        let ts1 = client.poll(2_000 * MS).expect("due");
        assert_eq!(client.answer(ts1 + LONGEST_ROUND_TRIP_NS + 1, 9 * MS, ts1), None, "too late");
    }

    #[test]
    fn a_reboot_is_noticed_after_three_answers() {
        let (mut client, mut vehicle) = (TimesyncClient::new(), Vehicle { booted_ns: 0 });
        let mut now = 100_000 * MS;
        for _ in 0..10 {
            vehicle.exchange(&mut client, now, MS, MS);
            now += 1_000 * MS;
        }
        vehicle.booted_ns = now - 10 * MS;
        let answers: Vec<_> = (0..4)
            .map(|i| vehicle.exchange(&mut client, now + i * 1_000 * MS, MS, MS).map(|o| o.ours_minus_theirs_ns))
            .collect();
        assert_eq!(answers, [None, None, Some(vehicle.booted_ns), Some(vehicle.booted_ns)]);
    }

    #[test]
    fn hostile_numbers_do_not_overflow() {
        for (tc1, ts1, now) in [(i64::MIN, i64::MAX, i64::MIN), (i64::MIN, 5, 6), (i64::MAX, -5, i64::MAX), (1, 0, 0)] {
            let mut client = TimesyncClient::new();
            client.asked_ns = Some(ts1);
            let _ = client.answer(now, tc1, ts1);
        }
    }
}
