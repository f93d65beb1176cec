use nalgebra::Vector3;

/// Turns of the wind smaller than this open nothing, m/s: they lie within every bound.
const LEAST_MPS: f64 = 0.3;
/// The wind is turning while it changes faster than this, m/s².
const TURNING_MPS2: f64 = 3.0;
/// How long after it turned the bound stays open, s, and how fast it then closes, 1/s: both as a few vehicle lengths of
/// air pass.
const HOLD_S: f64 = 0.25;
const CLOSING: f64 = 2.0;
/// Part of a turn's size by which the bound opens in all other directions too: a front brings air from anywhere.
const SIDEWAYS: f64 = 0.7;

/// How far a bound reaches back to where the wind came from.
///
/// The wind at the vehicle is that of one point, and of one instant. Where it turns by metres a second within a few
/// tenths of a second, the air around still moves as before: a bound that followed at once would hold at that point
/// only. So an end of the interval that moves inwards does so no faster than at [`CLOSING`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Front {
    /// How far the wind has moved on from what it was, for each axis upwards and downwards, m/s.
    risen: Vector3<f64>,
    fallen: Vector3<f64>,
    /// Since the wind last turned, s.
    quiet_s: f64,
}

/// By how much the lower and upper ends of the intervals reach further out, m/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reach {
    pub below: Vector3<f64>,
    pub above: Vector3<f64>,
}

impl Front {
    /// The wind moved by this during a step.
    pub fn step(&mut self, moved: Vector3<f64>, dt_s: f64) -> Reach {
        if self.quiet_s > HOLD_S {
            let keep = (-CLOSING * dt_s).exp();
            self.risen *= keep;
            self.fallen *= keep;
        }
        self.risen = (self.risen + moved).map(|x| x.max(0.0));
        self.fallen = (self.fallen - moved).map(|x| x.max(0.0));
        let size = self.size();
        if size > LEAST_MPS && moved.norm() > TURNING_MPS2 * dt_s {
            self.quiet_s = 0.0;
        } else {
            self.quiet_s += dt_s;
        }
        let sideways = SIDEWAYS * (size - LEAST_MPS).max(0.0);
        let open = |turned: Vector3<f64>| turned.map(|x| (x - LEAST_MPS).max(sideways));
        Reach { below: open(self.risen), above: open(self.fallen) }
    }

    fn size(&self) -> f64 {
        self.risen.sup(&self.fallen).norm()
    }

    /// Is the bound still visibly open?
    pub fn is_open(&self) -> bool {
        self.size() > 2.0 * LEAST_MPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_old_wind_stays_inside_for_a_while() {
        let mut front = Front::default();
        // 8 m/s from nothing within 0.1 s
        for _ in 0..5 {
            front.step(Vector3::new(1.6, 0.0, 0.0), 0.02);
        }
        let now = front.step(Vector3::zeros(), 0.02);
        assert!(now.below.x > 7.5 && now.above.x > 5.0 && now.below.y > 5.0, "{now:?}");
        let mut reach = now;
        for _ in 0..100 {
            reach = front.step(Vector3::zeros(), 0.02);
        }
        assert!(reach.below.x < 0.2 && !front.is_open(), "{reach:?}");
    }

    #[test]
    fn noise_opens_nothing() {
        let mut front = Front::default();
        for k in 0..1000 {
            let reach = front.step(Vector3::repeat(if k % 2 == 0 { 0.05 } else { -0.05 }), 0.02);
            assert_eq!(reach.below, Vector3::zeros());
        }
    }
}
