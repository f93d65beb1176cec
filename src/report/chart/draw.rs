use super::layout::{Entry, HEADING, Key, LEFT, Layout, NAME, NUMBERS, Place, RIGHT, ROW};
use super::panel::{Layer, Mark, Panel, Shape};
use super::scale::Scale;
use super::{Figure, UNITS, thin, with_unit};
use crate::report::Colour;
use crate::report::colour::{GRID, LABEL, PAPER};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Scale>>;
type Drawn = Result<(), DrawingAreaErrorKind<std::io::Error>>;

const FONT: &str = "system-ui, sans-serif";
/// Pixels: a line's thickness, a dot's radius, and between dashes.
const LINE: f64 = 1.4;
const DOT: i32 = 3;
const DASH: i32 = 5;

/// Pixels to the drawing's units.
fn units(pixels: u32) -> i32 {
    pixels as i32 * UNITS
}

fn thickness(pixels: f64) -> u32 {
    (pixels * f64::from(UNITS)).round() as u32
}

/// `size` is that of the letters in pixels.
fn text(size: f64, colour: RGBColor, across: HPos, down: VPos) -> TextStyle<'static> {
    // plotters divides by 1.24 on the way to SVG
    let font = FontDesc::from((FONT, size * 1.24 * f64::from(UNITS)));
    TextStyle { font, color: colour.to_backend_color(), pos: Pos::new(across, down) }
}

pub(super) fn figure(root: &Area<'_>, figure: &Figure, layout: &Layout) -> Drawn {
    root.fill(&PAPER)?;
    if !figure.title.is_empty() {
        let style = text(15.0, Colour::Ink.rgb(), HPos::Left, VPos::Center);
        root.draw_text(&figure.title, &style, (units(LEFT), units(HEADING / 2)))?;
    }
    for (i, (panel, place)) in figure.panels.iter().zip(&layout.places).enumerate() {
        let last = i + 1 == figure.panels.len();
        self::panel(root, figure, panel, place, &layout.x, last)?;
    }
    root.present()
}

fn panel(root: &Area<'_>, figure: &Figure, panel: &Panel, place: &Place, x: &Scale, last: bool) -> Drawn {
    let title = text(12.5, Colour::Ink.rgb(), HPos::Left, VPos::Center);
    let at = (units(LEFT), units(place.top + ROW / 2));
    root.draw_text(&with_unit(&panel.title, &panel.unit), &title, at)?;
    for entry in &place.legend {
        self::entry(root, entry, place.top)?;
    }
    let below = if last { NUMBERS + if figure.x_text().is_empty() { 0 } else { NAME } } else { 0 };
    let size = (units(figure.width - RIGHT), units(panel.height + below));
    let area = root.clone().shrink((0, units(place.plot)), size);
    let mut chart = ChartBuilder::on(&area)
        .set_label_area_size(LabelAreaPosition::Left, units(LEFT))
        .set_label_area_size(LabelAreaPosition::Bottom, units(below))
        .build_cartesian_2d(x.clone(), place.y.clone())?;
    grid(&mut chart, figure, panel, last)?;
    marks(&mut chart, panel, figure.width)?;
    if !panel.lanes.is_empty() {
        return lanes(&mut chart, panel);
    }
    // bands behind everything
    let (bands, others): (Vec<_>, Vec<_>) = panel.layers.iter().partition(|l| l.key() == Key::Area);
    for layer in bands.into_iter().chain(others) {
        self::layer(&mut chart, layer, x, &place.y, figure.width as usize)?;
    }
    Ok(())
}

fn grid(chart: &mut Chart<'_, '_>, figure: &Figure, panel: &Panel, last: bool) -> Drawn {
    let label = text(11.0, LABEL, HPos::Center, VPos::Center);
    let line = GRID.stroke_width(UNITS.unsigned_abs());
    let name = figure.x_text();
    let mut mesh = chart.configure_mesh();
    mesh.bold_line_style(line)
        .light_line_style(TRANSPARENT)
        .axis_style(line)
        .label_style(label)
        .set_all_tick_mark_size(units(3))
        .x_labels(if figure.width < 600 { 6 } else { 10 })
        .y_labels((panel.height / 34).clamp(2, 10) as usize)
        .max_light_lines(0);
    if last {
        mesh.x_desc(name);
    } else {
        mesh.x_labels(0);
    }
    mesh.draw()
}

fn layer(chart: &mut Chart<'_, '_>, layer: &Layer, x: &Scale, y: &Scale, width: usize) -> Drawn {
    let colour = layer.colour.rgb();
    let stroke = colour.stroke_width(thickness(LINE));
    let tuple = |p: &[f64; 2]| (p[0], p[1]);
    match &layer.shape {
        Shape::Line { points, dashed } => {
            for piece in thin::line(points, x, y, width / 2) {
                let piece = piece.iter().map(tuple);
                if *dashed {
                    chart.draw_series(DashedLineSeries::new(piece, DASH * UNITS, DASH * UNITS, stroke))?;
                } else {
                    chart.draw_series(LineSeries::new(piece, stroke))?;
                }
            }
        }
        Shape::Points { points, names } => {
            let shown = |p: &[f64; 2]| x.share(p[0]).is_some() && y.share(p[1]).is_some();
            let dots = points.iter().filter(|p| shown(p));
            chart.draw_series(dots.map(|p| Circle::new(tuple(p), DOT * UNITS, colour.filled())))?;
            let style = text(11.0, LABEL, HPos::Left, VPos::Bottom);
            let named = points.iter().zip(names).filter(|(p, _)| shown(p));
            chart.draw_series(named.map(|(p, name)| {
                EmptyElement::at(tuple(p)) + Text::new(name.clone(), (5 * UNITS, -3 * UNITS), style.clone())
            }))?;
        }
        Shape::Band(ends) => {
            for piece in thin::band(ends, x, y, width / 2) {
                let upper = piece.iter().map(|e| (e[0], e[2]));
                let lower = piece.iter().rev().map(|e| (e[0], e[1]));
                let corners: Vec<_> = upper.chain(lower).collect();
                chart.draw_series([Polygon::new(corners, colour.mix(0.16))])?;
            }
        }
        Shape::Outline(corners) => {
            let shown = corners.iter().filter(|p| x.share(p[0]).is_some() && y.share(p[1]).is_some());
            let mut closed: Vec<_> = shown.map(tuple).collect();
            chart.draw_series([Polygon::new(closed.clone(), colour.mix(0.08))])?;
            closed.extend(closed.first().copied());
            chart.draw_series(LineSeries::new(closed, stroke))?;
        }
    }
    Ok(())
}

/// Shaded stretches, vertical lines, and their labels: those that would run into each other go on different rows.
fn marks(chart: &mut Chart<'_, '_>, panel: &Panel, width: u32) -> Drawn {
    const ROWS: usize = 3;
    const LETTER: f64 = 5.6;
    let (x, [bottom, top]) = (chart.x_range(), [chart.y_range().start, chart.y_range().end]);
    let scale = chart.as_coord_spec().x_spec().clone();
    let pixel = |v: f64| scale.share(v).map(|s| s * f64::from(width - LEFT - RIGHT));
    let mut taken = [f64::NEG_INFINITY; ROWS];
    let mut sorted: Vec<&Mark> =
        panel.marks.iter().filter(|m| m.from <= m.to && m.to >= x.start && m.from <= x.end).collect();
    sorted.sort_by(|a, b| a.from.total_cmp(&b.from));
    for mark in sorted {
        let (from, to) = (mark.from.max(x.start), mark.to.min(x.end));
        let colour = mark.colour.rgb();
        if to > from {
            chart.draw_series([Rectangle::new([(from, bottom), (to, top)], colour.mix(0.12).filled())])?;
        } else {
            chart
                .draw_series([PathElement::new([(from, bottom), (from, top)], colour.stroke_width(thickness(1.0)))])?;
        }
        let Some(start) = pixel(from).filter(|_| !mark.label.is_empty()) else { continue };
        let end = start + mark.label.chars().count() as f64 * LETTER + 8.0;
        let row = taken.iter().position(|t| *t <= start).unwrap_or(ROWS - 1);
        if let Some(slot) = taken.get_mut(row) {
            *slot = end;
        }
        let style = text(10.5, colour, HPos::Left, VPos::Top);
        let below = units(2 + 13 * row as u32);
        chart
            .draw_series([EmptyElement::at((from, top)) + Text::new(mark.label.clone(), (3 * UNITS, below), style)])?;
    }
    Ok(())
}

fn lanes(chart: &mut Chart<'_, '_>, panel: &Panel) -> Drawn {
    const HALF: f64 = 0.32;
    for (i, lane) in panel.lanes.iter().enumerate() {
        let middle = -(i as f64);
        let shown = lane.spans.iter().filter(|s| s[0] <= s[1]);
        chart.draw_series(shown.map(|[from, to]| {
            Rectangle::new([(*from, middle - HALF), (*to, middle + HALF)], lane.colour.rgb().mix(0.8).filled())
        }))?;
    }
    Ok(())
}

fn entry(root: &Area<'_>, entry: &Entry, top: u32) -> Drawn {
    let colour = entry.colour.rgb();
    let (x, y) = (units(entry.x), units(top + entry.row * ROW + ROW / 2));
    let stroke = colour.stroke_width(thickness(2.0));
    let piece = |from: u32, to: u32| PathElement::new([(x + units(from), y), (x + units(to), y)], stroke);
    match entry.key {
        Key::Line => root.draw(&piece(0, 16))?,
        Key::Dash => [piece(0, 4), piece(6, 10), piece(12, 16)].iter().try_for_each(|p| root.draw(p))?,
        Key::Dot => root.draw(&Circle::new((x + units(8), y), DOT * UNITS, colour.filled()))?,
        Key::Area => {
            let corners = [(x, y - units(5)), (x + units(16), y + units(5))];
            root.draw(&Rectangle::new(corners, colour.mix(0.25).filled()))?;
        }
    }
    root.draw_text(&entry.label, &text(11.5, LABEL, HPos::Left, VPos::Center), (x + units(20), y))
}

impl Layer {
    pub(super) fn key(&self) -> Key {
        match &self.shape {
            Shape::Line { dashed: false, .. } | Shape::Outline(_) => Key::Line,
            Shape::Line { dashed: true, .. } => Key::Dash,
            Shape::Points { .. } => Key::Dot,
            Shape::Band(_) => Key::Area,
        }
    }
}
