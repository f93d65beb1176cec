use super::level::{chance, quantile};
use super::monitor::Monitor;
use crate::signal::{Guarantee, Residual, Stamp};
use nalgebra::Vector3;

/// Two sources are compared with what their difference was: at first over this time, s, and then forgetting at that pace.
const FIRST_S: f64 = 3.0;
const REFERENCE_S: f64 = 60.0;
/// Its unrest is learnt over this time, s, each departure counted as at most so many standard deviations.
const LEARN_S: f64 = 120.0;
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
            // what the steps make of it is nearer than what is declared, and half as much more is for what they miss
            self.variance = (1.5 * 1.5 * self.unrest).min(self.variance);
        }
        let departure = self.mean - self.reference;
        if departure.norm() <= self.admissible() && !self.monitor.active() {
            let over_s = if self.seen_s < FIRST_S { self.seen_s } else { REFERENCE_S };
            self.refer(self.reference + departure * (dt_s / over_s).min(1.0));
            if self.seen_s > self.with.span_s {
                let square = (departure.norm_squared() / 3.0).min(CLIP * CLIP * self.variance);
                self.variance += (square - self.variance) * (dt_s / LEARN_S).min(1.0);
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
