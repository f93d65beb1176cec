use crate::signal::Stamp;

/// A test with a bounded delay and hysteresis: a fault is told once its residual has been beyond its admissible size
/// for `tell_s`, and clears once it has been below [`CALM`] of it for `clear_s`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Monitor {
    tell_s: f64,
    clear_s: f64,
    beyond_s: f64,
    calm_s: f64,
    onset: Option<Stamp>,
    active: bool,
}

/// Share of the admissible size below which a residual counts as calm.
const CALM: f64 = 0.6;

impl Monitor {
    pub fn new(tell_s: f64, clear_s: f64) -> Self {
        Self { tell_s, clear_s, beyond_s: 0.0, calm_s: 0.0, onset: None, active: false }
    }

    /// Takes in a residual's size over its admissible size, which held for the last `dt_s`.
    pub fn see(&mut self, ratio: f64, stamp: Stamp, dt_s: f64) {
        if ratio > 1.0 {
            self.onset.get_or_insert(stamp);
            self.beyond_s += dt_s;
            self.calm_s = 0.0;
            self.active |= self.beyond_s >= self.tell_s;
        } else {
            // one sample within does not undo what many showed
            self.beyond_s = (self.beyond_s - 2.0 * dt_s).max(0.0);
            self.calm_s = if ratio < CALM { self.calm_s + dt_s } else { 0.0 };
            if self.active && self.calm_s >= self.clear_s || !self.active && self.beyond_s == 0.0 {
                *self = Self::new(self.tell_s, self.clear_s);
            }
        }
    }

    pub fn forget(&mut self) {
        *self = Self::new(self.tell_s, self.clear_s);
    }

    pub fn active(&self) -> bool {
        self.active
    }

    /// When the residual left its bound, while the fault is active.
    pub fn onset(&self) -> Option<Stamp> {
        self.onset.filter(|_| self.active)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(m: &mut Monitor, from_ms: i64, to_ms: i64, ratio: f64) {
        (from_ms / 10..to_ms / 10).for_each(|k| m.see(ratio, Stamp::from_millis(10 * k), 0.01));
    }

    #[test]
    fn a_fault_is_told_after_its_delay_and_clears_after_calm() {
        let mut m = Monitor::new(0.1, 0.5);
        run(&mut m, 0, 1000, 0.9);
        run(&mut m, 1000, 1050, 1.5);
        assert!(!m.active());
        run(&mut m, 1050, 1200, 1.5);
        assert_eq!(m.onset(), Some(Stamp::from_millis(1000)));
        // between calm and beyond: stays
        run(&mut m, 1200, 3000, 0.8);
        assert!(m.active());
        run(&mut m, 3000, 3600, 0.1);
        assert!(!m.active() && m.onset().is_none());
    }

    #[test]
    fn short_bursts_do_not_add_up() {
        let mut m = Monitor::new(0.1, 0.5);
        for k in 0..20 {
            run(&mut m, 1000 * k, 1000 * k + 80, 3.0);
            run(&mut m, 1000 * k + 80, 1000 * (k + 1), 0.5);
            assert!(!m.active());
        }
    }
}
