//! Charts as SVG: panels under each other over a shared x axis, drawn by `plotters`.
//!
//! Text stays text, so that it can be searched and scales; numbers that are not finite leave a gap.

mod draw;
mod layout;
mod panel;
mod scale;
mod thin;

pub use panel::Panel;

use super::{ReportError, colour};
use layout::Layout;
use plotters::prelude::{IntoDrawingArea, SVGBackend};

/// The drawing has this many units for each pixel of the picture: `plotters` rounds to whole units.
const UNITS: i32 = 4;
const WIDTH: u32 = 960;

/// A picture: panels under each other, which share their x axis.
#[derive(Debug, Clone)]
pub struct Figure {
    title: String,
    x_name: String,
    x_unit: String,
    x_log: bool,
    x_range: Option<[f64; 2]>,
    width: u32,
    panels: Vec<Panel>,
}

impl Figure {
    /// An empty picture; an empty title takes no room.
    pub fn new(title: impl Into<String>) -> Self {
        Self {
            title: title.into(),
            x_name: String::new(),
            x_unit: String::new(),
            x_log: false,
            x_range: None,
            width: WIDTH,
            panels: Vec::new(),
        }
    }

    /// The same picture with another title.
    #[must_use]
    pub fn titled(mut self, title: impl Into<String>) -> Self {
        self.title = title.into();
        self
    }

    /// Name and unit of the x axis; an empty unit is left out.
    #[must_use]
    pub fn x(mut self, name: impl Into<String>, unit: impl Into<String>) -> Self {
        (self.x_name, self.x_unit) = (name.into(), unit.into());
        self
    }

    /// A logarithmic x axis, on which only positive numbers have a place.
    #[must_use]
    pub fn log_x(mut self) -> Self {
        self.x_log = true;
        self
    }

    /// Ends of the x axis; those of the data when left out. What lies outside is not drawn.
    #[must_use]
    pub fn range_x(mut self, from: f64, to: f64) -> Self {
        self.x_range = Some([from, to]);
        self
    }

    /// Width in pixels, 960 when left out and at least 300.
    #[must_use]
    pub fn width(mut self, pixels: u32) -> Self {
        self.width = pixels.clamp(300, 4000);
        self
    }

    #[must_use]
    pub fn panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    #[must_use]
    pub fn panels(mut self, panels: impl IntoIterator<Item = Panel>) -> Self {
        self.panels.extend(panels);
        self
    }

    pub fn title(&self) -> &str {
        &self.title
    }

    /// The picture as one SVG element, with a style sheet for dark screens.
    ///
    /// # Errors
    /// The drawing library refuses; no input is known that makes it do so.
    pub fn svg(&self) -> Result<String, ReportError> {
        let layout = Layout::of(self);
        let size = [self.width, layout.height].map(|pixels| pixels * UNITS.unsigned_abs());
        let mut drawing = String::new();
        let root = SVGBackend::with_string(&mut drawing, size.into()).into_drawing_area();
        draw::figure(&root, self, &layout)
            .map_err(|e| ReportError::Chart { title: self.title.clone(), why: e.to_string() })?;
        drop(root);
        // our own opening element: a size in pixels with a finer grid inside, and the dark shades
        let body = drawing.split_once('\n').map_or("", |(_, body)| body);
        Ok(format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"chart\" role=\"img\" width=\"{}\" height=\"{}\" \
             viewBox=\"0 0 {} {}\">\n{}\n{body}",
            self.width,
            layout.height,
            size[0],
            size[1],
            colour::dark_style()
        ))
    }

    fn x_text(&self) -> String {
        with_unit(&self.x_name, &self.x_unit)
    }
}

fn with_unit(name: &str, unit: &str) -> String {
    if unit.is_empty() { name.to_owned() } else { format!("{name}, {unit}") }
}

#[cfg(test)]
mod tests;
