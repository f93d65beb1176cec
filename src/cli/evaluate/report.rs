use super::{Outcomes, page};
use crate::evaluate::{Conduct, Quantity, Stats, Told, Trial};
use crate::report::ReportError;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Scores, ready to be shown.
#[derive(Debug, Default, Serialize)]
pub(super) struct Report {
    pub runs: u32,
    pub rows: Vec<Row>,
    pub faults: Vec<FaultRow>,
    pub scenarios: Vec<ScenarioRow>,
    /// Scenarios that were not scored.
    pub failures: Vec<Problem>,
    /// Observers that do not suit a scenario's vehicle.
    pub left_out: Vec<Problem>,
}

/// A scenario that could not be scored, or an observer that was left out of it.
#[derive(Debug, Serialize)]
pub(super) struct Problem {
    pub scenario: String,
    pub problem: String,
}

/// One quantity of one observer in one scenario.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    pub scenario: String,
    /// Where the quantity comes from: an observer, or what is made of it (`wind`).
    pub source: String,
    pub quantity: String,
    pub unit: &'static str,
    pub flights: u32,
    /// Root mean square of the vector error.
    pub rmse: f64,
    /// Length of the vector of mean errors.
    pub bias: f64,
    /// 95 % of the errors of the worst axis are smaller.
    pub p95: f64,
    /// Share of instants at which all components lay within their bounds.
    pub coverage: Option<f64>,
    pub mean_half_width: Option<f64>,
    pub settling_median_s: Option<f64>,
    pub changes_followed: usize,
    pub changes_missed: u32,
    /// Share of airborne steps at which the source said that its assumptions are broken, and at which it had no answer.
    pub violated: f64,
    pub starved: f64,
    /// Of the observer alone; none for what is made of another's answer.
    pub us_per_step: Option<f64>,
    pub signals: Vec<SignalRow>,
}

#[derive(Debug, Serialize)]
pub(super) struct SignalRow {
    pub name: &'static str,
    #[serde(flatten)]
    pub stats: Stats,
}

/// How the faults of one name were told in one scenario.
#[derive(Debug, Serialize)]
pub(super) struct FaultRow {
    pub scenario: String,
    pub fault: String,
    pub happened: u32,
    /// Share told in time.
    pub told: f64,
    pub median_delay_s: Option<f64>,
    pub p95_delay_s: Option<f64>,
    pub misnamed: u32,
    pub median_clear_s: Option<f64>,
}

/// What belongs to a whole scenario.
#[derive(Debug, Serialize)]
pub(super) struct ScenarioRow {
    pub scenario: String,
    pub flights: u32,
    pub crashes: u32,
    pub airborne_h: f64,
    /// Decoding, alignment and all observers together.
    pub us_per_step: f64,
    pub healthy_h: f64,
    pub false_alarms: BTreeMap<&'static str, u32>,
    pub false_alarms_per_h: Option<f64>,
    pub wrong_names: BTreeMap<&'static str, u32>,
}

impl Report {
    pub fn new(outcomes: &Outcomes, runs: u32) -> Self {
        let mut report = Self { runs, ..Self::default() };
        for (scenario, outcome) in outcomes {
            let trial = &outcome.trial;
            let problem = |text: &String| Problem { scenario: scenario.clone(), problem: text.clone() };
            report.failures.extend(outcome.failure.iter().map(problem));
            report.left_out.extend(trial.left_out.iter().map(problem));
            for ((source, name), quantity) in &trial.quantities {
                let conduct = trial.conduct.get(source).cloned().unwrap_or_default();
                report.rows.extend(Row::new(scenario, source, name, quantity, &conduct, trial.flights));
            }
            let told = trial.detection.faults.iter();
            report.faults.extend(told.map(|(name, told)| FaultRow::new(scenario, name, told)));
            if trial.flights > 0 {
                report.scenarios.push(ScenarioRow::new(scenario, trial));
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

    pub fn html(&self) -> Result<String, ReportError> {
        page::of(self).html()
    }

    pub fn text(&self) -> String {
        let mut out = String::new();
        // writing to a String cannot fail
        let _ = self.write_text(&mut out);
        out
    }

    fn write_text(&self, out: &mut String) -> std::fmt::Result {
        writeln!(
            out,
            "{:18} {:18} {:8} {:>9} {:>8} {:>8} {:>8} {:>8} {:>9} {:>8} {:>8}",
            "scenario",
            "source",
            "what",
            "RMSE",
            "bias",
            "95 %",
            "covered",
            "bound ±",
            "settled",
            "violated",
            "µs/step"
        )?;
        for r in &self.rows {
            writeln!(
                out,
                "{:18} {:18} {:8} {:>5.3} {:3} {:>8.3} {:>8.3} {:>8} {:>8} {:>9} {:>8} {:>8}",
                r.scenario,
                r.source,
                r.quantity,
                r.rmse,
                r.unit,
                r.bias,
                r.p95,
                percent(r.coverage),
                number(r.mean_half_width, 3),
                settled(r),
                percent(Some(r.violated)),
                number(r.us_per_step, 1)
            )?;
        }
        if !self.faults.is_empty() {
            writeln!(
                out,
                "\n{:18} {:14} {:>8} {:>8} {:>12} {:>9} {:>9} {:>9}",
                "scenario", "fault", "happened", "told", "median delay", "95 %", "misnamed", "cleared"
            )?;
        }
        for f in &self.faults {
            writeln!(
                out,
                "{:18} {:14} {:>8} {:>8} {:>12} {:>9} {:>9} {:>9}",
                f.scenario,
                f.fault,
                f.happened,
                percent(Some(f.told)),
                seconds(f.median_delay_s),
                seconds(f.p95_delay_s),
                f.misnamed,
                seconds(f.median_clear_s)
            )?;
        }
        for p in &self.left_out {
            writeln!(out, "{:18} {}", p.scenario, p.problem)?;
        }
        let (hours, alarms) = self.alarms();
        write!(
            out,
            "\n{} flights each; RMSE and bias of the vector, 95 % of the worst axis; settled: median time, \
             followed/changes\n{hours:.2} h of healthy flight: {alarms} false alarms",
            self.runs
        )
    }

    /// Hours of healthy flight, and the false alarms in them.
    pub fn alarms(&self) -> (f64, u32) {
        let count = |s: &ScenarioRow| s.false_alarms.values().sum::<u32>();
        (self.scenarios.iter().map(|s| s.healthy_h).sum(), self.scenarios.iter().map(count).sum())
    }
}

impl Row {
    fn new(
        scenario: &str,
        source: &str,
        quantity: &str,
        q: &Quantity,
        conduct: &Conduct,
        flights: u32,
    ) -> Option<Self> {
        let signals: Vec<SignalRow> = q
            .signals
            .iter()
            .filter_map(|(name, (_, errors))| errors.stats().map(|stats| SignalRow { name, stats }))
            .collect();
        let (_, (unit, _)) = q.signals.first_key_value()?;
        let widths: Option<Vec<f64>> = signals.iter().map(|s| s.stats.mean_half_width).collect();
        let length = |of: fn(&Stats) -> f64| signals.iter().map(|s| of(&s.stats).powi(2)).sum::<f64>().sqrt();
        let share = |n: u64| n as f64 / conduct.steps.max(1) as f64;
        Some(Self {
            scenario: scenario.to_owned(),
            source: source.to_owned(),
            quantity: quantity.to_owned(),
            unit,
            flights,
            rmse: length(|s| s.rmse),
            bias: length(|s| s.bias),
            p95: signals.iter().map(|s| s.stats.p95).fold(0.0, f64::max),
            coverage: (q.bounded > 0).then(|| q.covered as f64 / q.bounded as f64),
            mean_half_width: widths.map(|w| w.iter().sum::<f64>() / w.len().max(1) as f64),
            settling_median_s: q.settling.median_s(),
            changes_followed: q.settling.times_s.len(),
            changes_missed: q.settling.missed,
            violated: share(conduct.violated),
            starved: share(conduct.starved),
            us_per_step: conduct.us_per_step(),
            signals,
        })
    }

    /// Figures of each axis.
    pub fn components(&self) -> String {
        let lines = self.signals.iter().map(|SignalRow { name, stats: s }| {
            format!("{name}: RMSE {:.4}, bias {:+.4}, 95 % {:.4}", s.rmse, s.bias, s.p95)
        });
        lines.collect::<Vec<_>>().join("\n")
    }
}

impl FaultRow {
    fn new(scenario: &str, fault: &str, told: &Told) -> Self {
        Self {
            scenario: scenario.to_owned(),
            fault: fault.to_owned(),
            happened: told.happened,
            told: told.share(),
            median_delay_s: told.delay_s(0.5),
            p95_delay_s: told.delay_s(0.95),
            misnamed: told.misnamed,
            median_clear_s: told.median_clear_s(),
        }
    }
}

impl ScenarioRow {
    fn new(scenario: &str, trial: &Trial) -> Self {
        let detection = &trial.detection;
        Self {
            scenario: scenario.to_owned(),
            flights: trial.flights,
            crashes: trial.crashes,
            airborne_h: trial.airborne_s / 3600.0,
            us_per_step: trial.busy.as_secs_f64() * 1e6 / trial.steps.max(1) as f64,
            healthy_h: detection.healthy_s / 3600.0,
            false_alarms: detection.false_alarms.clone(),
            false_alarms_per_h: detection.false_alarms_per_hour(),
            wrong_names: detection.wrong.clone(),
        }
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |s| format!("{:.1} %", s * 100.0))
}

fn number(x: Option<f64>, places: usize) -> String {
    x.map_or_else(|| "–".to_owned(), |x| format!("{x:.places$}"))
}

fn seconds(x: Option<f64>) -> String {
    x.map_or_else(|| "–".to_owned(), |x| format!("{x:.2} s"))
}

/// Median time, and changes followed of all.
pub(super) fn settled(r: &Row) -> String {
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
    fn failures_are_shown_and_nothing_breaks_the_page() {
        let mut trial = Trial { flights: 3, airborne_s: 3600.0, ..Trial::default() };
        trial.left_out.insert("vehicle `x`: not <α & β>".to_owned());
        trial.detection.healthy_s = 1800.0;
        trial.detection.false_alarms.insert("gyro", 2);
        let told = Told { happened: 2, delays_s: vec![0.25], ..Told::default() };
        trial.detection.faults.insert("rotor_lost", told);
        let report =
            Report::new(&vec![("a".to_owned(), Outcome { trial, failure: Some("no <design>".to_owned()) })], 3);
        let page = report.html().unwrap();
        assert!(page.contains("not &lt;α &amp; β&gt;") && page.contains("rotor_lost") && page.contains("50.0 %"));
        assert_eq!(report.failures(), ["no <design>"]);
        let json: serde_json::Value = serde_json::from_str(&report.json()).unwrap();
        assert_eq!(json["scenarios"][0]["false_alarms_per_h"], 4.0);
        assert_eq!(json["faults"][0]["median_delay_s"], 0.25);
        assert!(report.text().contains("0.50 h of healthy flight: 2 false alarms"), "{}", report.text());
    }
}
