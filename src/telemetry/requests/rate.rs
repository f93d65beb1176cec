/// Arrivals per second over the last whole slots.
#[derive(Debug)]
pub(super) struct RateMeter {
    started_ms: u64,
    /// Slot in which `counts[0]` was counted.
    slot: u64,
    /// Newest first; `[0]` is still filling.
    counts: [u32; Self::SLOTS + 1],
}

impl RateMeter {
    const SLOTS: usize = 10;
    const SLOT_MS: u64 = 500;

    pub fn new(now_ms: u64) -> Self {
        Self { started_ms: now_ms, slot: now_ms / Self::SLOT_MS, counts: [0; Self::SLOTS + 1] }
    }

    fn advance(&mut self, now_ms: u64) {
        let slot = now_ms / Self::SLOT_MS;
        let length = self.counts.len();
        let moved = usize::try_from(slot.saturating_sub(self.slot)).unwrap_or(length).min(length);
        self.counts.rotate_right(moved % length);
        self.counts[..moved].fill(0);
        self.slot = self.slot.max(slot);
    }

    pub fn count(&mut self, now_ms: u64) {
        self.advance(now_ms);
        self.counts[0] = self.counts[0].saturating_add(1);
    }

    /// Did anything come lately?
    pub fn flows(&mut self, now_ms: u64) -> bool {
        self.advance(now_ms);
        self.counts[0] > 0 || self.counts[1] > 0
    }

    pub fn hz(&mut self, now_ms: u64) -> f64 {
        self.advance(now_ms);
        let age_ms = now_ms.saturating_sub(self.started_ms);
        let whole = (self.slot * Self::SLOT_MS).saturating_sub(self.started_ms).min(Self::SLOTS as u64 * Self::SLOT_MS);
        if whole == 0 || age_ms < Self::SLOT_MS {
            return 0.0;
        }
        f64::from(self.counts[1..].iter().sum::<u32>()) * 1e3 / whole as f64
    }
}
