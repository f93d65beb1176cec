//! A flight as a page that a person would rather look at than read.

use super::curves::{Curves, Health, Moment};
use super::flight::Flight;
use super::summary::VehicleSummary;
use crate::report::{Cell, Colour, Column, Figure, Page, Panel, Section, Table, Tone};
use crate::vehicle::Vehicle;
use crate::wire::message_info;

const NED: [&str; 3] = ["north", "east", "down"];
const FRD: [&str; 3] = ["roll (x)", "pitch (y)", "yaw (z)"];
/// Rows of the link table.
const MOST_MESSAGES: usize = 40;

pub(super) fn of(flight: &Flight) -> Page {
    let r = &flight.report;
    let name = r.log.file_name().map_or_else(|| r.log.display().to_string(), |n| n.to_string_lossy().into_owned());
    let lost = r.lost_frames as f64 / (r.frames + r.lost_frames).max(1) as f64;
    let mut page = Page::new(name)
        .lead(format!(
            "Replayed with the model {}{}.",
            r.model,
            if r.model_assumed { ", which was assumed" } else { "" }
        ))
        .fact("recorded", duration(r.duration_s))
        .fact("frames", r.frames.to_string())
        .fact("lost", format!("{:.1} %", 100.0 * lost))
        .fact("damaged", r.bad_frames.to_string());
    for vehicle in &r.vehicles {
        let strongest = vehicle.wind.iter().map(|w| w.speed_mps).fold(0.0, f64::max);
        let force = vehicle.wind.iter().map(|w| w.force_n).fold(0.0, f64::max);
        page = page
            .fact(format!("vehicle {}/{}", vehicle.system, vehicle.component), vehicle.autopilot.clone())
            .fact("strongest wind", format!("{strongest:.1} m/s"))
            .fact("largest mean force", format!("{force:.1} N"));
    }
    for vehicle in &r.vehicles {
        let id = flight.curves.keys().find(|id| id.system == vehicle.system && id.component == vehicle.component);
        if let Some(curves) = id.and_then(|id| flight.curves.get(id)) {
            page = page.section(wind(vehicle, curves)).section(wrench(curves)).section(faults(vehicle, curves));
            page = page.section(health(curves));
        }
    }
    page = page.section(link(flight));
    if let Some(model) = &flight.model {
        page = page.section(model_facts(model));
    }
    page
}

fn duration(seconds: f64) -> String {
    if seconds < 120.0 {
        format!("{seconds:.0} s")
    } else {
        format!("{:.0} min {:02.0} s", (seconds / 60.0).floor(), seconds % 60.0)
    }
}

type Pick = fn(&Moment) -> Option<[[f64; 2]; 3]>;

/// One panel for each component, with its bound.
fn components(curves: &Curves, names: [&str; 3], what: &str, unit: &str, colour: Colour, pick: Pick) -> Figure {
    let panel = |axis: usize| {
        let points = || curves.moments.iter().filter_map(|m| Some((m.boot_s, pick(m)?[axis])));
        let band = points().filter(|(_, [_, h])| h.is_finite()).map(|(t, [v, h])| [t, v - h, v + h]);
        Panel::new(format!("{what}, {}", names[axis]), unit)
            .band("bound", colour, band)
            .line("estimate", colour, points().map(|(t, [v, _])| [t, v]))
            .height(110)
    };
    Figure::new("").x("boot time", "s").panels((0..3).map(panel))
}

fn wind(vehicle: &VehicleSummary, curves: &Curves) -> Section {
    let columns = [Column::text("boot time"), Column::number("from, °")];
    let mut table =
        Table::new(columns.into_iter().chain(["speed, m/s", "bound ±, m/s", "force, N"].map(Column::number)));
    let fastest = vehicle.wind.iter().map(|w| w.speed_mps).fold(1.0, f64::max);
    for row in &vehicle.wind {
        table.push([
            Cell::text(format!("{:.0}–{:.0} s", row.from_boot_s, row.to_boot_s)),
            Cell::fixed(row.from_deg, 0),
            Cell::fixed(row.speed_mps, 1).bar(row.speed_mps / fastest),
            Cell::maybe(row.half_width_mps),
            Cell::fixed(row.force_n, 1),
        ]);
    }
    let section = Section::new(format!("Wind at vehicle {}/{}", vehicle.system, vehicle.component));
    if table.is_empty() {
        return section
            .paragraph("There was no estimate of the wind in this log: see the streams and the observers below.");
    }
    let figure = components(curves, NED, "velocity of the air", "m/s", Colour::Blue, |m| m.wind);
    section.figure(figure, "Velocity of the air over ground (where it blows to), with its bound.").table(table)
}

fn wrench(curves: &Curves) -> Section {
    Section::new("Force and torque")
        .paragraph("What the vehicle model does not explain: air, contact, and the model's own error.")
        .figure(
            components(curves, NED, "force", "N", Colour::Orange, |m| m.force),
            "Residual force in the world frame, with its bound.",
        )
        .figure(
            components(curves, FRD, "torque", "N m", Colour::Purple, |m| m.torque),
            "Residual torque in the body frame, with its bound.",
        )
}

fn faults(vehicle: &VehicleSummary, curves: &Curves) -> Section {
    let colour = |name: &str| match name {
        "consistent" => Colour::Green,
        "settling" => Colour::Teal,
        "violated" => Colour::Red,
        "starved" => Colour::Orange,
        _ => Colour::Grey,
    };
    let verdicts = curves.verdicts.iter();
    let verdicts =
        verdicts.fold(Panel::new("verdict", ""), |p, (name, spans)| p.lane(*name, colour(name), spans.clone()));
    let mut figure = Figure::new("").x("boot time", "s").panel(verdicts);
    if !curves.faults.is_empty() {
        let lanes = curves.faults.iter();
        figure = figure
            .panel(lanes.fold(Panel::new("faults", ""), |p, (name, spans)| p.lane(*name, Colour::Red, spans.clone())));
    }
    let section = Section::new("Faults and verdicts")
        .figure(figure, "When the assumptions behind the bounds held, and when a fault was seen.");
    let section = if curves.faults.is_empty() { section.paragraph("No fault was seen.") } else { section };
    let notices = vehicle.notices.iter().map(|n| format!("{:.1} s: {}", n.boot_s, n.text));
    section.details(Section::new("Notices").list(notices))
}

fn health(curves: &Curves) -> Section {
    let names = ["consistent", "settling", "violated", "starved", "grounded"];
    let columns = std::iter::once(Column::text("observer")).chain(["steps", "µs a step"].map(Column::number));
    let columns = columns.chain(names.map(|n| Column::number(format!("{n}, %"))));
    let mut table = Table::new(columns.chain([Column::number("worst residual")]));
    let mut figure = Figure::new("").x("boot time", "s");
    for (index, (name, health)) in curves.observers.iter().enumerate() {
        let Health { steps, verdicts, worst_residual, step_ns, residuals } = health;
        let all: u64 = verdicts.values().sum();
        let mut cells = vec![Cell::text(*name), Cell::text(steps.to_string())];
        cells.push(Cell::maybe((*step_ns > 0).then_some(f64::from(*step_ns) * 1e-3)));
        cells.extend(
            names.map(|n| Cell::fixed(100.0 * verdicts.get(n).copied().unwrap_or(0) as f64 / all.max(1) as f64, 1)),
        );
        let tone = if *worst_residual > 1.0 { Tone::Bad } else { Tone::Good };
        cells.push(Cell::fixed(*worst_residual, 2).tone(tone));
        table.push(cells);
        let ends = [residuals.first(), residuals.last()].into_iter().flatten().map(|p| [p[0], 1.0]);
        let panel = Panel::new(format!("residual of {name}"), "")
            .line("residual", Colour::nth(index), residuals.iter().copied())
            .dashed("limit", Colour::Grey, ends.collect::<Vec<_>>());
        figure = figure.panel(panel.height(80));
    }
    Section::new("Observers")
        .table(table.caption("A residual above 1 contradicts the declared noise and rates."))
        .figure(figure, "Largest residual over its admissible size.")
}

fn link(flight: &Flight) -> Section {
    let columns = std::iter::once(Column::text("message")).chain(["frames", "Hz", "jitter, ms"].map(Column::number));
    let mut table = Table::new(columns);
    for (source, stats) in flight.link.sources() {
        let losses = stats.losses();
        let title =
            format!("{}/{}: {} frames, {} lost", source.system, source.component, stats.totals().frames, losses.lost);
        let late = if losses.late > 0 { format!(", {} late", losses.late) } else { String::new() };
        table.push_group([Cell::text(title + &late)]);
        for (id, cadence) in stats.messages().take(MOST_MESSAGES) {
            let hz = cadence.mean_rate_hz();
            table.push([
                Cell::text(message_info(id).map_or_else(|| id.to_string(), |m| m.name.to_owned())),
                Cell::text(cadence.count().to_string()),
                Cell::maybe((hz > 0.0).then_some(hz)),
                Cell::fixed(cadence.jitter_s() * 1e3, 1),
            ]);
        }
    }
    Section::new("Link").details(Section::new("Every message").table(table))
}

fn model_facts(model: &Vehicle) -> Section {
    let facts = model.facts();
    let mut table = Table::new([Column::text("quantity"), Column::number("value")]);
    let rows = [
        ("weight, N", facts.weight_n),
        ("largest thrust, N", facts.max_thrust_n),
        ("share of it in hover", facts.hover_thrust_share),
        ("largest torque about x, N m", facts.max_torque_nm[0]),
        ("about y, N m", facts.max_torque_nm[1]),
        ("about z, N m", facts.max_torque_nm[2]),
        ("drag at 1 m/s along x, N", facts.drag_at_1_mps_n[0]),
        ("along z, N", facts.drag_at_1_mps_n[2]),
    ];
    rows.into_iter().for_each(|(name, value)| table.push([Cell::text(name), Cell::number(value)]));
    Section::new("Vehicle model").paragraph(model.name.clone()).table(table)
}
