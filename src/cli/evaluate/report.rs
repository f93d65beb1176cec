use super::Outcomes;
use crate::evaluate::{Quantity, Stats, Trial};
use crate::report::{Cell, Column, Page, ReportError, Section, Table};
use serde::Serialize;
use std::fmt::Write;

/// Scores, ready to be shown.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    runs: u32,
    rows: Vec<Row>,
    failures: Vec<Failed>,
}

/// A scenario that could not be scored.
#[derive(Debug, Serialize)]
struct Failed {
    scenario: String,
    observer: String,
    problem: String,
}

/// One quantity of one observer in one scenario.
#[derive(Debug, Serialize)]
struct Row {
    scenario: String,
    observer: String,
    /// Where the quantity comes from: the observer, or what is made of it (`wind`).
    source: String,
    quantity: String,
    unit: &'static str,
    flights: u32,
    /// Root mean square of the vector error.
    rmse: f64,
    /// Share of instants at which all components lay within their bounds.
    coverage: Option<f64>,
    mean_half_width: Option<f64>,
    settling_median_s: Option<f64>,
    changes_followed: usize,
    changes_missed: u32,
    /// Share of airborne steps at which the observer said that its assumptions are broken.
    violated: f64,
    us_per_step: f64,
    signals: Vec<SignalRow>,
}

#[derive(Debug, Serialize)]
struct SignalRow {
    name: &'static str,
    #[serde(flatten)]
    stats: Stats,
}

impl Report {
    pub fn new(outcomes: &Outcomes, runs: u32) -> Self {
        let mut report = Self { runs, rows: Vec::new(), failures: Vec::new() };
        for ((scenario, observer), outcome) in outcomes {
            if let Some(problem) = &outcome.failure {
                report.failures.push(Failed {
                    scenario: scenario.clone(),
                    observer: observer.clone(),
                    problem: problem.clone(),
                });
            }
            let trial = &outcome.trial;
            for ((source, name), quantity) in &trial.quantities {
                report.rows.extend(Row::new(scenario, observer, source, name, quantity, trial));
            }
        }
        report
    }

    pub fn failures(&self) -> Vec<String> {
        self.failures.iter().map(|f| f.problem.clone()).collect()
    }

    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"))
    }

    pub fn text(&self) -> String {
        let mut out = format!(
            "{:18} {:18} {:7} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8} {:>8}\n",
            "scenario", "source", "what", "RMSE", "95 %", "covered", "bound ±", "settled", "violated", "µs/step"
        );
        for r in &self.rows {
            // writing to a String cannot fail
            let _ = writeln!(
                out,
                "{:18} {:18} {:7} {:>5.3} {:3} {:>9.3} {:>9} {:>9} {:>9} {:>8} {:>8.1}",
                r.scenario,
                r.source,
                r.quantity,
                r.rmse,
                r.unit,
                r.p95(),
                percent(r.coverage),
                number(r.mean_half_width, ""),
                settled(r),
                percent(Some(r.violated)),
                r.us_per_step
            );
        }
        let _ = write!(
            out,
            "\n{} flights each; RMSE of the vector, 95 % of the worst axis; settled: median time, followed/changes",
            self.runs
        );
        out
    }

    pub fn html(&self) -> Result<String, ReportError> {
        let columns = [
            Column::text("scenario"),
            Column::text("source"),
            Column::text("what"),
            Column::number("RMSE"),
            Column::number("95 %"),
            Column::number("covered"),
            Column::number("bound ±"),
            Column::number("settled"),
            Column::number("violated"),
            Column::number("µs/step"),
        ];
        let mut table = Table::new(columns);
        let mut scenario = "";
        for r in &self.rows {
            let cells = [
                Cell::text(if r.scenario == scenario { "" } else { &r.scenario }).hint(r.components()),
                Cell::text(&r.source),
                Cell::text(format!("{}, {}", r.quantity, r.unit)),
                // how much of the bound the error takes
                Cell::fixed(r.rmse, 3).bar(r.mean_half_width.map_or(0.0, |w| r.rmse / w)).hint(r.components()),
                Cell::fixed(r.p95(), 3),
                Cell::percent(r.coverage),
                Cell::maybe(r.mean_half_width),
                Cell::text(settled(r)),
                Cell::percent(Some(r.violated)),
                Cell::fixed(r.us_per_step, 1),
            ];
            if r.scenario == scenario {
                table.push(cells)
            } else {
                table.push_group(cells)
            }
            scenario = &r.scenario;
        }
        let scores = Section::new("Scores").table(table).paragraph(
            "The bar shows the error within the mean bound. RMSE is that of the vector, 95 % that of the worst axis. \
             Settled: median time, and changes followed of all. Hold the pointer over a number for its components.",
        );
        let page = Page::new("Estimates against the truth")
            .lead(format!(
                "{} simulated flights of each scenario, each with its own random numbers and a vehicle drawn from the \
                 ranges that its file declares.",
                self.runs
            ))
            .section(scores);
        let mut failed = Table::new([Column::text("scenario"), Column::text("observer"), Column::text("problem")]);
        for f in &self.failures {
            failed.push([&f.scenario, &f.observer, &f.problem].map(Cell::text));
        }
        let page = if failed.is_empty() { page } else { page.section(Section::new("Not scored").table(failed)) };
        page.html()
    }
}

impl Row {
    fn new(scenario: &str, observer: &str, source: &str, quantity: &str, q: &Quantity, trial: &Trial) -> Option<Self> {
        let signals: Vec<SignalRow> = q
            .signals
            .iter()
            .filter_map(|(name, (_, errors))| errors.stats().map(|stats| SignalRow { name, stats }))
            .collect();
        let (_, (unit, _)) = q.signals.first_key_value()?;
        let widths: Option<Vec<f64>> = signals.iter().map(|s| s.stats.mean_half_width).collect();
        Some(Self {
            scenario: scenario.to_owned(),
            observer: observer.to_owned(),
            source: source.to_owned(),
            quantity: quantity.to_owned(),
            unit,
            flights: trial.flights,
            rmse: signals.iter().map(|s| s.stats.rmse.powi(2)).sum::<f64>().sqrt(),
            coverage: (q.bounded > 0).then(|| q.covered as f64 / q.bounded as f64),
            mean_half_width: widths.map(|w| w.iter().sum::<f64>() / w.len().max(1) as f64),
            settling_median_s: q.settling.median_s(),
            changes_followed: q.settling.times_s.len(),
            changes_missed: q.settling.missed,
            violated: trial.violated as f64 / trial.steps.max(1) as f64,
            us_per_step: trial.busy.as_secs_f64() * 1e6 / trial.steps.max(1) as f64,
            signals,
        })
    }
}

impl Row {
    /// 95 % of the errors of the worst axis are smaller.
    fn p95(&self) -> f64 {
        self.signals.iter().map(|s| s.stats.p95).fold(0.0, f64::max)
    }

    fn components(&self) -> String {
        let lines = self.signals.iter().map(|SignalRow { name, stats: s }| {
            format!("{name}: RMSE {:.4}, bias {:+.4}, 95 % {:.4}", s.rmse, s.bias, s.p95)
        });
        lines.collect::<Vec<_>>().join("\n")
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |s| format!("{:.1} %", s * 100.0))
}

fn number(x: Option<f64>, unit: &str) -> String {
    x.map_or_else(|| "–".to_owned(), |x| format!("{x:.3} {unit}").trim_end().to_owned())
}

fn settled(r: &Row) -> String {
    let changes = r.changes_followed + r.changes_missed as usize;
    match r.settling_median_s {
        _ if changes == 0 => "–".to_owned(),
        Some(s) => format!("{s:.1} s {}/{changes}", r.changes_followed),
        None => format!("0/{changes}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::evaluate::Outcome;

    #[test]
    fn failures_are_rows_too_and_nothing_breaks_the_page() {
        let failure = Some("no design: <α & β>".to_owned());
        let outcomes = [(("a".to_owned(), "b".to_owned()), Outcome { failure, ..Outcome::default() })].into();
        let report = Report::new(&outcomes, 3);
        assert!(report.html().unwrap().contains("no design: &lt;α &amp; β&gt;"));
        assert_eq!(report.failures(), ["no design: <α & β>"]);
        assert!(report.json().contains("\"runs\": 3"));
    }
}
