use super::sheet::{Compared, Sheet, write};
use super::{cascade_gnss_ins, fuzzy_polynomial, quadratic_bounded, unknown_input};
use crate::cli::{Failure, print};
use crate::report::{Cell, Column, Page, Section, Table, Tone};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::time::Instant;

const EXAMPLES: &str = "Examples:
  mavobserver design all --report report.html
  mavobserver design all --json";

/// Every paper's tables, reproduced and set beside the published ones
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    /// Write one self-contained HTML page
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// What each observer publishes, one line each.
const PUBLISHED: &[fn() -> Result<Sheet, Failure>] =
    &[quadratic_bounded::published, fuzzy_polynomial::published, cascade_published, unknown_published];

/// The paper prints no gains, so there is nothing to set beside ours.
fn unknown_published() -> Result<Sheet, Failure> {
    by_command_line(unknown_input::run, &[])
}

/// The example of section 5.2 of Grip, Saberi and Johansen; its gains are one solver's stopping point, see `design`.
fn cascade_published() -> Result<Sheet, Failure> {
    const PRINTED: [[f64; 2]; 3] = [[128.9, 17.5], [15.7, 2.4], [1.3, 0.2]];
    let sheet = by_command_line(cascade_gnss_ins::run, &["--gamma", "50", "--gamma-n", "1.002"])?;
    let gain = |i: usize, j: usize| sheet.rows.first().and_then(|r| r["gain"][i][j].as_f64()).unwrap_or(f64::NAN);
    let entry = |(i, j): (usize, usize)| Compared {
        what: format!("K{}{}", i + 1, j + 1),
        ours: gain(i, j),
        reference: Some(PRINTED[i][j]),
        tolerance: 0.2,
    };
    let compared = (0..3).flat_map(|i| (0..2).map(move |j| (i, j))).map(entry).collect();
    let paper = "Grip, Saberi, Johansen: Observers for interconnected nonlinear and linear systems (2012)";
    Ok(Sheet { compared, paper, ..sheet })
}

/// A design as its own command line gives it.
fn by_command_line<A: clap::Args>(run: fn(&A) -> Result<Sheet, Failure>, words: &[&str]) -> Result<Sheet, Failure> {
    let usage = |e: clap::Error| Failure::Usage(e.to_string());
    let command = A::augment_args(clap::Command::new("design").no_binary_name(true));
    let matches = command.try_get_matches_from(words).map_err(usage)?;
    run(&A::from_arg_matches(&matches).map_err(usage)?)
}

pub fn run(args: &Args) -> Result<(), Failure> {
    let mut sheets = Vec::new();
    for published in PUBLISHED {
        let begun = Instant::now();
        let sheet = published()?;
        sheets.push((sheet, begun.elapsed().as_secs_f64()));
    }
    if let Some(path) = &args.report {
        let html = page(&sheets).html().map_err(|e| Failure::Failed(e.to_string()))?;
        write(path, &html)?;
    }
    let astray = || sheets.iter().flat_map(|(s, _)| s.compared.iter().filter(|c| !c.agrees()).map(move |c| (s, c)));
    if args.json {
        let one = |(s, seconds): &(Sheet, f64)| {
            let mut object = s.json();
            object["seconds"] = json!(seconds);
            object
        };
        print(&format!("{:#}", json!({ "observers": sheets.iter().map(one).collect::<Vec<Value>>() })))?;
    } else {
        let text: Vec<&str> = sheets.iter().map(|(s, _)| s.text.trim_end()).collect();
        print(&text.join("\n\n"))?;
    }
    let astray: Vec<String> = astray().map(|(s, c)| format!("{} {}", s.observer, c.what)).collect();
    if astray.is_empty() {
        return Ok(());
    }
    Err(Failure::Failed(format!(
        "these differ from the published figures by more than expected: {}",
        astray.join("; ")
    )))
}

fn page(sheets: &[(Sheet, f64)]) -> Page {
    let count: usize = sheets.iter().map(|(s, _)| s.rows.len()).sum();
    let seconds: f64 = sheets.iter().map(|s| s.1).sum();
    let compared = || sheets.iter().flat_map(|(s, _)| &s.compared).filter(|c| c.reference.is_some());
    let agreeing = compared().filter(|c| c.agrees()).count();
    let mut table = Table::new([
        Column::text("observer"),
        Column::text("plant"),
        Column::number("designs"),
        Column::number("references met"),
        Column::number("smallest margin"),
        Column::number("in the solver, s"),
        Column::number("altogether, s"),
    ]);
    for (s, seconds) in sheets {
        let (margin, solver) = s.margin_and_seconds();
        let all = s.compared.iter().filter(|c| c.reference.is_some()).count();
        let met = s.compared.iter().filter(|c| c.reference.is_some() && c.agrees()).count();
        table.push([
            Cell::text(s.observer),
            Cell::text(s.plant.clone()),
            Cell::text(s.rows.len().to_string()),
            Cell::text(format!("{met} of {all}")).tone(if met == all { Tone::Good } else { Tone::Bad }),
            Cell::number(margin),
            Cell::fixed(solver, 2),
            Cell::fixed(*seconds, 2),
        ]);
    }
    let summary = Section::new("All of them").table(table).paragraph(
        "A margin is the smallest eigenvalue of any inequality with its diagonal scaled to one, computed outside the \
         solver, less rounding: positive means that the design is proven.",
    );
    sheets.iter().fold(
        Page::new("Designs beside what their papers print")
            .lead("Every table is computed anew, and every row is checked outside the solver before it is shown.")
            .fact("designs", count.to_string())
            .fact("references met", format!("{agreeing} of {}", compared().count()))
            .fact("time", format!("{seconds:.1} s"))
            .section(summary),
        |page, (s, _)| page.section(s.section()),
    )
}
