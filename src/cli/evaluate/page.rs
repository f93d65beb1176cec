use super::report::{FaultRow, Report, Row, settled};
use crate::report::{Cell, Column, Page, Section, Table, Tone};
use std::collections::BTreeMap;

/// The scores as a page.
pub(super) fn of(report: &Report) -> Page {
    let (hours, alarms) = report.alarms();
    let flown: f64 = report.scenarios.iter().map(|s| s.airborne_h).sum();
    let mut page = Page::new("Estimates against the truth")
        .lead(
            "Simulated flights, each with its own random numbers and a vehicle drawn from the ranges that its file \
             declares, with all observers side by side.",
        )
        .fact("flights of each scenario", report.runs.to_string())
        .fact("in the air", format!("{flown:.2} h"))
        .fact("healthy", format!("{hours:.2} h"))
        .fact("false alarms", alarms.to_string())
        .section(scores(&report.rows));
    if !report.faults.is_empty() {
        page = page.section(faults(&report.faults));
    }
    page = page.section(scenarios(report));
    for (heading, problems) in [("Not scored", &report.failures), ("Observers left out", &report.left_out)] {
        if !problems.is_empty() {
            let mut table = Table::new(["scenario", "reason"].map(Column::text));
            for p in problems {
                table.push([&p.scenario, &p.problem].map(Cell::text));
            }
            page = page.section(Section::new(heading).table(table));
        }
    }
    page
}

/// A row, set apart from those above when it begins a new group.
fn push<const N: usize>(table: &mut Table, new: bool, cells: [Cell; N]) {
    if new { table.push_group(cells) } else { table.push(cells) }
}

fn scores(rows: &[Row]) -> Section {
    let words = ["scenario", "source", "what"].map(Column::text);
    let numbers = ["RMSE", "bias", "95 %", "covered", "bound ±", "settled", "violated", "µs/step"].map(Column::number);
    let mut table = Table::new(words.into_iter().chain(numbers));
    let mut scenario = "";
    for r in rows {
        let new = r.scenario != scenario;
        scenario = &r.scenario;
        // how much of the bound the error takes
        let share = r.mean_half_width.map_or(0.0, |w| r.rmse / w);
        let cells = [
            Cell::text(if new { scenario } else { "" }),
            Cell::text(&r.source),
            Cell::text(format!("{}, {}", r.quantity, r.unit)),
            Cell::fixed(r.rmse, 3).bar(share).hint(r.components()),
            Cell::fixed(r.bias, 3),
            Cell::fixed(r.p95, 3),
            Cell::percent(r.coverage),
            Cell::maybe(r.mean_half_width),
            Cell::text(settled(r)),
            Cell::percent(Some(r.violated)),
            Cell::maybe(r.us_per_step),
        ];
        push(&mut table, new, cells);
    }
    Section::new("Errors and bounds").table(table).paragraph(
        "RMSE and bias are those of the vector, 95 % that of the worst axis; the bar shows the RMSE within the mean \
         bound. Settled: median time until the error stays below a fifth of a change, and changes followed of all. \
         Violated: share of the flight in which the source said that its assumptions are broken. Hold the pointer over \
         an RMSE for its components.",
    )
}

fn faults(rows: &[FaultRow]) -> Section {
    let words = ["scenario", "fault"].map(Column::text);
    let numbers =
        ["happened", "told", "median delay, s", "95 % delay, s", "misnamed", "cleared after, s"].map(Column::number);
    let mut table = Table::new(words.into_iter().chain(numbers));
    let mut scenario = "";
    for f in rows {
        let new = f.scenario != scenario;
        scenario = &f.scenario;
        let tone = if f.told < 1.0 { Tone::Bad } else { Tone::Good };
        let cells = [
            Cell::text(if new { scenario } else { "" }),
            Cell::text(&f.fault),
            Cell::text(f.happened.to_string()),
            Cell::percent(Some(f.told)).tone(tone),
            Cell::maybe(f.median_delay_s),
            Cell::maybe(f.p95_delay_s),
            Cell::text(f.misnamed.to_string()).tone(if f.misnamed > 0 { Tone::Bad } else { Tone::Plain }),
            Cell::maybe(f.median_clear_s),
        ];
        push(&mut table, new, cells);
    }
    Section::new("Faults").table(table).paragraph(
        "Told: by the right name within 15 s. Misnamed: the first name that rose was a wrong one. Cleared: median time \
         from the fault's end until its name was gone.",
    )
}

fn scenarios(report: &Report) -> Section {
    let numbers = [
        "flights",
        "crashes",
        "in the air, h",
        "healthy, h",
        "false alarms",
        "per hour",
        "wrong names",
        "all together, µs/step",
    ];
    let mut table = Table::new(std::iter::once(Column::text("scenario")).chain(numbers.map(Column::number)));
    let names = |count: &BTreeMap<&str, u32>| {
        let each: Vec<_> = count.iter().map(|(name, n)| format!("{name} {n}")).collect();
        Cell::text(if each.is_empty() { "0".to_owned() } else { each.join(", ") })
    };
    for s in &report.scenarios {
        table.push([
            Cell::text(&s.scenario),
            Cell::text(s.flights.to_string()),
            Cell::text(s.crashes.to_string()),
            Cell::fixed(s.airborne_h, 2),
            Cell::fixed(s.healthy_h, 2),
            names(&s.false_alarms),
            Cell::maybe(s.false_alarms_per_h),
            names(&s.wrong_names),
            Cell::fixed(s.us_per_step, 1),
        ]);
    }
    Section::new("Scenarios").table(table)
}
