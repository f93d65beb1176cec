use super::Figure;
use super::panel::Panel;
use super::scale::Scale;
use crate::report::Colour;

/// Sizes in pixels of the picture.
pub(super) const LEFT: u32 = 68;
pub(super) const RIGHT: u32 = 18;
pub(super) const HEADING: u32 = 34;
/// One row of a panel's title and legend.
pub(super) const ROW: u32 = 20;
/// Below the last panel: numbers, and the axis' name.
pub(super) const NUMBERS: u32 = 20;
pub(super) const NAME: u32 = 20;
const GAP: u32 = 14;
/// An average letter's width, and that of a legend entry's key with its space.
const LETTER: f64 = 6.4;
const KEY: f64 = 34.0;
/// Behind a legend entry.
const SPACE: f64 = 14.0;

/// Where everything goes.
pub(super) struct Layout {
    pub height: u32,
    pub x: Scale,
    pub places: Vec<Place>,
}

/// One panel's place.
pub(super) struct Place {
    /// Of the title's row.
    pub top: u32,
    /// Of the plotted area.
    pub plot: u32,
    pub y: Scale,
    pub legend: Vec<Entry>,
}

/// One entry of a legend.
pub(super) struct Entry {
    pub x: u32,
    pub row: u32,
    pub label: String,
    pub colour: Colour,
    pub key: Key,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Key {
    Line,
    Dash,
    Dot,
    Area,
}

impl Layout {
    pub fn of(figure: &Figure) -> Self {
        let mut x = figure.x_range.and_then(|ends| Scale::given(ends, figure.x_log)).unwrap_or_else(|| {
            // dots at the very edge would be cut
            let dots = figure.panels.iter().any(|p| p.equal || p.layers.iter().any(|l| l.key() == Key::Dot));
            let room = if dots { 0.05 } else { 0.0 };
            Scale::around(figure.panels.iter().flat_map(Panel::xs), figure.x_log, room)
        });
        let mut top = if figure.title.is_empty() { 6 } else { HEADING };
        let mut places = Vec::new();
        for panel in &figure.panels {
            let (legend, rows) = legend(panel, figure.width);
            let plot = top + rows * ROW;
            let mut y = panel.scale();
            if let ([_], true, Scale::Linear(xs), Scale::Linear(ys)) = (&figure.panels[..], panel.equal, &mut x, &mut y)
            {
                equalise(xs, f64::from(figure.width - LEFT - RIGHT), ys, f64::from(panel.height));
            }
            places.push(Place { top, plot, y, legend });
            top = plot + panel.height + GAP;
        }
        let axis = if figure.panels.is_empty() { 0 } else { NUMBERS };
        let name = if figure.x_text().is_empty() { 0 } else { NAME };
        Self { height: top + axis + name, x, places }
    }
}

/// Widens one of two ranges until both have as many units to the pixel.
fn equalise(xs: &mut [f64; 2], width: f64, ys: &mut [f64; 2], height: f64) {
    let unit = ((xs[1] - xs[0]) / width).max((ys[1] - ys[0]) / height);
    for (ends, pixels) in [(xs, width), (ys, height)] {
        let middle = 0.5 * (ends[0] + ends[1]);
        *ends = [middle - 0.5 * unit * pixels, middle + 0.5 * unit * pixels];
    }
}

impl Panel {
    fn scale(&self) -> Scale {
        if !self.lanes.is_empty() {
            return Scale::Rows(self.lanes.iter().map(|l| l.name.clone()).collect());
        }
        if let Some(given) = self.y_range.and_then(|ends| Scale::given(ends, self.log_y)) {
            return given;
        }
        const ROOM: f64 = 0.05;
        if self.ys().next().is_none() {
            return Scale::around(self.ends(), self.log_y, ROOM);
        }
        match Scale::around(self.ys(), self.log_y, 0.0) {
            Scale::Linear([low, high]) => {
                let margin = 0.5 * (high - low);
                let ends = self.ends().filter(|v| v.is_finite()).map(|v| v.clamp(low - margin, high + margin));
                Scale::around(self.ys().chain(ends), false, ROOM)
            }
            _ => Scale::around(self.ys(), true, ROOM),
        }
    }
}

/// Beside the title when there is room, in rows below it when there is not.
fn legend(panel: &Panel, width: u32) -> (Vec<Entry>, u32) {
    let labelled: Vec<_> = panel.layers.iter().filter(|l| !l.label.is_empty()).collect();
    let wide = |text: &str| text.chars().count() as f64 * LETTER;
    let sizes: Vec<f64> = labelled.iter().map(|l| wide(&l.label) + KEY).collect();
    let space = f64::from(width - LEFT - RIGHT);
    let total = sizes.iter().sum::<f64>() - SPACE;
    let title = wide(&panel.title) + wide(&panel.unit) + 3.0 * LETTER;
    let beside = title + total <= space;
    let (mut x, mut row) = if beside { (space - total, 0) } else { (0.0, 1) };
    let mut entries = Vec::new();
    for (layer, size) in labelled.iter().zip(sizes) {
        if x > 0.0 && x + size - SPACE > space + 1.0 {
            (x, row) = (0.0, row + 1);
        }
        let (label, colour) = (layer.label.clone(), layer.colour);
        entries.push(Entry { x: LEFT + x as u32, row, label, colour, key: layer.key() });
        x += size;
    }
    let rows = if entries.is_empty() { 1 } else { row + 1 };
    (entries, rows)
}
