//! `mavobserver evaluate`: many simulated flights, all cores, one table of how good the estimates are.

mod experiments;
mod page;
mod report;

use super::Failure;
use crate::evaluate::{Trial, fly};
use crate::observers;
use crate::pipeline::ObserverSetting;
use crate::sim::scenario::{self, Scenario};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use report::Report;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Score the observers on simulated flights, where the truth is known
///
/// Flies each scenario several times with other random numbers, and with another vehicle out of the ranges that the
/// vehicle file declares, in lock-step with all observers side by side. Settling is the time until the error stays below
/// a fifth of a change. The cost of a step is that of the observer alone, on one core, on the flight's measurements.
/// Faults of a scenario are scored by the names that the estimates tell: how late, which wrong ones, and how many false
/// alarms an hour of healthy flight.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver evaluate
  mavobserver evaluate wind-steps gusts --runs 20
  mavobserver evaluate my-scenario.toml --json > scores.json
  mavobserver evaluate --observer quadratic_bounded --report scores.html
  mavobserver evaluate --experiment all

Exit codes: 0 scored, 1 an observer has no design for a vehicle or a limit is missed, 2 wrong usage or scenario.")]
pub struct EvaluateArgs {
    /// Scenarios that come with the program, or TOML files; all that come with it when none is given
    pub scenarios: Vec<String>,
    /// Repeat an experiment of a paper instead, or `all` of them; repeatable
    #[arg(long = "experiment", value_name = "NAME", conflicts_with_all = ["scenarios", "observers"])]
    pub experiments: Vec<String>,
    /// Only this observer; repeatable. All that suit the vehicle when none is given
    #[arg(long = "observer", value_name = "NAME")]
    pub observers: Vec<String>,
    /// Flights of each scenario
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub runs: u32,
    /// Seed of the first flight of each scenario, in place of its own; each further flight takes the next
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
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

/// What became of the flights of a scenario.
#[derive(Default)]
pub(super) struct Outcome {
    trial: Trial,
    failure: Option<String>,
}

/// By scenario, in the order asked for.
type Outcomes = Vec<(String, Outcome)>;

pub fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    if !args.experiments.is_empty() {
        return experiments::run(&args.experiments, args.json, args.report.as_deref());
    }
    let observers = observers(args)?;
    let scenarios = scenarios(args)?;
    let threads = args.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)).max(1);
    let outcomes = fly_all(&scenarios, args.runs, &observers, threads, args.json);
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

/// Those asked for, which then must suit every vehicle, or all, where they suit.
fn observers(args: &EvaluateArgs) -> Result<Vec<ObserverSetting>, Failure> {
    if args.observers.is_empty() {
        let all = observers::REGISTRY.iter();
        return Ok(all.map(|r| ObserverSetting { required: false, ..ObserverSetting::named(r.name) }).collect());
    }
    let asked = args.observers.iter().map(|name| observers::find(name).map(|r| ObserverSetting::named(r.name)));
    asked.collect::<Result<_, _>>().map_err(|e| Failure::Usage(e.to_string()))
}

fn scenarios(args: &EvaluateArgs) -> Result<Vec<Scenario>, Failure> {
    let names: Vec<&str> = match args.scenarios.is_empty() {
        true => scenario::names().collect(),
        false => args.scenarios.iter().map(String::as_str).collect(),
    };
    let load = |name: &str| {
        let mut scenario = scenario::resolve(name)?;
        scenario.sampled = !args.exact;
        Ok(match args.seed {
            Some(seed) => scenario.with_seed(seed),
            None => scenario,
        })
    };
    names.into_iter().map(load).collect()
}

/// Spreads the flights over threads. A design is made once and found in the cache by the flights after it.
fn fly_all(scenarios: &[Scenario], runs: u32, observers: &[ObserverSetting], threads: usize, quiet: bool) -> Outcomes {
    let flights = scenarios.len() * runs as usize;
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(flights as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} flights  {eta} left  {msg}");
    let bar = bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    let empty = scenarios.iter().map(|s| (s.name.clone(), Outcome::default()));
    let outcomes = Mutex::new(empty.collect::<Outcomes>());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads.min(flights) {
            scope.spawn(|| {
                loop {
                    // the first flights of all scenarios come first: every design is under way early
                    let flight = next.fetch_add(1, Ordering::Relaxed);
                    let (run, index) = (flight / scenarios.len().max(1), flight % scenarios.len().max(1));
                    let Some(scenario) = scenarios.get(index).filter(|_| flight < flights) else { break };
                    bar.set_message(scenario.name.clone());
                    let seed = scenario.seed().wrapping_add(run as u64);
                    let result = fly(&scenario.clone().with_seed(seed), observers);
                    // another thread's panic spoils none of the finished results
                    let mut all = outcomes.lock().unwrap_or_else(PoisonError::into_inner);
                    if let Some((_, outcome)) = all.get_mut(index) {
                        match result {
                            Ok(trial) => outcome.trial.merge(&trial),
                            Err(e) => outcome.failure = Some(e.to_string()),
                        }
                    }
                    bar.inc(1);
                }
            });
        }
    });
    bar.finish_and_clear();
    outcomes.into_inner().unwrap_or_else(PoisonError::into_inner)
}
