use crate::cli::{Failure, print};
use crate::evaluate::experiments::{EXPERIMENTS, Experiment, ExperimentError, Figure, Findings, Limit, find};
use crate::report::{Cell, Colour, Column, Figure as Picture, Page, Panel, ReportError, Section, Table, Tone};
use serde::Serialize;
use std::fmt::Write;
use std::path::Path;

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
pub(super) fn run(names: &[String], json: bool, report: Option<&Path>) -> Result<(), Failure> {
    let mut results = Vec::new();
    for experiment in chosen(names)? {
        tracing::info!("experiment {}", experiment.name);
        let findings = (experiment.run)().map_err(|e| Failure::Failed(e.to_string()))?;
        results.push(Outcome { name: experiment.name, paper: experiment.paper, about: experiment.about, findings });
    }
    if let Some(path) = report {
        let html = page(&results).map_err(|e| Failure::Failed(e.to_string()))?;
        std::fs::write(path, html).map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))?;
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

fn page(results: &[Outcome]) -> Result<String, ReportError> {
    let mut page = Page::new("Experiments of the papers")
        .lead("Flown again; every figure that has a limit says whether it keeps it.");
    for r in results {
        let mut section = Section::new(r.name).paragraph(format!("{}. {}", r.paper, r.about));
        let mut table =
            Table::new([Column::text("figure"), Column::number("value"), Column::text("unit"), Column::text("limit")]);
        for f in &r.findings.figures {
            let limit = match f.limit {
                None => String::new(),
                Some(Limit::AtMost(x)) => format!("at most {x}"),
                Some(Limit::AtLeast(x)) => format!("at least {x}"),
            };
            let tone = match f.limit {
                None => Tone::Plain,
                Some(_) if f.met() => Tone::Good,
                Some(_) => Tone::Bad,
            };
            table.push([Cell::text(&f.what), Cell::number(f.value).tone(tone), Cell::text(f.unit), Cell::text(limit)]);
        }
        section = section.table(table).list(r.findings.remarks.iter().cloned());
        for trace in &r.findings.traces {
            let mut panel = Panel::new("", trace.unit);
            for (k, (name, values)) in trace.lines.iter().enumerate() {
                let points = trace.t_s.iter().zip(values).map(|(t, v)| [*t, *v]);
                panel = panel.line(name, Colour::nth(k), points);
            }
            section = section.figure(Picture::new(&trace.title).x("time", "s").panel(panel), "");
        }
        page = page.section(section);
    }
    page.html()
}
