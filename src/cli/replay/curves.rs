//! What a page draws of one vehicle's flight, thinned so that a flight of any length takes little memory.

use crate::pipeline::Snapshot;
use crate::signal::{Stamp, Verdict};
use std::collections::BTreeMap;

/// Points kept; when there are twice as many, every second goes.
const POINTS: usize = 1_500;

/// One moment: value and half-width of three components each.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub boot_s: f64,
    pub wind: Option<[[f64; 2]; 3]>,
    pub force: Option<[[f64; 2]; 3]>,
    pub torque: Option<[[f64; 2]; 3]>,
}

/// How an observer did.
#[derive(Debug, Clone, Default)]
pub(super) struct Health {
    pub steps: u64,
    pub verdicts: BTreeMap<&'static str, u64>,
    pub worst_residual: f64,
    pub step_ns: u32,
    /// Boot time and residual.
    pub residuals: Vec<[f64; 2]>,
}

#[derive(Debug, Default)]
pub(super) struct Curves {
    pub moments: Vec<Moment>,
    /// Name, and the stretches of boot time in which it held.
    pub verdicts: Vec<(&'static str, Vec<[f64; 2]>)>,
    pub faults: Vec<(&'static str, Vec<[f64; 2]>)>,
    pub observers: BTreeMap<&'static str, Health>,
    last: Option<Stamp>,
    seen: usize,
    stride: usize,
}

/// Stretches with a shorter gap between them are one, s.
const JOIN_S: f64 = 0.5;

impl Curves {
    pub fn snapshot(&mut self, s: &Snapshot<'_>) {
        // after a restart boot time begins anew; the page shows the flight up to there
        if self.last.is_some_and(|last| last > s.stamp) {
            return;
        }
        self.last = Some(s.stamp);
        let at = s.stamp.secs();
        hold(&mut self.verdicts, verdict_name(s.verdict), at);
        s.faults.names().for_each(|name| hold(&mut self.faults, name, at));
        self.stride = self.stride.max(1);
        let keep = self.seen.is_multiple_of(self.stride);
        self.seen += 1;
        for report in s.observers.iter() {
            let health = self.observers.entry(report.name).or_default();
            health.steps = report.steps;
            health.step_ns = report.step_ns;
            *health.verdicts.entry(verdict_name(report.estimate.verdict)).or_default() += 1;
            let residual = report.estimate.residual;
            if residual.is_finite() {
                health.worst_residual = health.worst_residual.max(residual);
                if keep {
                    health.residuals.push([at, residual]);
                }
            }
        }
        if keep {
            let three = |v: &nalgebra::Vector3<f64>, h: &nalgebra::Vector3<f64>| [0, 1, 2].map(|i| [v[i], h[i]]);
            self.moments.push(Moment {
                boot_s: at,
                wind: s.wind.map(|w| three(&w.velocity_ned_mps, &w.half_width_mps)),
                force: s.wrench.map(|w| three(&w.force_ned_n, &w.force_half_width_n)),
                torque: s.wrench.map(|w| three(&w.torque_frd_nm, &w.torque_half_width_nm)),
            });
        }
        if self.moments.len() >= 2 * POINTS {
            self.stride *= 2;
            thin(&mut self.moments);
            self.observers.values_mut().for_each(|h| thin(&mut h.residuals));
        }
    }
}

fn thin<T>(points: &mut Vec<T>) {
    let mut keep = false;
    points.retain(|_| {
        keep = !keep;
        keep
    });
}

/// Notes that something held at a moment.
fn hold(into: &mut Vec<(&'static str, Vec<[f64; 2]>)>, name: &'static str, at: f64) {
    let spans = match into.iter_mut().position(|(known, _)| *known == name) {
        Some(i) => &mut into[i].1,
        None => {
            into.push((name, Vec::new()));
            // it was pushed just now
            let Some((_, spans)) = into.last_mut() else { return };
            spans
        }
    };
    match spans.last_mut() {
        Some([_, to]) if at - *to < JOIN_S => *to = at,
        _ => spans.push([at, at]),
    }
}

pub(super) fn verdict_name(v: Verdict) -> &'static str {
    match v {
        Verdict::Consistent => "consistent",
        Verdict::Settling => "settling",
        Verdict::AssumptionViolated => "violated",
        Verdict::Starved => "starved",
        Verdict::Grounded => "grounded",
    }
}
