use super::options::Shared;
use crate::cli::{Failure, print};
use crate::report::{Cell, Column, Figure, Page, ReportError, Section, Table, Tone};
use serde_json::{Map, Value};
use std::path::Path;

/// What designing one observer for one plant gave.
#[derive(Debug, Default)]
pub struct Sheet {
    pub observer: &'static str,
    /// The paper, as a reader would cite it.
    pub paper: &'static str,
    pub plant: String,
    /// What belongs to all rows: the plant's matrices, weights, ends of a trade-off.
    pub more: Map<String, Value>,
    /// One object per design, with `gain` or `gains`, A, B, C, L, P as far as they exist, `verified`, `margin`, `solve_s`.
    pub rows: Vec<Value>,
    /// The designs that a criterion chose, in the form of rows.
    pub selected: Vec<Value>,
    /// The same for a reader, without a newline at the end.
    pub text: String,
    /// Pictures with their captions; the first is what `--plot FILE.svg` writes.
    pub figures: Vec<(Figure, String)>,
    /// Ours beside the published figures, or beside independent solutions of the same problem.
    pub compared: Vec<Compared>,
    /// How the paper's text differs from what its numbers follow from.
    pub corrections: &'static [&'static str],
}

/// One number that the paper prints, or that others computed from it, and what comes of it here.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    pub what: String,
    pub ours: f64,
    /// `None` where there is none.
    pub reference: Option<f64>,
    /// The largest relative difference that is expected.
    pub tolerance: f64,
}

impl Sheet {
    /// {observer, plant, …, rows, selected}.
    pub fn json(&self) -> Value {
        let mut object = self.more.clone();
        object.insert("observer".into(), self.observer.into());
        object.insert("plant".into(), self.plant.clone().into());
        object.insert("rows".into(), self.rows.clone().into());
        object.insert("selected".into(), self.selected.clone().into());
        Value::Object(object)
    }

    /// Prints it, and writes its pictures, as the options ask.
    pub fn deliver(&self, options: &Shared) -> Result<(), Failure> {
        if let Some(path) = &options.plot {
            let failed = |e: ReportError| Failure::Failed(e.to_string());
            let text = match extension(path).as_deref() {
                Some("svg") => {
                    let nothing = || Failure::Failed(format!("{} has no picture for this plant", self.observer));
                    self.figures.first().ok_or_else(nothing)?.0.svg().map_err(failed)?
                }
                Some("html") => self.page().html().map_err(failed)?,
                _ => {
                    return Err(Failure::Usage(format!("--plot {}: expected a name.svg or name.html", path.display())));
                }
            };
            write(path, &text)?;
        }
        print(&if options.json { format!("{:#}", self.json()) } else { self.text.trim_end().to_owned() })
    }

    fn page(&self) -> Page {
        Page::new(format!("Design of {} for {}", self.observer, self.plant)).lead(self.paper).section(self.section())
    }

    /// The sheet as a part of a page.
    pub fn section(&self) -> Section {
        let mut section = Section::new(format!("{} for {}", self.observer, self.plant)).paragraph(self.paper);
        if !self.compared.is_empty() {
            section = section.table(self.comparison());
        }
        for (figure, caption) in &self.figures {
            section = section.figure(figure.clone(), caption.clone());
        }
        if !self.corrections.is_empty() {
            section = section
                .paragraph("The paper's text, corrected where its own numbers contradict it:")
                .list(self.corrections.iter().copied());
        }
        section.details(Section::new("The command's own words").code(self.text.clone()))
    }

    fn comparison(&self) -> Table {
        let mut columns = vec![Column::text("figure")];
        columns.extend(Column::compared("ours"));
        columns.push(Column::number("expected within"));
        let mut table = Table::new(columns)
            .caption("Ours beside the reference: the paper where it prints numbers, else an independent solution");
        for c in &self.compared {
            let mut cells = vec![Cell::text(c.what.clone())];
            cells.extend(Cell::compared(c.ours, c.reference));
            let [.., difference] = cells.as_mut_slice() else { continue };
            if c.reference.is_some() {
                *difference = std::mem::take(difference).tone(if c.agrees() { Tone::Good } else { Tone::Bad });
            }
            cells.push(Cell::percent(Some(c.tolerance)));
            table.push(cells);
        }
        table
    }

    /// Smallest `margin` and sum of `solve_s` over the rows, as far as they have them.
    pub fn margin_and_seconds(&self) -> (f64, f64) {
        let number = |row: &Value, key: &str| row.get(key).and_then(Value::as_f64);
        let all = || self.rows.iter().chain(&self.selected);
        let margin = all().filter_map(|r| number(r, "margin")).fold(f64::INFINITY, f64::min);
        (margin, self.rows.iter().filter_map(|r| number(r, "solve_s")).sum())
    }
}

impl Compared {
    pub fn agrees(&self) -> bool {
        self.reference.is_none_or(|p| (self.ours - p).abs() <= self.tolerance * p.abs())
    }
}

fn extension(path: &Path) -> Option<String> {
    path.extension().map(|e| e.to_string_lossy().to_lowercase())
}

/// Writes a file, or says which one could not be written.
pub fn write(path: &Path, text: &str) -> Result<(), Failure> {
    std::fs::write(path, text).map_err(|e| Failure::Failed(format!("cannot write {}: {e}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_becomes_a_page_that_shows_what_differs() {
        let compared = |ours| Compared { what: "Vol(1)".into(), ours, reference: Some(0.76), tolerance: 0.01 };
        let sheet = Sheet {
            observer: "quadratic-bounded",
            plant: "a <plant>".into(),
            compared: vec![compared(0.7601), compared(0.9)],
            corrections: &["Eq. 33 prints q₀ for q₀²."],
            ..Sheet::default()
        };
        assert!(sheet.compared[0].agrees() && !sheet.compared[1].agrees());
        let html = sheet.page().html().unwrap();
        assert!(html.contains("a &lt;plant&gt;") && html.contains("+18.42 %") && html.contains("Eq. 33"), "{html}");
    }
}
