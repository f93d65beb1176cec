use super::ground::Ground;
use super::summary::Summary;
use crate::report::{Cell, Column, Page, Section, Table};

/// The run as a page: what came out, how it went, and where the assumptions broke.
pub(super) fn of(summary: &Summary, ground: &Ground) -> Page {
    let numbers = ["samples", "RMSE", "within bound", "bound ±, x or north", "y or east", "z or down"];
    let mut table = Table::new(std::iter::once(Column::text("estimate")).chain(numbers.map(Column::number)));
    for (name, s) in &summary.estimates {
        let mut cells = vec![
            Cell::text(format!("{name}, {}", s.unit)),
            Cell::text(s.samples.to_string()),
            Cell::fixed(s.rmse, 3),
            Cell::percent(s.coverage),
        ];
        cells.extend(s.mean_half_width.map(Cell::maybe));
        table.push(cells);
    }
    let mut rates = Table::new([Column::text("message"), Column::number("Hz")]);
    for (name, hz) in &summary.rates_hz {
        rates.push([Cell::text(*name), Cell::fixed(*hz, 1)]);
    }
    let files = summary.files.iter().map(|f| f.display().to_string());
    Page::new("A demo flight")
        .lead(format!("{}. Every number was decoded from MAVLink at the ground station.", summary.description))
        .fact("in the air", format!("{:.1} s", summary.flown_s))
        .fact("frames of the vehicle", summary.frames_from_vehicle.to_string())
        .fact("of them answers to the daemon", summary.answers_to_daemon.to_string())
        .fact("of them at the ground", summary.frames_at_ground.to_string())
        .fact("assumptions broken", Cell::percent(Some(summary.violated)).to_string())
        .section(
            Section::new("Estimates and truth")
                .figure(
                    ground.figure(),
                    "Estimates with their bounds as the ground station received them, and the truth.",
                )
                .table(table),
        )
        .section(Section::new("Messages").table(rates).details(Section::new("Files").list(files)))
}
