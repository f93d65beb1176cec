use super::level::{chance, quantile};
use super::monitor::Monitor;
use crate::signal::{Guarantee, Residual, Stamp};
use nalgebra::Vector3;

/// Two sources are compared with what their difference was: at first over this time, s, and then forgetting at that pace.
const FIRST_S: f64 = 3.0;
const REFERENCE_S: f64 = 60.0;
/// Its unrest is learnt over this time, s, each departure counted as at most so many standard deviations.
/// In the first time, s, it is a true mean.
const LEARN_S: f64 = 120.0;
const EARLY_S: f64 = 10.0;
const CLIP: f64 = 3.0;

/// How two sources of one vector are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Comparison {
    pub name: &'static str,
    /// Their difference is smoothed over this time, s.
    pub span_s: f64,
    /// Size of a difference that both may lawfully have, however still they are.
    pub still: f64,
    /// A constant difference up to this size is nobody's fault.
    pub constant: f64,
    /// Declared noise of the smoothed difference, one axis, one standard deviation: where learning begins.
    pub sigma: f64,
    /// Bearable false alarms an hour.
    pub per_hour: f64,
    /// A fault is told after, and clears after, s.
    pub tell_s: f64,
    pub clear_s: f64,
}

/// Two sources of one vector: the smoothed departure of their difference from what it used to be, against what is
/// lawful and what chance makes of it.
///
/// The spread of the smoothed departure is learnt from itself, so that correlated noise is counted as what it is; what
/// the differences do from one to the next tells at once when they grow restless. While the departure is beyond its
/// bound nothing is learnt.
#[derive(Debug, Clone)]
pub(super) struct Averaged {
    with: Comparison,
    /// Standard deviations that chance may reach.
    reach: f64,
    mean: Vector3<f64>,
    reference: Vector3<f64>,
    /// Of one axis, of the smoothed departure.
    variance: f64,
    last: Vector3<f64>,
    /// Mean square of one axis of the smoothed difference, as the steps between the latest differences make it.
    unrest: f64,
    seen_s: f64,
    pub monitor: Monitor,
}

impl Averaged {
    pub fn new(with: Comparison) -> Self {
        Self {
            reach: quantile(chance(with.per_hour, with.span_s), 3),
            mean: Vector3::zeros(),
            reference: Vector3::zeros(),
            variance: with.sigma * with.sigma,
            last: Vector3::zeros(),
            unrest: 0.0,
            seen_s: 0.0,
            monitor: Monitor::new(with.tell_s, with.clear_s),
            with,
        }
    }

    /// Takes in the difference of the two, which held for the last `dt_s`.
    pub fn see(&mut self, difference: Vector3<f64>, stamp: Stamp, dt_s: f64) {
        if self.seen_s == 0.0 {
            self.refer(difference);
            self.last = difference;
        }
        let step = difference - std::mem::replace(&mut self.last, difference);
        let share = (dt_s / self.with.span_s).min(1.0);
        // of white noise half the mean square of its steps is its variance, and smoothing keeps this share of that
        let white = step.norm_squared() / 6.0 * (0.5 * share);
        self.unrest += (white - self.unrest) * (0.5 * share);
        self.seen_s += dt_s;
        // a true mean until there is as much to smooth over as asked
        self.mean += (difference - self.mean) * (dt_s / self.seen_s.min(self.with.span_s)).min(1.0);
        if self.seen_s - dt_s < FIRST_S && self.seen_s >= FIRST_S {
            // what the steps make of it is nearer than what is declared, but for what they miss: all that is slow
            self.variance = (1.5 * 1.5 * self.unrest).clamp(0.25 * self.variance, self.variance);
        }
        let departure = self.mean - self.reference;
        if departure.norm() <= self.admissible() && !self.monitor.active() {
            let over_s = if self.seen_s < FIRST_S { self.seen_s } else { REFERENCE_S };
            self.refer(self.reference + departure * (dt_s / over_s).min(1.0));
            if self.seen_s > self.with.span_s {
                let square = (departure.norm_squared() / 3.0).min(CLIP * CLIP * self.variance);
                let over_s = if self.seen_s < EARLY_S { self.seen_s } else { LEARN_S };
                self.variance += (square - self.variance) * (dt_s / over_s).min(1.0);
            }
        }
        self.monitor.see(self.residual().ratio(), stamp, dt_s);
    }

    /// Takes this for the lawful constant difference, as far as it may be one.
    fn refer(&mut self, to: Vector3<f64>) {
        let size = to.norm();
        self.reference = if size > self.with.constant { to * (self.with.constant / size) } else { to };
    }

    fn admissible(&self) -> f64 {
        self.with.still + self.reach * self.variance.max(self.unrest).sqrt()
    }

    pub fn residual(&self) -> Residual {
        let p = 1.0 - chance(self.with.per_hour, self.with.span_s);
        Residual {
            name: self.with.name,
            value: (self.mean - self.reference).norm(),
            admissible: self.admissible(),
            guarantee: Guarantee::Statistical(p),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::faults::FaultSettings;

    /// A sequence of standard normal numbers, by the sum of twelve uniform ones (tails to six deviations).
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f64 {
            let mut uniform = || {
                // Knuth's linear congruence, its upper half
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (self.0 >> 33) as f64 / (1u64 << 31) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }

        fn vector(&mut self, sigma: f64) -> Vector3<f64> {
            Vector3::new(self.next(), self.next(), self.next()) * sigma
        }
    }

    fn compared(per_hour: f64) -> Averaged {
        Averaged::new(Comparison {
            name: "test",
            span_s: 1.0,
            still: 0.0,
            constant: 0.0,
            sigma: 0.6,
            per_hour,
            tell_s: 0.0,
            clear_s: 0.2,
        })
    }

    /// Alarms in this many hours of healthy differences ten times a second, that remember the last by `memory`.
    fn alarms(per_hour: f64, hours: f64, memory: f64) -> u32 {
        let (mut noise, mut a) = (Noise(7), compared(per_hour));
        let (mut told, mut before, mut d) = (0, false, Vector3::zeros());
        for k in 0..(hours * 36_000.0) as i64 {
            d = d * memory + noise.vector((1.0 - memory * memory).sqrt());
            a.see(d, Stamp::from_millis(100 * k), 0.1);
            told += u32::from(a.monitor.active() && !before);
            before = a.monitor.active();
        }
        told
    }

    #[test]
    fn healthy_differences_alarm_no_oftener_than_is_asked() {
        // white, and with a memory of half a second; where nothing is lawful but chance, so that chance alone counts
        for memory in [0.0, 0.8] {
            let often = alarms(30.0, 5.0, memory);
            assert!((1..=150).contains(&often), "memory {memory}: {often} in 5 h at 30 an hour");
            let seldom = alarms(1.0, 5.0, memory);
            assert!(seldom <= 5 && seldom < often, "memory {memory}: {seldom} in 5 h at one an hour");
        }
        assert_eq!(alarms(FaultSettings::default().each_per_hour(), 5.0, 0.0), 0);
    }

    #[test]
    fn a_departure_is_told_and_the_lawful_constant_is_not() {
        let mut a = Averaged::new(Comparison { still: 0.1, constant: 0.5, sigma: 0.02, ..compared(1e-3).with });
        let mut noise = Noise(3);
        let mut fly = |a: &mut Averaged, from: i64, to: i64, constant: f64| {
            for k in from..to {
                a.see(Vector3::x() * constant + noise.vector(0.05), Stamp::from_millis(100 * k), 0.1);
            }
        };
        fly(&mut a, 0, 600, 0.4);
        assert!(!a.monitor.active());
        fly(&mut a, 600, 630, 0.9);
        assert!(a.monitor.active(), "{:?}", a.residual());
        assert!((a.residual().value - 0.5).abs() < 0.1);
        fly(&mut a, 630, 680, 0.4);
        assert!(!a.monitor.active());
    }
}
