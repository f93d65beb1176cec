//! Reports as one HTML file: no network, light and dark, good on paper. Everything is escaped.

mod table;

pub use table::{Cell, Column, Table, Tone};

use super::{Figure, ReportError};
use minijinja::{AutoEscape, Environment, Value, context};

/// A page: heading, a line that says what it is about, key facts, sections.
#[derive(Debug, Clone, Default)]
pub struct Page {
    title: String,
    lead: String,
    facts: Vec<(String, String)>,
    sections: Vec<Section>,
}

/// A heading with what stands below it, in order.
#[derive(Debug, Clone, Default)]
pub struct Section {
    heading: String,
    blocks: Vec<Block>,
}

#[derive(Debug, Clone)]
enum Block {
    Paragraph(String),
    List(Vec<String>),
    Code(String),
    Table(Table),
    Figure { figure: Figure, caption: String },
    Details { summary: String, blocks: Vec<Block> },
}

impl Page {
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// What the page is about, in a sentence or two below the heading.
    #[must_use]
    pub fn lead(mut self, text: impl Into<String>) -> Self {
        self.lead = text.into();
        self
    }

    /// A key fact: a name, and a value with its unit.
    #[must_use]
    pub fn fact(mut self, name: impl Into<String>, value: impl Into<String>) -> Self {
        self.facts.push((name.into(), value.into()));
        self
    }

    #[must_use]
    pub fn section(mut self, section: Section) -> Self {
        self.sections.push(section);
        self
    }

    /// The page as one HTML document.
    ///
    /// # Errors
    /// A figure cannot be drawn; see [`Figure::svg`].
    pub fn html(&self) -> Result<String, ReportError> {
        let sections = self.sections.iter().map(Section::value).collect::<Result<Vec<_>, _>>()?;
        let facts: Vec<_> = self.facts.iter().map(|(name, value)| context! { name, value }).collect();
        let failed = |source| ReportError::Page { title: self.title.clone(), source };
        let mut environment = Environment::new();
        environment.set_auto_escape_callback(|_| AutoEscape::Html);
        environment.add_template("page", include_str!("page.html")).map_err(failed)?;
        let page = environment.get_template("page").map_err(failed)?;
        let lead = self.lead.clone();
        page.render(context! { title => self.title.clone(), lead, facts, sections }).map_err(failed)
    }
}

impl Section {
    pub fn new(heading: impl Into<String>) -> Self {
        Self { heading: heading.into(), blocks: Vec::new() }
    }

    fn with(mut self, block: Block) -> Self {
        self.blocks.push(block);
        self
    }

    #[must_use]
    pub fn paragraph(self, text: impl Into<String>) -> Self {
        self.with(Block::Paragraph(text.into()))
    }

    #[must_use]
    pub fn list<T: Into<String>>(self, items: impl IntoIterator<Item = T>) -> Self {
        self.with(Block::List(items.into_iter().map(Into::into).collect()))
    }

    /// Text with its line breaks and in letters of one width.
    #[must_use]
    pub fn code(self, text: impl Into<String>) -> Self {
        self.with(Block::Code(text.into()))
    }

    #[must_use]
    pub fn table(self, table: Table) -> Self {
        self.with(Block::Table(table))
    }

    #[must_use]
    pub fn figure(self, figure: Figure, caption: impl Into<String>) -> Self {
        self.with(Block::Figure { figure, caption: caption.into() })
    }

    /// What another section holds, under its heading, folded away until the reader asks for it.
    #[must_use]
    pub fn details(self, folded: Section) -> Self {
        self.with(Block::Details { summary: folded.heading, blocks: folded.blocks })
    }

    fn value(&self) -> Result<Value, ReportError> {
        let blocks = values(&self.blocks)?;
        Ok(context! { heading => self.heading.clone(), blocks })
    }
}

fn values(blocks: &[Block]) -> Result<Vec<Value>, ReportError> {
    blocks.iter().map(Block::value).collect()
}

impl Block {
    fn value(&self) -> Result<Value, ReportError> {
        Ok(match self {
            Self::Paragraph(text) => context! { kind => "paragraph", text },
            Self::List(items) => context! { kind => "list", items },
            Self::Code(text) => context! { kind => "code", text },
            Self::Table(table) => context! { kind => "table", table => table.value() },
            Self::Figure { figure, caption } => {
                // our own drawing, whose texts are escaped already
                let svg = Value::from_safe_string(figure.svg()?);
                context! { kind => "figure", svg, caption }
            }
            Self::Details { summary, blocks } => {
                let blocks = values(blocks)?;
                context! { kind => "details", summary, blocks }
            }
        })
    }
}

#[cfg(test)]
mod tests;
