//! A folder of flights: one row for each.

use super::flight::{Flight, Outputs, replay};
use super::json;
use crate::cli::convert::logs_below;
use crate::cli::{Failure, print};
use crate::config::Config;
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// One flight's row. What a log does not give stays empty.
#[derive(Debug, Serialize)]
struct Row {
    log: PathBuf,
    /// s since 1970.
    began_unix_s: Option<f64>,
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
    /// Mean effectiveness of each rotor, in order, of a log with one vehicle.
    rotors: Vec<f64>,
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
            began_unix_s: None,
            duration_s: 0.0,
            frames: 0,
            lost_share: 0.0,
            model: String::new(),
            wind_mean_mps: None,
            wind_max_mps: None,
            force_max_n: None,
            consistent_share: None,
            faults: Vec::new(),
            rotors: Vec::new(),
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
            began_unix_s: r.began_unix_s,
            duration_s: r.duration_s,
            frames: r.frames,
            lost_share: r.lost_frames as f64 / (r.frames + r.lost_frames).max(1) as f64,
            model: r.model.clone(),
            wind_mean_mps: (n > 0).then(|| winds().map(|w| w.speed_mps).sum::<f64>() / n as f64),
            wind_max_mps: most(|w| w.speed_mps),
            force_max_n: most(|w| w.force_n),
            consistent_share: (steps > 0).then(|| consistent as f64 / steps as f64),
            faults: flight.curves.values().flat_map(|c| c.faults.iter().map(|(name, _)| *name)).collect(),
            rotors: match &r.vehicles[..] {
                [one] => one.rotors.iter().map(|rotor| rotor.mean_effectiveness).collect(),
                _ => Vec::new(),
            },
            ..Self::empty(&r.log)
        }
    }
}

fn text(folder: &Path, rows: &[Row]) -> String {
    use std::fmt::Write;
    let short = |log: &Path| log.strip_prefix(folder).unwrap_or(log).display().to_string();
    let width = rows.iter().map(|r| short(&r.log).chars().count()).max().unwrap_or(0).max(6);
    let mut s = format!(
        "{:<width$}  {:>7} {:>8} {:>6}  {:>9} {:>8} {:>7} {:>6}  {:<23}  faults",
        "flight", "s", "frames", "lost", "wind m/s", "max", "force N", "ok", "rotors give, %"
    );
    let number = |x: Option<f64>, digits: usize| x.map_or("–".to_owned(), |x| format!("{x:.digits$}"));
    for r in rows {
        let name = short(&r.log);
        let _ = match &r.error {
            Some(e) => write!(s, "\n{name:<width$}  {e}"),
            None => write!(
                s,
                "\n{name:<width$}  {:>7.0} {:>8} {:>5.1}%  {:>9} {:>8} {:>7} {:>6}  {:<23}  {}",
                r.duration_s,
                r.frames,
                100.0 * r.lost_share,
                number(r.wind_mean_mps, 1),
                number(r.wind_max_mps, 1),
                number(r.force_max_n, 1),
                r.consistent_share.map_or("–".to_owned(), |x| format!("{:.0}%", 100.0 * x)),
                percents(&r.rotors),
                if r.faults.is_empty() { "–".to_owned() } else { r.faults.join(" ") },
            ),
        };
    }
    for trend in trends(rows) {
        let _ = write!(s, "\n{trend}");
    }
    s
}

fn percents(shares: &[f64]) -> String {
    if shares.is_empty() {
        return "–".to_owned();
    }
    shares.iter().map(|x| format!("{:.0}", 100.0 * x)).collect::<Vec<_>>().join(" ")
}

/// A rotor that loses more than this share of its thrust from flight to flight, in the mean, is worth a look.
const WEARS: f64 = 0.002;
/// Over fewer flights three standard errors are too easily chance.
const FLIGHTS: usize = 8;

/// Rotors whose effectiveness falls over the flights of one model, by a line through all of them in the order of their
/// times. Flights of one model are taken for those of one vehicle.
fn trends(rows: &[Row]) -> Vec<String> {
    let mut dated: Vec<(f64, &Row)> = rows.iter().filter_map(|r| Some((r.began_unix_s?, r))).collect();
    dated.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut models: BTreeMap<&str, Vec<&[f64]>> = BTreeMap::new();
    for (_, row) in dated.iter().filter(|(_, r)| !r.rotors.is_empty()) {
        models.entry(&row.model).or_default().push(&row.rotors);
    }
    let mut told = Vec::new();
    for (model, flights) in models.iter().filter(|(_, flights)| flights.len() >= FLIGHTS) {
        for rotor in 0..flights[0].len() {
            let course: Vec<f64> = flights.iter().filter_map(|f| f.get(rotor).copied()).collect();
            let (slope, error) = line(&course);
            if slope < -WEARS && -slope > 3.0 * error {
                let (lost, of) = (-100.0 * slope, 100.0 * error);
                let n = course.len();
                told.push(format!("{model}: rotor {} loses {lost:.1} ± {of:.1} % a flight, over {n}", rotor + 1));
            }
        }
    }
    told
}

/// Slope of the line through equally spaced values, by least squares, and its standard error. At least three values.
fn line(y: &[f64]) -> (f64, f64) {
    let n = y.len() as f64;
    let (mean_x, mean_y) = ((n - 1.0) / 2.0, y.iter().sum::<f64>() / n);
    let x = |i: usize| i as f64 - mean_x;
    let sxx: f64 = (0..y.len()).map(|i| x(i) * x(i)).sum();
    let slope = y.iter().enumerate().map(|(i, y)| x(i) * (y - mean_y)).sum::<f64>() / sxx;
    let rest: f64 = y.iter().enumerate().map(|(i, y)| (y - mean_y - slope * x(i)).powi(2)).sum();
    (slope, (rest / (n - 2.0) / sxx).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flights(rotor: impl Fn(usize) -> f64, count: usize) -> Vec<Row> {
        let row = |k: usize| Row {
            began_unix_s: Some(1e9 + 3_600.0 * k as f64),
            model: "quad".to_owned(),
            rotors: vec![1.0, rotor(k)],
            ..Row::empty(Path::new("a.tlog"))
        };
        // by name they may stand in any order
        (0..count).rev().map(row).collect()
    }

    #[test]
    fn a_rotor_that_wears_is_named_and_scatter_is_not() {
        let scatter = |k: usize| if k.is_multiple_of(2) { 0.004 } else { -0.004 };
        let worn = flights(|k| 1.0 - 0.01 * k as f64 + scatter(k), 10);
        assert_eq!(trends(&worn), ["quad: rotor 2 loses 1.0 ± 0.0 % a flight, over 10"]);
        assert!(trends(&flights(scatter, 10)).is_empty());
        assert!(trends(&worn[..FLIGHTS - 1]).is_empty(), "too few to tell");
    }

    #[test]
    fn a_line_is_found_with_its_error() {
        let (slope, error) = line(&[0.0, 1.0, 2.0, 3.0]);
        assert!((slope - 1.0).abs() < 1e-12 && error < 1e-12);
        let (slope, error) = line(&[0.0, 1.0, 0.0, 1.0]);
        // by hand: Σxy/Σx² = 1/5, residual sum 0.8, s² = 0.4, √(0.4/5)
        assert!((slope - 0.2).abs() < 1e-12 && (error - 0.08f64.sqrt()).abs() < 1e-12);
    }
}
