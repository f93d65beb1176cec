use nalgebra::{UnitQuaternion, Vector3};

/// Attitudes that are kept.
const KEPT: usize = 32;
/// Shortest time over which attitude differences are a rate, s.
const WINDOW_S: f64 = 0.05;
/// Time over which the error is averaged, s.
const MEMORY_S: f64 = 2.0;
/// Comparisons before anything is claimed.
const ENOUGH: u32 = 20;

/// How far the estimated rates are from what the attitude did, in hindsight.
///
/// A second or two late, the turn between two attitudes tells the mean rate between them without any model. Its
/// difference from the mean of the estimates over the same time is the estimates' error, less what averages out and
/// plus the attitude's own noise. Its root mean square is what the observer may claim: a statistic, no guarantee.
#[derive(Debug, Clone)]
pub(super) struct Monitor {
    ring: [(f64, UnitQuaternion<f64>, Vector3<f64>); KEPT],
    /// Where the next one goes, and how many there are.
    next: usize,
    count: usize,
    mean_square: Vector3<f64>,
    comparisons: u32,
}

impl Monitor {
    pub(super) fn new() -> Self {
        Self {
            ring: [(0.0, UnitQuaternion::identity(), Vector3::zeros()); KEPT],
            next: 0,
            count: 0,
            mean_square: Vector3::zeros(),
            comparisons: 0,
        }
    }

    /// Takes in an attitude with the rates estimated for the `dt_s` since the one before it, rad/s.
    pub(super) fn see(&mut self, dt_s: f64, attitude: UnitQuaternion<f64>, rate: Vector3<f64>) {
        self.ring[self.next] = (dt_s, attitude, rate);
        self.next = (self.next + 1) % KEPT;
        self.count = (self.count + 1).min(KEPT);
        let (mut span, mut turned) = (0.0, Vector3::zeros());
        for back in 0..self.count {
            let (dt, earlier, mean) = self.ring[(self.next + 2 * KEPT - 1 - back) % KEPT];
            if span >= WINDOW_S {
                let shown = (earlier.inverse() * attitude).scaled_axis() / span;
                let error = shown - turned / span;
                self.comparisons = self.comparisons.saturating_add(1);
                // a plain mean at first, then one that forgets
                let weight = (dt_s / MEMORY_S).max(1.0 / f64::from(self.comparisons));
                self.mean_square += (error.component_mul(&error) - self.mean_square) * weight.min(1.0);
                return;
            }
            span += dt;
            turned += mean * dt;
        }
    }

    /// Root mean square error per axis, rad/s, once there is enough to tell.
    pub(super) fn error(&self) -> Option<Vector3<f64>> {
        (self.comparisons >= ENOUGH).then(|| self.mean_square.map(f64::sqrt))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_finds_the_error_of_what_it_is_told() {
        let mut m = Monitor::new();
        let (rate, told) = (Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.35, -0.2, 0.4));
        let mut q = UnitQuaternion::identity();
        for _ in 0..100 {
            q *= UnitQuaternion::from_scaled_axis(rate * 0.02);
            m.see(0.02, q, told);
        }
        let error = m.error().unwrap();
        assert!((error - Vector3::new(0.05, 0.0, 0.1)).amax() < 0.01, "{error}");
        assert_eq!(Monitor::new().error(), None);
    }
}
