use super::{FaultWatch, Trial, TrueFault, TruthTrack};
use crate::observers::BuildError;
use crate::pipeline::{Event, Fleet, FleetSettings, ObserverSetting};
use crate::signal::Stamp;
use crate::sim::control::Flight;
use crate::sim::scenario::Scenario;
use crate::sim::{Run, RunOptions, SimError};
use crate::wire::{self, Parser};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum TrialError {
    #[error("{scenario}: {source}")]
    Sim { scenario: String, source: SimError },
    #[error("{scenario}: {source}")]
    Build { scenario: String, source: BuildError },
}

/// Nanoseconds of a steady clock.
fn steady_ns() -> u64 {
    static START: OnceLock<Instant> = OnceLock::new();
    START.get_or_init(Instant::now).elapsed().as_nanos() as u64
}

/// Flies a scenario once and scores these observers side by side, in lock-step: every frame that reaches the ground
/// goes through the same chain as in the daemon, and the truth of its stamp is at hand. Nothing is scored on the ground
/// or after a crash.
///
/// # Errors
/// The vehicle cannot be simulated, or an observer cannot be built for it.
pub fn fly(scenario: &Scenario, observers: &[ObserverSetting]) -> Result<Trial, TrialError> {
    let name = || scenario.name.clone();
    let plan = scenario.plan(0);
    let mut trial = Trial { flights: 1, ..Trial::default() };
    let settings =
        FleetSettings { observers: observers.to_vec(), ..FleetSettings::standard(Arc::new(plan.model.clone())) };
    let fleet = Fleet::new(settings).map_err(|source| TrialError::Build { scenario: name(), source })?;
    let mut fleet = fleet.timed(steady_ns);
    trial.left_out.extend(fleet.left_out().map(str::to_owned));
    let mut one = scenario.clone();
    one.vehicles = 1;
    let mut run =
        Run::new(&one, &RunOptions::default()).map_err(|source| TrialError::Sim { scenario: name(), source })?;

    let mut watch = FaultWatch::new(plan.faults.iter().map(TrueFault::from));
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
        let aloft = matches!(moment.flight, Flight::Flying | Flight::Landing);
        let flying = aloft && !moment.truth.on_ground;
        // what lies on the ground unasked, or stops its motors above it, has crashed
        let down = moment.flight == Flight::Flying && moment.truth.on_ground;
        let given_up = !moment.flight.armed() && !moment.truth.on_ground;
        if (down || given_up) && trial.airborne_s > 1.0 {
            trial.crashes = 1;
            break;
        }
        if flying {
            trial.airborne_s += run.loop_s();
        }
        parser.push(&received);
        let mut scoring = Duration::ZERO;
        let began = Instant::now();
        while let Some(event) = parser.next() {
            let wire::Event::Frame(frame) = event else { continue };
            fleet.frame(frame, at_us, &mut |event| {
                if let (Event::Snapshot(snapshot, _), true) = (event, flying) {
                    let began = Instant::now();
                    trial.see(snapshot, &track);
                    watch.see(snapshot.stamp.secs(), snapshot.faults);
                    scoring += began.elapsed();
                }
            });
        }
        if flying {
            trial.busy += began.elapsed().saturating_sub(scoring);
        }
    }
    trial.close(&plan.changes());
    trial.detection = watch.finish();
    Ok(trial)
}
