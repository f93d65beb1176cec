//! Asks the vehicles on the links what a run would ask them, and estimates nothing.

use super::service::Signals;
use super::{async_runtime, settings};
use crate::cli::Failure;
use crate::config::Config;
use crate::daemon::{Daemon, Decision, Status};
use crate::outputs::Rates;
use crate::pipeline::{Fleet, FleetSettings, VehicleId};
use crate::vehicle;
use serde_json::{Value, json};
use std::fmt::Write;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Pairs for so long with whoever is on the links; gives back what was asked for, and tells what was found.
pub(in crate::cli) fn pair(mut config: Config, seconds: f64) -> Result<Status, Failure> {
    config.record = None;
    config.metrics = None;
    config.parameters = None;
    for link in &mut config.links {
        link.output.status_text = false;
        link.output.rates = Rates::OFF;
    }
    let runtime = async_runtime(1)?;
    let outcome = runtime.block_on(async {
        let mut signals = Signals::listen().map_err(|e| Failure::Failed(format!("cannot listen for signals: {e}")))?;
        let daemon = Daemon::bind(settings(&config)?).await?;
        let stop = CancellationToken::new();
        let running = tokio::spawn(daemon.run(Some(nothing()?), stop.clone()));
        tokio::select! {
            () = tokio::time::sleep(Duration::from_secs_f64(seconds)) => {}
            () = signals.stop() => {}
        }
        stop.cancel();
        let summary = running.await.map_err(|e| Failure::Failed(format!("the daemon stopped by a defect: {e}")))?;
        Ok(summary?.status)
    });
    runtime.shutdown_background();
    outcome
}

/// A fleet without observers: it only tells which vehicles there are.
fn nothing() -> Result<Fleet, Failure> {
    let vehicle = Arc::new(vehicle::resolve(super::ASSUMED_MODEL)?);
    let settings = FleetSettings { observers: Vec::new(), ..FleetSettings::standard(vehicle) };
    Fleet::new(settings).map_err(|e| Failure::Failed(e.to_string()))
}

/// What was found out about a vehicle and decided for it, as a table.
pub(in crate::cli) fn table(out: &mut String, id: &VehicleId, decisions: &[Decision]) -> std::fmt::Result {
    writeln!(out, "vehicle {id}")?;
    let width = decisions.iter().map(|d| d.subject.chars().count()).max().unwrap_or_default();
    for Decision { subject, text, good } in decisions {
        let mark = if *good { ' ' } else { '!' };
        writeln!(out, "{mark} {subject:width$}  {text}")?;
    }
    Ok(())
}

/// The same for machines.
pub(in crate::cli) fn json((id, decisions): (&VehicleId, &Vec<Decision>)) -> Value {
    let decision = |d: &Decision| json!({ "subject": d.subject, "decision": d.text, "good": d.good });
    let decisions: Vec<_> = decisions.iter().map(decision).collect();
    json!({ "system": id.system, "component": id.component, "decisions": decisions })
}
