use super::bank::FaultBank;

/// How much of the thrust that is asked of it a rotor gives, over all its time in controlled flight.
///
/// Told by the torque that the rotors' model leaves about roll and pitch, each rotor taken for the only weak one. So a
/// weak rotor makes the one across from it look strong, and a load beside the middle looks like a weak rotor for as long
/// as it hangs there: what wears is what changes from flight to flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotorHealth {
    /// Mean effectiveness; 1 is what the model says.
    pub mean: f64,
    /// The least, gusts of less than five seconds left out.
    pub least: f64,
    /// For how long it was looked at, s.
    pub observed_s: f64,
}

/// Gusts that pass within this time do not count, s.
const SMOOTHED_S: f64 = 5.0;

/// The running account of one rotor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Account {
    smoothed: f64,
    sum: f64,
    least: f64,
    observed_s: f64,
}

impl Account {
    pub fn new() -> Self {
        Self { smoothed: 1.0, sum: 0.0, least: f64::INFINITY, observed_s: 0.0 }
    }

    /// The effectiveness of the last `dt_s` seconds.
    pub fn see(&mut self, effectiveness: f64, dt_s: f64) {
        // a plain mean until the first seconds are full, so that it begins nowhere
        self.observed_s += dt_s;
        self.smoothed += (effectiveness - self.smoothed) * (dt_s / SMOOTHED_S.min(self.observed_s)).min(1.0);
        self.sum += effectiveness * dt_s;
        if self.observed_s >= SMOOTHED_S {
            self.least = self.least.min(self.smoothed);
        }
    }

    /// `None` before the first seconds have passed.
    fn health(&self) -> Option<RotorHealth> {
        (self.observed_s >= SMOOTHED_S).then(|| RotorHealth {
            mean: self.sum / self.observed_s,
            least: self.least,
            observed_s: self.observed_s,
        })
    }
}

impl FaultBank {
    /// The health of each rotor, in the model's order; empty until all were seen in flight.
    pub fn rotor_health(&self) -> Vec<RotorHealth> {
        self.rotors.accounts().iter().map(Account::health).collect::<Option<_>>().unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_and_what_was_worst_for_seconds() {
        let mut account = Account::new();
        for _ in 0..400 {
            account.see(0.9, 0.01);
        }
        assert_eq!(account.health(), None, "four seconds are too few");
        for _ in 0..9_600 {
            account.see(0.9, 0.01);
        }
        // a dip of a tenth of a second does not count, one of ten does
        (0..10).for_each(|_| account.see(0.0, 0.01));
        let brief = account.health().expect("seen for long");
        assert!((brief.mean - 0.9).abs() < 2e-3 && brief.least > 0.88, "{brief:?}");
        (0..1_000).for_each(|_| account.see(0.6, 0.01));
        let long = account.health().expect("seen for long");
        assert!(long.least > 0.6 && long.least < 0.65, "{long:?}");
    }
}
