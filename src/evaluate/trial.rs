use super::settling::{Instant, Settling, settle};
use super::{Errors, TruthTrack, is_known};
use crate::observers::BuildError;
use crate::pipeline::{Event, Fleet, FleetSettings, ObserverSetting, Snapshot};
use crate::signal::{Estimate, Guarantee, Signal, Stamp, Verdict};
use crate::sim::control::Flight;
use crate::sim::scenario::Scenario;
use crate::sim::{Run, RunOptions, SimError};
use crate::wire::{self, Parser};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant as Clock};

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    #[error("{scenario}: {source}")]
    Sim { scenario: String, source: SimError },
    #[error("{scenario}: {source}")]
    Build { scenario: String, source: BuildError },
}

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

/// One flight of one scenario with one observer.
#[derive(Debug, Clone, Default)]
pub struct Trial {
    /// By source (an observer's name, or `wind`) and quantity (`force`, `torque`, `wind`).
    pub quantities: BTreeMap<(&'static str, String), Quantity>,
    pub flights: u32,
    pub airborne_s: f64,
    pub steps: u64,
    /// Steps whose verdict was that the assumptions are broken.
    pub violated: u64,
    /// Decoding, alignment and observer, for all steps together.
    pub busy: Duration,
}

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
        self.flights += other.flights;
        self.airborne_s += other.airborne_s;
        self.steps += other.steps;
        self.violated += other.violated;
        self.busy += other.busy;
    }

    fn see(&mut self, snapshot: &Snapshot<'_>, track: &TruthTrack) {
        self.steps += 1;
        self.violated += u64::from(snapshot.verdict == Verdict::AssumptionViolated);
        for report in snapshot.observers.iter() {
            if !matches!(report.estimate.verdict, Verdict::Starved | Verdict::Grounded) {
                self.score(report.name, report.signals, report.estimate, track);
            }
        }
        if let Some(wind) = &snapshot.wind {
            let estimate = Estimate {
                stamp: snapshot.stamp,
                values: wind.velocity_ned_mps.as_slice().to_vec(),
                half_widths: wind.half_width_mps.as_slice().to_vec(),
                guarantee: wind.guarantee,
                residual: 0.0,
                verdict: wind.verdict,
            };
            self.score("wind", &WIND, &estimate, track);
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
                let error = *value - exact;
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

    fn close(&mut self, changes: &[f64]) {
        for ((_, kind), quantity) in &mut self.quantities {
            let least = match kind.as_str() {
                "torque" => 0.02,
                _ => 0.5,
            };
            quantity.settling = settle(&quantity.series, changes, least);
            quantity.series = Vec::new();
        }
    }
}

const WIND: [Signal; 3] = [
    Signal { name: "wind_n", unit: "m/s", frame: "NED" },
    Signal { name: "wind_e", unit: "m/s", frame: "NED" },
    Signal { name: "wind_d", unit: "m/s", frame: "NED" },
];

/// `force` of `force_n`.
fn stem(name: &str) -> &str {
    name.rsplit_once('_').map_or(name, |(stem, _)| stem)
}

/// Flies a scenario once and scores one observer, in lock-step: every frame that reaches the ground goes through the
/// same chain as in the daemon, and the truth of its stamp is at hand.
///
/// # Errors
/// The vehicle cannot be simulated, or the observer cannot be built for it.
pub fn fly(scenario: &Scenario, observer: &str) -> Result<Trial, TrialError> {
    let name = || scenario.name.clone();
    let plan = scenario.plan(0);
    let settings = FleetSettings {
        observers: vec![ObserverSetting::named(observer)],
        ..FleetSettings::standard(Arc::new(plan.model.clone()))
    };
    let mut fleet = Fleet::new(settings).map_err(|source| TrialError::Build { scenario: name(), source })?;
    let mut one = scenario.clone();
    one.vehicles = 1;
    let mut run =
        Run::new(&one, &RunOptions::default()).map_err(|source| TrialError::Sim { scenario: name(), source })?;

    let mut trial = Trial { flights: 1, ..Trial::default() };
    let mut track = TruthTrack::default();
    let mut parser = Parser::new();
    let mut received = Vec::with_capacity(1 << 12);
    while !run.done() {
        received.clear();
        let mut at_us = 0;
        run.advance(&mut |r| {
            received.extend_from_slice(r.bytes);
            at_us = r.unix_us;
        });
        let Some(moment) = run.moment(0) else { break };
        track.push(Stamp::from_secs(run.boot_s(0)), moment.truth);
        let flying = matches!(moment.flight, Flight::Flying | Flight::Landing) && !moment.truth.on_ground;
        if flying {
            trial.airborne_s += run.loop_s();
        }
        parser.push(&received);
        let mut scoring = Duration::ZERO;
        let began = Clock::now();
        while let Some(event) = parser.next() {
            let wire::Event::Frame(frame) = event else { continue };
            fleet.frame(frame, at_us, &mut |event| {
                if let (Event::Snapshot(snapshot, _), true) = (event, flying) {
                    let began = Clock::now();
                    trial.see(snapshot, &track);
                    scoring += began.elapsed();
                }
            });
        }
        if flying {
            trial.busy += began.elapsed().saturating_sub(scoring);
        }
    }
    trial.close(&plan.changes());
    Ok(trial)
}
