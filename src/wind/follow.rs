/// How much wind wanders when nothing special happens, m²/s³: its variance grows by this each second.
const WANDER: f64 = 0.01;
/// Time over which the noise of the instants is measured, s.
const NOISE_S: f64 = 2.0;
/// Share of the newest difference in its running mean, and how many deviations that mean must reach to be a gust.
const NEWEST: f64 = 0.4;
const GUST_SIGMAS: f64 = 4.0;
/// Gain while a gust is followed.
const GUST_GAIN: f64 = 0.7;

/// Follows one component of the wind through noisy instants: a Kalman filter of a random walk with its steady gain,
/// whose measurement noise is the declared one or what shows between neighbouring instants, whichever is more. When the
/// instants stay off by more than noise explains, it lets go and catches up.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Follower {
    value: f64,
    last: f64,
    /// Mean square of half the difference between neighbouring instants.
    shown: f64,
    off: f64,
}

impl Follower {
    pub fn start(&mut self, instant: f64) {
        *self = Self { value: instant, last: instant, shown: 0.0, off: 0.0 };
    }

    /// Takes in an instant with the standard deviation that is declared of it; gives the wind.
    pub fn step(&mut self, instant: f64, declared: f64, dt_s: f64) -> f64 {
        let jump = instant - self.last;
        self.last = instant;
        let fresh = 1.0 - (-dt_s / NOISE_S).exp();
        self.shown += fresh * (0.5 * jump * jump - self.shown);
        let variance = (declared * declared).max(self.shown).max(1e-9);
        let off = instant - self.value;
        self.off += NEWEST * (off - self.off);
        // bandwidth √(q/(σ²Δ)), the steady Kalman gain in continuous time
        let steady = 1.0 - (-(WANDER * dt_s / variance).sqrt()).exp();
        let gust = self.off.abs() > GUST_SIGMAS * variance.sqrt();
        self.value += off * if gust { steady.max(GUST_GAIN) } else { steady };
        self.value
    }

    pub fn value(&self) -> f64 {
        self.value
    }

    /// Moves the answer into an interval that is known to hold the wind.
    pub fn clamp(&mut self, lo: f64, hi: f64) {
        self.value = self.value.max(lo).min(hi);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    #[test]
    fn noise_is_smoothed_and_a_gust_is_followed_at_once() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut follower = Follower::default();
        follower.start(0.0);
        let (mut errors, mut late) = (Vec::new(), 0);
        for k in 0..4000 {
            let wind = if k < 2000 { 0.0 } else { 6.0 };
            let value = follower.step(wind + 0.8 * rng.sample::<f64, _>(StandardNormal), 0.4, 0.01);
            if (500..2000).contains(&k) || k > 2500 {
                errors.push((value - wind).powi(2));
            }
            late += i32::from(k >= 2000 && (value - wind).abs() > 1.5);
        }
        let rmse = (errors.iter().sum::<f64>() / errors.len() as f64).sqrt();
        assert!(rmse < 0.2, "{rmse} of 0.8");
        assert!(late < 20, "{late} steps");
    }
}
