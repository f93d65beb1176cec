use super::catalog::CATALOG;

/// When each stream of the catalogue is sent next. Slot for slot beside it.
#[derive(Debug)]
pub(super) struct Schedule {
    slots: Vec<Slot>,
}

#[derive(Debug, Clone, Copy)]
struct Slot {
    /// 0: not sent.
    interval_us: u64,
    next_us: u64,
}

impl Schedule {
    /// With a rate for each stream of the catalogue, Hz.
    pub fn new(rate_hz: impl Fn(&super::catalog::Stream) -> f64) -> Self {
        let slot = |s| Slot { interval_us: interval_us(rate_hz(s)), next_us: 0 };
        Self { slots: CATALOG.iter().map(slot).collect() }
    }

    pub fn set_hz(&mut self, index: usize, hz: f64) {
        self.set_interval_us(index, interval_us(hz));
    }

    pub fn set_interval_us(&mut self, index: usize, interval_us: u64) {
        if let Some(slot) = self.slots.get_mut(index) {
            slot.interval_us = interval_us;
        }
    }

    pub fn interval_us(&self, index: usize) -> u64 {
        self.slots.get(index).map_or(0, |s| s.interval_us)
    }

    /// True when stream `index` is due, and then moves it on. `slowdown` stretches every interval but the heartbeat's.
    /// Instants keep their grid; what was missed is not made up for.
    pub fn due(&mut self, index: usize, now_us: u64, slowdown: u64) -> bool {
        let Some(slot) = self.slots.get_mut(index) else { return false };
        if slot.interval_us == 0 || now_us < slot.next_us {
            return false;
        }
        let interval = if index == 0 { slot.interval_us } else { slot.interval_us * slowdown };
        slot.next_us += interval;
        if slot.next_us <= now_us {
            slot.next_us = now_us + interval;
        }
        true
    }

    /// After a reboot: due at once.
    pub fn restart(&mut self) {
        self.slots.iter_mut().for_each(|s| s.next_us = 0);
    }
}

fn interval_us(hz: f64) -> u64 {
    if hz > 0.0 { (1e6 / hz).round() as u64 } else { 0 }
}
