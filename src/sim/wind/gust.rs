use nalgebra::Vector3;
use std::f64::consts::PI;

/// A gust front: the wind rises by `peak` as half a cosine wave, holds, and falls the same way (the "1 − cosine" gust
/// of MIL-F-8785C §3.7.3, with a plateau).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gust {
    pub start_s: f64,
    pub rise_s: f64,
    /// Infinite for a front that stays.
    pub hold_s: f64,
    pub fall_s: f64,
    pub peak_ned_mps: Vector3<f64>,
}

impl Gust {
    pub fn at(&self, t_s: f64) -> Vector3<f64> {
        let s = t_s - self.start_s;
        let fall = s - self.rise_s - self.hold_s;
        let share = if s <= 0.0 {
            0.0
        } else if s < self.rise_s {
            0.5 * (1.0 - (PI * s / self.rise_s).cos())
        } else if fall <= 0.0 {
            1.0
        } else if fall < self.fall_s {
            0.5 * (1.0 + (PI * fall / self.fall_s).cos())
        } else {
            0.0
        };
        self.peak_ned_mps * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rises_holds_and_falls() {
        let g = Gust { start_s: 10.0, rise_s: 2.0, hold_s: 5.0, fall_s: 4.0, peak_ned_mps: Vector3::x() * 6.0 };
        for (t, v) in [(9.0, 0.0), (11.0, 3.0), (12.0, 6.0), (16.9, 6.0), (19.0, 3.0), (21.0, 0.0), (99.0, 0.0)] {
            assert!((g.at(t).x - v).abs() < 1e-12, "{t} s: {}", g.at(t).x);
        }
        let front = Gust { hold_s: f64::INFINITY, ..g };
        assert_eq!(front.at(1e6).x, 6.0);
        assert_eq!(Gust { rise_s: 0.0, ..g }.at(10.001).x, 6.0);
    }
}
