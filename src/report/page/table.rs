use minijinja::{Value, context};
use std::fmt;

/// Rows of cells under their columns.
#[derive(Debug, Clone, Default)]
pub struct Table {
    caption: String,
    columns: Vec<Column>,
    rows: Vec<(bool, Vec<Cell>)>,
}

/// A column's heading, and whether numbers stand in it.
#[derive(Debug, Clone)]
pub struct Column {
    name: String,
    number: bool,
}

/// What stands in one place of a table.
#[derive(Debug, Clone, Default)]
pub struct Cell {
    text: String,
    hint: String,
    tone: Tone,
    /// Share of a bar behind the text.
    bar: Option<f64>,
}

/// How a cell is to be understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Tone {
    #[default]
    Plain,
    Good,
    Bad,
    /// Less important than the others.
    Faint,
}

impl Column {
    /// A column of words.
    pub fn text(name: impl Into<String>) -> Self {
        Self { name: name.into(), number: false }
    }

    /// A column of numbers, aligned to the right; the unit belongs to the name.
    pub fn number(name: impl Into<String>) -> Self {
        Self { name: name.into(), number: true }
    }

    /// Three columns: a number, what it is held against, and the difference. [`Cell::compared`] fills them.
    pub fn compared(name: impl Into<String>) -> [Self; 3] {
        [name.into(), "reference".to_owned(), "difference".to_owned()].map(Self::number)
    }
}

impl Cell {
    pub fn text(text: impl Into<String>) -> Self {
        Self { text: text.into(), ..Self::default() }
    }

    /// A number with so many decimals; a dash when it is not finite.
    pub fn fixed(value: f64, decimals: usize) -> Self {
        Self::text(if value.is_finite() { format!("{value:.decimals$}") } else { "–".to_owned() })
    }

    /// A number with about four significant digits, in powers of ten when it is very large or small; a dash when it is
    /// not finite.
    pub fn number(value: f64) -> Self {
        Self::text(match value.abs() {
            _ if !value.is_finite() => "–".to_owned(),
            0.0 => "0".to_owned(),
            size if !(1e-4..1e6).contains(&size) => format!("{value:.3e}"),
            size => format!("{value:.*}", (3 - size.log10().floor() as i32).clamp(0, 7) as usize),
        })
    }

    /// As [`Cell::number`], with a dash for what does not exist.
    pub fn maybe(value: Option<f64>) -> Self {
        Self::number(value.unwrap_or(f64::NAN))
    }

    /// A share in percent; a dash for what does not exist.
    pub fn percent(share: Option<f64>) -> Self {
        Self::text(share.map_or_else(|| "–".to_owned(), |s| format!("{:.1} %", s * 100.0)))
    }

    /// Cells for [`Column::compared`]: the value, the reference, and the difference in percent of the reference.
    pub fn compared(value: f64, reference: Option<f64>) -> [Self; 3] {
        let difference = reference.filter(|r| *r != 0.0).map(|r| (value - r) / r.abs() * 100.0);
        let difference = difference.map_or_else(|| "–".to_owned(), |d| format!("{d:+.2} %"));
        [Self::number(value), Self::maybe(reference).tone(Tone::Faint), Self::text(difference)]
    }

    #[must_use]
    pub fn tone(mut self, tone: Tone) -> Self {
        self.tone = tone;
        self
    }

    /// More about it, for those who hold the pointer over it.
    #[must_use]
    pub fn hint(mut self, text: impl Into<String>) -> Self {
        self.hint = text.into();
        self
    }

    /// A bar behind the text, 0 to 1 of the cell's width.
    #[must_use]
    pub fn bar(mut self, share: f64) -> Self {
        self.bar = share.is_finite().then(|| share.clamp(0.0, 1.0));
        self
    }

    fn value(&self, number: bool) -> Value {
        let tone = match self.tone {
            Tone::Plain => "",
            Tone::Good => "good",
            Tone::Bad => "bad",
            Tone::Faint => "faint",
        };
        let bar = self.bar.map(|share| format!("{:.0}", share * 100.0));
        context! { text => self.text.clone(), hint => self.hint.clone(), tone, number, bar }
    }
}

impl fmt::Display for Cell {
    /// Its text alone.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self::text(text)
    }
}

impl Table {
    pub fn new(columns: impl IntoIterator<Item = Column>) -> Self {
        Self { columns: columns.into_iter().collect(), ..Self::default() }
    }

    #[must_use]
    pub fn caption(mut self, text: impl Into<String>) -> Self {
        self.caption = text.into();
        self
    }

    /// Appends a row. Cells that are missing stay empty, those without a column are left out.
    pub fn push(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push((false, cells.into_iter().collect()));
    }

    /// Appends the first row of a group, which a line sets apart from those above.
    pub fn push_group(&mut self, cells: impl IntoIterator<Item = Cell>) {
        self.rows.push((true, cells.into_iter().collect()));
    }

    /// As [`Table::push`], for chains.
    #[must_use]
    pub fn row(mut self, cells: impl IntoIterator<Item = Cell>) -> Self {
        self.push(cells);
        self
    }

    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn value(&self) -> Value {
        let columns: Vec<_> =
            self.columns.iter().map(|c| context! { name => c.name.clone(), number => c.number }).collect();
        let nothing = Cell::default();
        let rows: Vec<_> = self
            .rows
            .iter()
            .map(|(group, row)| {
                let cells = self.columns.iter().enumerate();
                let cells: Vec<_> = cells.map(|(i, c)| row.get(i).unwrap_or(&nothing).value(c.number)).collect();
                context! { group => *group, cells }
            })
            .collect();
        context! { caption => self.caption.clone(), columns, rows }
    }
}
