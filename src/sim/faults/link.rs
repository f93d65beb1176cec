use crate::sim::random::Random;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// What a radio does to frames. Probabilities per frame, 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LinkTrouble {
    pub loss: f64,
    pub duplicate: f64,
    /// One byte is changed.
    pub corrupt: f64,
    /// Every frame is late by this, s...
    pub delay_s: f64,
    /// ...and by up to this more, s. Frames overtake each other only with `reorder`.
    pub jitter_s: f64,
    /// Chance that a frame may be overtaken.
    pub reorder: f64,
}

/// A link that loses, doubles, delays, reorders and damages frames. Bounded: it holds at most as many frames as
/// `capacity`, and drops the newest beyond that.
#[derive(Debug)]
pub struct TroubledLink {
    random: Random,
    waiting: BinaryHeap<Reverse<Waiting>>,
    capacity: usize,
    count: u64,
    latest_ns: i64,
    dropped: u64,
}

#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Waiting {
    at_ns: i64,
    /// Keeps the order of frames that arrive together.
    count: u64,
    bytes: Vec<u8>,
}

impl TroubledLink {
    pub fn new(random: Random, capacity: usize) -> Self {
        Self { random, waiting: BinaryHeap::new(), capacity, count: 0, latest_ns: i64::MIN, dropped: 0 }
    }

    /// Sends the bytes of one frame at `now_s`.
    pub fn push(&mut self, bytes: &[u8], trouble: &LinkTrouble, now_s: f64) {
        if self.random.chance(trouble.loss) {
            self.dropped += 1;
            return;
        }
        let copies = if self.random.chance(trouble.duplicate) { 2 } else { 1 };
        for _ in 0..copies {
            if self.waiting.len() >= self.capacity {
                self.dropped += 1;
                continue;
            }
            let mut bytes = bytes.to_vec();
            if self.random.chance(trouble.corrupt) {
                let (at, flip) = (self.random.below(bytes.len()), 1 + self.random.below(255) as u8);
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= flip;
                }
            }
            let late = trouble.delay_s + self.random.between(0.0, trouble.jitter_s);
            let mut at_ns = ((now_s + late) * 1e9) as i64;
            if !self.random.chance(trouble.reorder) {
                at_ns = at_ns.max(self.latest_ns);
                self.latest_ns = at_ns;
            }
            self.count += 1;
            self.waiting.push(Reverse(Waiting { at_ns, count: self.count, bytes }));
        }
    }

    /// The next frame that has arrived by `now_s`.
    pub fn pop(&mut self, now_s: f64) -> Option<Vec<u8>> {
        let ready = self.waiting.peek().is_some_and(|Reverse(w)| w.at_ns <= (now_s * 1e9) as i64);
        if ready { self.waiting.pop().map(|Reverse(w)| w.bytes) } else { None }
    }

    /// Frames lost so far.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::random::Part;

    fn run(trouble: LinkTrouble) -> Vec<Vec<u8>> {
        let mut link = TroubledLink::new(Random::new(5, 1, Part::Link), 1000);
        let mut out = Vec::new();
        for i in 0..1000_u32 {
            let t = f64::from(i) * 0.01;
            link.push(&i.to_be_bytes(), &trouble, t);
            while let Some(b) = link.pop(t) {
                out.push(b);
            }
        }
        while let Some(b) = link.pop(1e3) {
            out.push(b);
        }
        out
    }

    fn number(b: &[u8]) -> u32 {
        u32::from_be_bytes(b.try_into().unwrap())
    }

    #[test]
    fn a_healthy_link_changes_nothing() {
        let out = run(LinkTrouble::default());
        assert!(out.iter().map(|b| number(b)).eq(0..1000));
        let late = run(LinkTrouble { delay_s: 0.2, jitter_s: 0.1, ..LinkTrouble::default() });
        assert!(late.iter().map(|b| number(b)).eq(0..1000), "delay and jitter alone keep the order");
    }

    #[test]
    fn each_trouble_does_its_share() {
        let lost = run(LinkTrouble { loss: 0.2, ..LinkTrouble::default() }).len();
        assert!((750..850).contains(&lost), "{lost}");
        let doubled = run(LinkTrouble { duplicate: 0.1, ..LinkTrouble::default() }).len();
        assert!((1070..1130).contains(&doubled), "{doubled}");
        let corrupt = run(LinkTrouble { corrupt: 0.3, ..LinkTrouble::default() });
        let changed = corrupt.iter().zip(0..1000).filter(|(b, i)| number(b) != *i).count();
        assert!((250..350).contains(&changed), "{changed}");
        let mixed = run(LinkTrouble { reorder: 1.0, jitter_s: 0.05, ..LinkTrouble::default() });
        assert!(mixed.windows(2).filter(|w| number(&w[0]) > number(&w[1])).count() > 100);
        assert_eq!(mixed.len(), 1000);
    }
}
