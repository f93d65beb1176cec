//! Pictures and pages for people: charts as SVG, reports as one HTML file that needs nothing else.
//!
//! In: numbers with their names and units. Out: text, ready to be written to a file. Knows nothing of observers or
//! vehicles, so that every command can use it. No I/O. Imports nothing.
//!
//! ```
//! use mavobserver::report::{Colour, Figure, Page, Panel, Section};
//!
//! let line = (0..100).map(|i| [f64::from(i) * 0.1, (f64::from(i) * 0.1).sin()]);
//! let panel = Panel::new("Wind towards north", "m/s").line("estimate", Colour::Blue, line).event(4.0, "gust");
//! let figure = Figure::new("One flight").x("time", "s").panel(panel);
//! let page = Page::new("A flight").section(Section::new("Wind").paragraph("What blew.").figure(figure, "North only"));
//! assert!(page.html()?.contains("<svg"));
//! # Ok::<(), mavobserver::report::ReportError>(())
//! ```

mod chart;
mod colour;
mod page;

pub use chart::{Figure, Panel};
pub use colour::Colour;
pub use page::{Cell, Column, Page, Section, Table, Tone};

/// Why there is no picture or page. Neither depends on the numbers: any input can be drawn.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("the chart \"{title}\" cannot be drawn: {why}")]
    Chart { title: String, why: String },
    #[error("the page \"{title}\" cannot be written: {source}")]
    Page { title: String, source: minijinja::Error },
}
