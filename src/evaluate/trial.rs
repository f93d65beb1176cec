use super::settling::{Instant, Settling, settle};
use super::{Detection, Errors, TruthTrack, is_known};
use crate::pipeline::Snapshot;
use crate::signal::{Estimate, Guarantee, Signal, Verdict};
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::time::Duration;

/// Signals that belong together, such as the three of a force.
#[derive(Debug, Clone, Default)]
pub struct Quantity {
    /// By signal: its unit and its errors.
    pub signals: BTreeMap<&'static str, (&'static str, Errors)>,
    pub settling: Settling,
    /// Instants at which all signals had a bound, and those at which all bounds held.
    pub bounded: u64,
    pub covered: u64,
    series: Vec<Instant>,
}

/// How one observer went about its work.
#[derive(Debug, Clone, Default)]
pub struct Conduct {
    /// Steps in the air, those of them whose verdict was that the assumptions are broken, and those without an answer.
    pub steps: u64,
    pub violated: u64,
    pub starved: u64,
    /// Time of one step of the observer alone, summed over the steps, ns; 0 for what takes no time of its own.
    pub cost_ns: f64,
}

/// One flight of one scenario with any number of observers side by side, or several such flights together.
#[derive(Debug, Clone, Default)]
pub struct Trial {
    /// By source (an observer's name, or `wind`) and quantity (`force`, `torque`, `wind`).
    pub quantities: BTreeMap<(&'static str, String), Quantity>,
    /// By source.
    pub conduct: BTreeMap<&'static str, Conduct>,
    pub detection: Detection,
    /// Why observers were left out: the vehicle's file lacks what they live on.
    pub left_out: BTreeSet<String>,
    pub flights: u32,
    pub airborne_s: f64,
    /// Flights that ended in a crash.
    pub crashes: u32,
    pub steps: u64,
    /// Decoding, alignment and all observers, for all steps together.
    pub busy: Duration,
}

/// The source of the wind, which is made of an observer's force.
const WIND: &str = "wind";
const WIND_SIGNALS: [Signal; 3] = [
    Signal { name: "wind_n", unit: "m/s", frame: "NED" },
    Signal { name: "wind_e", unit: "m/s", frame: "NED" },
    Signal { name: "wind_d", unit: "m/s", frame: "NED" },
];

impl Trial {
    pub fn merge(&mut self, other: &Self) {
        for (key, theirs) in &other.quantities {
            let mine = self.quantities.entry(key.clone()).or_default();
            for (name, (unit, errors)) in &theirs.signals {
                mine.signals.entry(name).or_insert_with(|| (unit, Errors::default())).1.merge(errors);
            }
            mine.settling.merge(&theirs.settling);
            mine.bounded += theirs.bounded;
            mine.covered += theirs.covered;
        }
        for (name, theirs) in &other.conduct {
            let mine = self.conduct.entry(name).or_default();
            mine.steps += theirs.steps;
            mine.violated += theirs.violated;
            mine.starved += theirs.starved;
            mine.cost_ns += theirs.cost_ns;
        }
        self.detection.merge(&other.detection);
        self.left_out.extend(other.left_out.iter().cloned());
        self.flights += other.flights;
        self.airborne_s += other.airborne_s;
        self.crashes += other.crashes;
        self.steps += other.steps;
        self.busy += other.busy;
    }

    /// Scores everything in a snapshot against the truth of its own stamp.
    pub(super) fn see(&mut self, snapshot: &Snapshot<'_>, track: &TruthTrack) {
        self.steps += 1;
        for report in snapshot.observers.iter() {
            let verdict = report.estimate.verdict;
            self.conduct.entry(report.name).or_default().see(verdict, report.step_ns);
            if !matches!(verdict, Verdict::Starved | Verdict::Grounded) {
                self.score(report.name, report.signals, report.estimate, track);
            }
        }
        let verdict = snapshot.wind.as_ref().map_or(Verdict::Starved, |wind| wind.verdict);
        self.conduct.entry(WIND).or_default().see(verdict, 0);
        if let Some(wind) = &snapshot.wind {
            let estimate = Estimate {
                stamp: snapshot.stamp,
                values: wind.velocity_ned_mps.as_slice().to_vec(),
                half_widths: wind.half_width_mps.as_slice().to_vec(),
                guarantee: wind.guarantee,
                residual: 0.0,
                verdict,
            };
            self.score(WIND, &WIND_SIGNALS, &estimate, track);
        }
    }

    /// Scores the signals that the truth knows, three by three as their names go together.
    fn score(&mut self, source: &'static str, signals: &[Signal], estimate: &Estimate, track: &TruthTrack) {
        let known =
            signals.iter().zip(&estimate.values).zip(&estimate.half_widths).filter(|((s, _), _)| is_known(s.name));
        let known: Vec<_> = known.collect();
        for group in known.chunk_by(|a, b| stem(a.0.0.name) == stem(b.0.0.name)) {
            let Some(((first, _), _)) = group.first() else { continue };
            let quantity = self.quantities.entry((source, stem(first.name).to_owned())).or_default();
            let (mut held, mut bounded) = (true, estimate.guarantee != Guarantee::None);
            let (mut truth, mut guess) = (Vector3::zeros(), Vector3::zeros());
            for (axis, ((signal, value), half_width)) in group.iter().enumerate() {
                let Some(exact) = track.value(signal.name, estimate.stamp) else { return };
                // angles meet again after a turn
                let turn = if signal.unit == "rad" { TAU } else { f64::INFINITY };
                let error = wrapped(*value - exact, turn);
                let claimed = if estimate.guarantee == Guarantee::None { f64::INFINITY } else { **half_width };
                let entry = quantity.signals.entry(signal.name).or_insert_with(|| (signal.unit, Errors::default()));
                entry.1.add(error, claimed);
                bounded &= claimed.is_finite();
                held &= error.abs() <= claimed;
                if let (Some(t), Some(g)) = (truth.get_mut(axis), guess.get_mut(axis)) {
                    (*t, *g) = (exact, **value);
                }
            }
            quantity.bounded += u64::from(bounded);
            quantity.covered += u64::from(bounded && held);
            quantity.series.push(Instant { t_s: estimate.stamp.secs(), truth, estimate: guess });
        }
    }

    /// Turns what was kept of the flight into settling times.
    pub(super) fn close(&mut self, changes: &[f64]) {
        for ((_, kind), quantity) in &mut self.quantities {
            let series = std::mem::take(&mut quantity.series);
            // what the flight changes on purpose; all else changes with every manoeuvre
            let least = match kind.as_str() {
                "force" | "wind" => 0.5,
                "torque" => 0.02,
                "mass" | "payload" => 0.1,
                _ => continue,
            };
            quantity.settling = settle(&series, changes, least);
        }
    }
}

impl Conduct {
    fn see(&mut self, verdict: Verdict, step_ns: u32) {
        self.steps += 1;
        self.cost_ns += f64::from(step_ns);
        self.violated += u64::from(verdict == Verdict::AssumptionViolated);
        self.starved += u64::from(matches!(verdict, Verdict::Starved | Verdict::Grounded));
    }

    /// Mean time of one step of the observer alone; `None` for what takes none of its own.
    pub fn us_per_step(&self) -> Option<f64> {
        (self.cost_ns > 0.0).then(|| self.cost_ns * 1e-3 / self.steps as f64)
    }
}

/// Within half a turn of 0.
fn wrapped(error: f64, turn: f64) -> f64 {
    if turn.is_finite() { error - turn * (error / turn).round() } else { error }
}

/// `force` of `force_n`.
fn stem(name: &str) -> &str {
    name.rsplit_once('_').map_or(name, |(stem, _)| stem)
}
