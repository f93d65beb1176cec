use crate::signal::Stamp;

/// The last `N` samples of one channel in time order, for looking up what held at an instant in the recent past.
///
/// A sample older than the newest is put in its place; one with the stamp of a sample already held replaces it.
#[derive(Debug, Clone)]
pub struct History<T, const N: usize> {
    items: [Option<(Stamp, T)>; N],
    len: usize,
}

/// Where an instant lies among the samples held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lookup<T> {
    /// Between two samples: both, and the share of the way from the first to the second.
    Between(T, T, f64),
    /// After the newest, by this many seconds.
    After(T, f64),
    /// Before the oldest, by this many seconds.
    Before(T, f64),
}

impl<T: Copy, const N: usize> Default for History<T, N> {
    fn default() -> Self {
        Self { items: [None; N], len: 0 }
    }
}

impl<T: Copy, const N: usize> History<T, N> {
    pub fn newest(&self) -> Option<(Stamp, T)> {
        self.iter().last()
    }

    pub fn push(&mut self, stamp: Stamp, value: T) {
        if let Some(old) = self.items.iter_mut().flatten().find(|(s, _)| *s == stamp) {
            old.1 = value;
            return;
        }
        if self.len == N {
            if self.items[0].is_some_and(|(s, _)| stamp < s) {
                return;
            }
            self.items.rotate_left(1);
            self.len -= 1;
        }
        let mut i = self.len;
        while i > 0 && self.items[i - 1].is_some_and(|(s, _)| s > stamp) {
            self.items[i] = self.items[i - 1];
            i -= 1;
        }
        self.items[i] = Some((stamp, value));
        self.len += 1;
    }

    /// Takes out the oldest sample, if it is not after `t`.
    pub fn take_oldest_until(&mut self, t: Stamp) -> Option<(Stamp, T)> {
        let oldest = self.items[..self.len].first().copied().flatten().filter(|(s, _)| *s <= t)?;
        self.items[0] = None;
        self.items[..self.len].rotate_left(1);
        self.len -= 1;
        Some(oldest)
    }

    /// Oldest first.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = (Stamp, T)> + '_ {
        self.items[..self.len].iter().flatten().copied()
    }

    pub fn at(&self, t: Stamp) -> Option<Lookup<T>> {
        let (newest, last) = self.newest()?;
        if t >= newest {
            return Some(Lookup::After(last, t - newest));
        }
        let mut later = (newest, last);
        for (s, x) in self.iter().rev().skip(1) {
            if s <= t {
                return Some(Lookup::Between(x, later.1, (t - s) / (later.0 - s)));
            }
            later = (s, x);
        }
        Some(Lookup::Before(later.1, later.0 - t))
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
    fn looks_up_between_before_and_after() {
        let mut h = History::<f64, 4>::default();
        assert_eq!(h.at(ms(0)), None);
        h.push(ms(10), 1.0);
        h.push(ms(30), 3.0);
        h.push(ms(20), 2.0);
        assert_eq!(h.at(ms(25)), Some(Lookup::Between(2.0, 3.0, 0.5)));
        assert_eq!(h.at(ms(30)), Some(Lookup::After(3.0, 0.0)));
        assert_eq!(h.at(ms(5)), Some(Lookup::Before(1.0, 0.005)));
    }

    proptest! {
        #[test]
        fn always_holds_the_newest_in_order(stamps in prop::collection::vec(0i64..50, 1..40)) {
            let mut h = History::<i64, 8>::default();
            for s in &stamps {
                h.push(ms(*s), *s);
            }
            let held: Vec<i64> = h.iter().map(|(_, x)| x).collect();
            prop_assert!(held.windows(2).all(|w| w[0] < w[1]));
            prop_assert_eq!(held.last(), stamps.iter().max());
        }
    }
}
