//! `mavobserver evaluate`: many simulated flights, all cores, one table of how good the estimates are.

mod experiments;
mod report;

use super::Failure;
use crate::evaluate::{Trial, fly};
use crate::observers;
use crate::sim::scenario::{self, Scenario};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use report::Report;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Score the observers on simulated flights, where the truth is known
///
/// Flies each scenario several times with other random numbers, and with another vehicle out of the ranges that the
/// vehicle file declares, in lock-step with the estimators. Settling is the time until the error stays below a fifth of
/// a change. The cost of a step holds decoding, alignment and the observer.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver evaluate
  mavobserver evaluate wind-steps gusts --runs 20
  mavobserver evaluate my-scenario.toml --json > scores.json
  mavobserver evaluate --report scores.html
  mavobserver evaluate --experiment all

Exit codes: 0 scored, 1 an observer has no design for a vehicle or a limit is missed, 2 wrong usage or scenario.")]
pub struct EvaluateArgs {
    /// Scenarios that come with the program, or TOML files; all that come with it when none is given
    pub scenarios: Vec<String>,
    /// Repeat an experiment of a paper instead, or `all` of them; repeatable
    #[arg(long = "experiment", value_name = "NAME", conflicts_with_all = ["scenarios", "observers", "report"])]
    pub experiments: Vec<String>,
    /// Only this observer; repeatable
    #[arg(long = "observer", value_name = "NAME")]
    pub observers: Vec<String>,
    /// Flights of each scenario
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Fly the vehicle exactly as its file says, not one drawn from its ranges
    #[arg(long)]
    pub exact: bool,
    /// Threads; as many as there are cores when left out
    #[arg(long, value_name = "N")]
    pub jobs: Option<usize>,
    /// Print the scores as one JSON object
    #[arg(long)]
    pub json: bool,
    /// Write the scores as a web page
    #[arg(long, value_name = "HTML")]
    pub report: Option<PathBuf>,
}

/// One flight to fly.
struct Job<'a> {
    scenario: Scenario,
    observer: &'a str,
}

/// What became of the flights of a scenario with an observer.
#[derive(Default)]
pub(super) struct Outcome {
    trial: Trial,
    failure: Option<String>,
}

/// By scenario and observer.
type Outcomes = BTreeMap<(String, String), Outcome>;

pub fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    if !args.experiments.is_empty() {
        return experiments::run(&args.experiments, args.json);
    }
    let jobs = jobs(args)?;
    let threads = args.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)).max(1);
    let outcomes = fly_all(&jobs, threads, args.json);
    let report = Report::new(&outcomes, args.runs);
    if let Some(path) = &args.report {
        std::fs::write(path, report.html()?)
            .map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))?;
    }
    super::print(&if args.json { report.json() } else { report.text() })?;
    match report.failures() {
        failures if failures.is_empty() => Ok(()),
        failures => Err(Failure::Failed(failures.join("\n"))),
    }
}

fn jobs(args: &EvaluateArgs) -> Result<Vec<Job<'_>>, Failure> {
    let names: Vec<&str> = match args.scenarios.is_empty() {
        true => scenario::names().collect(),
        false => args.scenarios.iter().map(String::as_str).collect(),
    };
    let observers: Vec<&str> = match args.observers.is_empty() {
        true => observers::REGISTRY.iter().map(|r| r.name).collect(),
        false => args.observers.iter().map(String::as_str).collect(),
    };
    for name in &observers {
        observers::find(name).map_err(|e| Failure::Usage(e.to_string()))?;
    }
    let mut jobs = Vec::new();
    for name in names {
        let mut scenario = scenario::resolve(name)?;
        scenario.sampled = !args.exact;
        for run in 0..args.runs {
            let flight = scenario.clone().with_seed(scenario.seed().wrapping_add(u64::from(run)));
            jobs.extend(observers.iter().map(|observer| Job { scenario: flight.clone(), observer }));
        }
    }
    Ok(jobs)
}

/// Spreads the flights over threads. A design is made once and found in the cache by the flights after it.
fn fly_all(jobs: &[Job<'_>], threads: usize, quiet: bool) -> Outcomes {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(jobs.len() as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} flights  {eta} left  {msg}");
    let bar = bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let outcomes = Mutex::new(Outcomes::new());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads.min(jobs.len()) {
            scope.spawn(|| {
                while let Some(job) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    bar.set_message(job.scenario.name.clone());
                    let result = fly(&job.scenario, job.observer);
                    // another thread's panic spoils none of the finished results
                    let mut all = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
                    let entry = all.entry((job.scenario.name.clone(), job.observer.to_owned())).or_default();
                    match result {
                        Ok(trial) => entry.trial.merge(&trial),
                        Err(e) => entry.failure = Some(e.to_string()),
                    }
                    bar.inc(1);
                }
            });
        }
    });
    bar.finish_and_clear();
    outcomes.into_inner().unwrap_or_else(PoisonError::into_inner)
}
