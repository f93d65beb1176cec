use crate::signal::{Held, Stamp};
use crate::telemetry::history::History;

/// Hands each sample of a slow sensor to exactly one measurement as new, and holds it for the following ones.
///
/// Samples wait until a measurement reaches their instant. A repeated or late stamp is not a new sample: autopilots send
/// the same fix again until the receiver has another.
#[derive(Debug, Clone)]
pub(super) struct Latest<T> {
    waiting: History<T, 16>,
    held: Option<(Stamp, T)>,
    sequence: u32,
}

impl<T> Default for Latest<T>
where
    T: Copy,
{
    fn default() -> Self {
        Self { waiting: History::default(), held: None, sequence: 0 }
    }
}

impl<T: Copy> Latest<T> {
    pub fn push(&mut self, stamp: Stamp, value: T) {
        if self.held.is_none_or(|(s, _)| stamp > s) {
            self.waiting.push(stamp, value);
        }
    }

    /// When the newest sample that has come was true.
    pub fn newest(&self) -> Option<Stamp> {
        self.waiting.newest().or(self.held).map(|x| x.0)
    }

    /// The newest sample at or before `t`, unless it is older than `limit_s`. `t` must not go back.
    pub fn at(&mut self, t: Stamp, limit_s: f64) -> Option<Held<T>> {
        let before = self.sequence;
        while let Some((stamp, value)) = self.waiting.take_oldest_until(t) {
            self.held = Some((stamp, value));
            self.sequence = self.sequence.saturating_add(1);
        }
        let (stamp, value) = self.held?;
        let age_s = t - stamp;
        let new = self.sequence != before;
        (new || age_s < limit_s).then_some(Held { value, stamp, age_s, sequence: self.sequence, new })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ms(t: i64) -> Stamp {
        Stamp::from_millis(t)
    }

    #[test]
    fn a_sample_is_new_once_and_not_before_its_instant() {
        let mut l = Latest::<i64>::default();
        l.push(ms(30), 3);
        assert_eq!(l.at(ms(20), 1.0), None);
        let first = l.at(ms(40), 1.0).unwrap();
        assert!(first.new && first.value == 3 && first.sequence == 1 && (first.age_s - 0.01).abs() < 1e-12);
        l.push(ms(30), 3);
        assert!(!l.at(ms(60), 1.0).unwrap().new, "the same stamp again");
        assert_eq!(l.at(ms(2000), 1.0), None, "too old");
    }

    proptest! {
        #[test]
        fn each_sample_is_new_at_most_once(stamps in prop::collection::vec(0i64..400, 1..12)) {
            let mut l = Latest::<i64>::default();
            let mut seen = Vec::new();
            for s in &stamps {
                l.push(ms(*s), *s);
            }
            for t in (0..500).step_by(7) {
                if let Some(h) = l.at(ms(t), 10.0) {
                    prop_assert!(h.value <= t);
                    if h.new {
                        seen.push(h.value);
                    }
                }
            }
            prop_assert!(seen.windows(2).all(|w| w[0] < w[1]));
            prop_assert_eq!(seen.last(), stamps.iter().max());
        }
    }
}
