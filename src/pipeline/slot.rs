use super::snapshot::WrenchEstimate;
use crate::observers::{Observer, Options, Registration};
use crate::signal::{Channel, Discontinuity, Guarantee, Measurement, Verdict};
use crate::telemetry::Aligner;
use nalgebra::Vector3;

/// Gives nanoseconds of a steady clock; whoever drives the chain brings it, as the chain knows none.
pub type Clock = fn() -> u64;

/// The mean computing time follows over about this many steps.
const MEAN_STEPS: f64 = 128.0;

/// One observer of one vehicle, with its place in the registry and what is counted about it.
pub(super) struct Slot {
    pub registration: &'static Registration,
    pub options: Options,
    pub observer: Box<dyn Observer>,
    pub steps: u64,
    pub failures: u64,
    /// Mean computing time of a step, ns; 0 without a clock.
    pub mean_ns: f64,
    /// Bits of the needed channels that do not arrive.
    pub missing: u16,
    /// Values that make up a wrench, when the observer estimates one.
    wrench: Option<[usize; 6]>,
    /// The heading, when an observer estimates one (signal `yaw`).
    yaw: Option<[usize; 1]>,
}

/// A heading that does not come from the autopilot, rad from north over east.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heading {
    pub yaw_rad: f64,
    /// What its error is likely to stay below.
    pub likely_error_rad: f64,
    /// Its bound, where that is guaranteed.
    pub guaranteed_rad: Option<f64>,
}

/// Likely error of a heading whose observer claims no bound, rad: 10°.
const UNBOUNDED_HEADING_RAD: f64 = 0.1745;

impl Slot {
    pub fn new(registration: &'static Registration, options: Options, observer: Box<dyn Observer>) -> Self {
        let wrench = places(&*observer, ["force_n", "force_e", "force_d", "torque_x", "torque_y", "torque_z"]);
        let yaw = places(&*observer, ["yaw"]);
        Self { registration, options, observer, steps: 0, failures: 0, mean_ns: 0.0, missing: 0, wrench, yaw }
    }

    /// The same observer for another vehicle.
    pub fn fresh(&self) -> Self {
        Self::new(self.registration, self.options.clone(), self.observer.fresh())
    }

    /// Is it this observer with these options?
    pub fn is(&self, registration: &Registration, options: &Options) -> bool {
        self.registration.id == registration.id && self.options == *options
    }

    /// One step. Where time is not continuous the observer begins anew; a jump of the autopilot's own estimate is left
    /// to the observer, which may not depend on that.
    pub fn step(&mut self, m: &Measurement, aligner: &Aligner, clock: Option<Clock>) {
        use Discontinuity::{First, Gap, Reboot};
        if matches!(m.discontinuity, Some(First | Reboot | Gap)) && self.steps > 0 {
            self.observer.reset();
        }
        self.missing =
            self.registration.needs.iter().filter(|c| aligner.missing(**c)).fold(0, |bits, c| bits | c.bit());
        let began = clock.map(|now| now());
        if self.observer.step(m).is_err() {
            self.failures += 1;
        }
        self.steps += 1;
        if let (Some(now), Some(began)) = (clock, began) {
            let took = now().saturating_sub(began) as f64;
            self.mean_ns += (took - self.mean_ns) / (self.steps as f64).min(MEAN_STEPS);
        }
    }

    pub fn heading(&self) -> Option<Heading> {
        // what is made of the autopilot's attitude cannot tell where that is off
        let [at] = self.yaw.filter(|_| !self.registration.needs.contains(&Channel::Attitude))?;
        let e = self.observer.estimate();
        let (yaw_rad, half_width) = (e.values[at], e.half_widths[at]);
        (e.verdict == Verdict::Consistent && yaw_rad.is_finite()).then(|| Heading {
            yaw_rad,
            likely_error_rad: if half_width.is_finite() { half_width } else { UNBOUNDED_HEADING_RAD },
            guaranteed_rad: (e.guarantee == Guarantee::Guaranteed && half_width.is_finite()).then_some(half_width),
        })
    }

    pub fn wrench(&self) -> Option<WrenchEstimate> {
        let at = self.wrench?;
        let e = self.observer.estimate();
        if matches!(e.verdict, Verdict::Grounded | Verdict::Starved) {
            return None;
        }
        let pick = |from: &[f64], k: usize| Vector3::new(from[at[k]], from[at[k + 1]], from[at[k + 2]]);
        Some(WrenchEstimate {
            force_ned_n: pick(&e.values, 0),
            force_half_width_n: pick(&e.half_widths, 0),
            torque_frd_nm: pick(&e.values, 3),
            torque_half_width_nm: pick(&e.half_widths, 3),
            guarantee: e.guarantee,
            verdict: e.verdict,
        })
    }
}

/// Where signals of these names stand among those of an observer; `None` unless it has them all.
fn places<const N: usize>(observer: &dyn Observer, names: [&str; N]) -> Option<[usize; N]> {
    let at = names.map(|name| observer.signals().iter().position(|s| s.name == name));
    at.iter().all(Option::is_some).then(|| at.map(Option::unwrap_or_default))
}

/// What several observers say of one vehicle together, in whatever order they stand.
///
/// On the ground is where one says so: contact is a fact about the vehicle. Among those that answer the worst verdict
/// counts; starved is only a vehicle of which none answers.
pub(super) fn joint(verdicts: impl Iterator<Item = Verdict>) -> Verdict {
    let rank = |v: &Verdict| match v {
        Verdict::Starved => 0,
        Verdict::Consistent => 1,
        Verdict::Settling => 2,
        Verdict::AssumptionViolated => 3,
        Verdict::Grounded => 4,
    };
    verdicts.max_by_key(rank).unwrap_or(Verdict::Starved)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Verdict::{AssumptionViolated, Consistent, Grounded, Settling, Starved};

    #[test]
    fn the_order_of_observers_does_not_matter() {
        for (together, verdicts) in [
            (Starved, vec![]),
            (Starved, vec![Starved, Starved]),
            (Consistent, vec![Starved, Consistent]),
            (Settling, vec![Settling, Consistent, Starved]),
            (AssumptionViolated, vec![Consistent, AssumptionViolated, Settling]),
            (Grounded, vec![Consistent, Starved, Grounded]),
        ] {
            assert_eq!(joint(verdicts.iter().copied()), together);
            assert_eq!(joint(verdicts.into_iter().rev()), together);
        }
    }
}
