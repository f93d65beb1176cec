use crate::cli::{Failure, print};
use crate::evaluate::experiments::{EXPERIMENTS, Experiment, ExperimentError, Figure, Findings, Limit, find};
use serde::Serialize;
use std::fmt::Write;

/// An experiment and what it found.
#[derive(Debug, Serialize)]
struct Outcome {
    name: &'static str,
    paper: &'static str,
    about: &'static str,
    #[serde(flatten)]
    findings: Findings,
}

/// Runs experiments by name, or all; a figure that misses its limit is a failure.
pub(super) fn run(names: &[String], json: bool) -> Result<(), Failure> {
    let mut results = Vec::new();
    for experiment in chosen(names)? {
        tracing::info!("experiment {}", experiment.name);
        let findings = (experiment.run)().map_err(|e| Failure::Failed(e.to_string()))?;
        results.push(Outcome { name: experiment.name, paper: experiment.paper, about: experiment.about, findings });
    }
    let json_text = || serde_json::to_string_pretty(&results).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"));
    print(&if json { json_text() } else { results.iter().map(text).collect::<Vec<_>>().join("\n") })?;
    let missed: Vec<String> =
        results.iter().flat_map(|r| r.findings.missed().map(|f| format!("{}: {}", r.name, line(f)))).collect();
    if missed.is_empty() { Ok(()) } else { Err(Failure::Failed(format!("limits missed:\n{}", missed.join("\n")))) }
}

fn chosen(names: &[String]) -> Result<Vec<&'static Experiment>, Failure> {
    if names.iter().any(|n| n == "all") {
        return Ok(EXPERIMENTS.iter().collect());
    }
    names.iter().map(|n| find(n).map_err(|e: ExperimentError| Failure::Usage(e.to_string()))).collect()
}

fn text(r: &Outcome) -> String {
    // writing to a String cannot fail
    let mut out = format!("{} ({})\n{}\n", r.name, r.paper, r.about);
    for f in &r.findings.figures {
        let _ = writeln!(out, "  {}", line(f));
    }
    for remark in &r.findings.remarks {
        let _ = writeln!(out, "  note: {remark}");
    }
    out
}

fn line(f: &Figure) -> String {
    let limit = match f.limit {
        None => String::new(),
        Some(Limit::AtMost(x)) => format!("  (at most {x} {})", f.unit),
        Some(Limit::AtLeast(x)) => format!("  (at least {x} {})", f.unit),
    };
    let missed = if f.met() { "" } else { "  MISSED" };
    format!("{:58} {:>12.5} {}{limit}{missed}", f.what, f.value, f.unit)
}
