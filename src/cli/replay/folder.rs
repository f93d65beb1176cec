//! A folder of flights: one row for each.

use super::flight::{Flight, Outputs, replay};
use super::json;
use crate::cli::convert::logs_below;
use crate::cli::{Failure, print};
use crate::config::Config;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// One flight's row. What a log does not give stays empty.
#[derive(Debug, Serialize)]
struct Row {
    log: PathBuf,
    duration_s: f64,
    frames: u64,
    lost_share: f64,
    model: String,
    wind_mean_mps: Option<f64>,
    wind_max_mps: Option<f64>,
    force_max_n: Option<f64>,
    /// Share of steps in which the assumptions held.
    consistent_share: Option<f64>,
    faults: Vec<&'static str>,
    error: Option<String>,
}

pub(super) fn run(folder: &Path, config: Config, as_json: bool) -> Result<(), Failure> {
    let logs = logs_below(folder)?;
    let bar = ProgressBar::new(logs.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos}/{len} flights  {eta} left") {
        bar.set_style(style);
    }
    let rows = Mutex::new(Vec::with_capacity(logs.len()));
    let next = AtomicUsize::new(0);
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(log) = logs.get(index) else { return };
            let row = row(log, config.clone());
            bar.inc(1);
            if let Ok(mut rows) = rows.lock() {
                rows.push((index, row));
            }
        }
    };
    let workers = thread::available_parallelism().map_or(1, usize::from).min(logs.len().max(1));
    thread::scope(|scope| {
        (1..workers).for_each(|_| drop(scope.spawn(work)));
        work();
    });
    bar.finish_and_clear();
    // a worker that panicked has told so; the others' rows count
    let mut rows = rows.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    rows.sort_by_key(|(index, _)| *index);
    let rows: Vec<Row> = rows.into_iter().map(|(_, row)| row).collect();
    print(&if as_json { json(&rows) } else { text(folder, &rows) })
}

fn row(log: &Path, config: Config) -> Row {
    match replay(log, config, &Outputs { curves: true, ..Outputs::default() }) {
        Ok(flight) => Row::of(&flight),
        Err(e) => Row { error: Some(e.to_string()), ..Row::empty(log) },
    }
}

impl Row {
    fn empty(log: &Path) -> Self {
        Self {
            log: log.to_owned(),
            duration_s: 0.0,
            frames: 0,
            lost_share: 0.0,
            model: String::new(),
            wind_mean_mps: None,
            wind_max_mps: None,
            force_max_n: None,
            consistent_share: None,
            faults: Vec::new(),
            error: None,
        }
    }

    fn of(flight: &Flight) -> Self {
        let r = &flight.report;
        let winds = || r.vehicles.iter().flat_map(|v| &v.wind);
        let n = winds().count();
        let most = |of: fn(&super::summary::WindRow) -> f64| winds().map(of).reduce(f64::max);
        let steps: u64 = r.vehicles.iter().map(|v| v.steps).sum();
        let consistent: u64 = r.vehicles.iter().filter_map(|v| v.verdicts.get("consistent")).sum();
        Self {
            duration_s: r.duration_s,
            frames: r.frames,
            lost_share: r.lost_frames as f64 / (r.frames + r.lost_frames).max(1) as f64,
            model: r.model.clone(),
            wind_mean_mps: (n > 0).then(|| winds().map(|w| w.speed_mps).sum::<f64>() / n as f64),
            wind_max_mps: most(|w| w.speed_mps),
            force_max_n: most(|w| w.force_n),
            consistent_share: (steps > 0).then(|| consistent as f64 / steps as f64),
            faults: flight.curves.values().flat_map(|c| c.faults.iter().map(|(name, _)| *name)).collect(),
            ..Self::empty(&r.log)
        }
    }
}

fn text(folder: &Path, rows: &[Row]) -> String {
    use std::fmt::Write;
    let short = |log: &Path| log.strip_prefix(folder).unwrap_or(log).display().to_string();
    let width = rows.iter().map(|r| short(&r.log).chars().count()).max().unwrap_or(0).max(6);
    let mut s = format!(
        "{:<width$}  {:>7} {:>8} {:>6}  {:>9} {:>8} {:>7} {:>6}  faults",
        "flight", "s", "frames", "lost", "wind m/s", "max", "force N", "ok"
    );
    let number = |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| format!("{x:.digits$}"));
    for r in rows {
        let name = short(&r.log);
        let _ = match &r.error {
            Some(e) => write!(s, "\n{name:<width$}  {e}"),
            None => write!(
                s,
                "\n{name:<width$}  {:>7.0} {:>8} {:>5.1}%  {:>9} {:>8} {:>7} {:>6}  {}",
                r.duration_s,
                r.frames,
                100.0 * r.lost_share,
                number(r.wind_mean_mps, 1),
                number(r.wind_max_mps, 1),
                number(r.force_max_n, 1),
                r.consistent_share.map_or("–".to_owned(), |x| format!("{:.0}%", 100.0 * x)),
                if r.faults.is_empty() { "–".to_owned() } else { r.faults.join(" ") },
            ),
        };
    }
    s
}
