use serde::Serialize;
use std::cell::RefCell;
use std::fmt;
use std::ops::Range;

/// One thing that is wrong (or doubtful) in a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Issue {
    pub file: String,
    /// From 1.
    pub line: usize,
    /// From 1, in characters.
    pub column: usize,
    /// Path of the key, such as `rotor[2].spin`; empty for the document itself.
    pub key: String,
    /// What is wrong.
    pub problem: String,
    /// What to do about it; may be empty.
    pub advice: String,
    /// The line of the file.
    #[serde(skip)]
    excerpt: String,
    /// How many characters of it are meant.
    #[serde(skip)]
    width: usize,
}

impl fmt::Display for Issue {
    /// Place and problem, then the line with the place underlined and what to do.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}:{}:{}: {}", self.file, self.line, self.column, self.problem)?;
        let number = self.line.to_string();
        writeln!(f, "  {number} | {}", self.excerpt)?;
        let (gutter, indent) = (" ".repeat(number.len()), " ".repeat(self.column.saturating_sub(1)));
        let rule = "^".repeat(self.width.max(1));
        write!(f, "  {gutter} | {indent}{rule}")?;
        if self.advice.is_empty() { Ok(()) } else { write!(f, " {}", self.advice) }
    }
}

/// Everything that is wrong in a document, in the order of its lines. Never empty.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Issues(Vec<Issue>);

impl Issues {
    pub fn iter(&self) -> std::slice::Iter<'_, Issue> {
        self.0.iter()
    }

    pub fn len(&self) -> usize {
        self.0.len()
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl IntoIterator for Issues {
    type Item = Issue;
    type IntoIter = std::vec::IntoIter<Issue>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

impl FromIterator<Issue> for Issues {
    fn from_iter<I: IntoIterator<Item = Issue>>(iter: I) -> Self {
        Self(iter.into_iter().collect())
    }
}

impl fmt::Display for Issues {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0.len() {
            1 => write!(f, "1 problem")?,
            n => write!(f, "{n} problems")?,
        }
        for issue in &self.0 {
            write!(f, "\n\n{issue}")?;
        }
        Ok(())
    }
}

impl std::error::Error for Issues {}

/// Collects issues while a document is read.
pub(super) struct Log<'d> {
    file: &'d str,
    source: &'d str,
    errors: RefCell<Vec<Issue>>,
    warnings: RefCell<Vec<Issue>>,
}

impl<'d> Log<'d> {
    pub fn new(file: &'d str, source: &'d str) -> Self {
        Self { file, source, errors: RefCell::default(), warnings: RefCell::default() }
    }

    pub fn error(&self, span: Range<usize>, key: &str, problem: String, advice: &str) {
        self.errors.borrow_mut().push(self.issue(span, key, problem, advice));
    }

    pub fn warning(&self, span: Range<usize>, key: &str, problem: String, advice: &str) {
        self.warnings.borrow_mut().push(self.issue(span, key, problem, advice));
    }

    pub fn adopt(&self, issues: Issues) {
        self.errors.borrow_mut().extend(issues);
    }

    pub fn has_errors(&self) -> bool {
        !self.errors.borrow().is_empty()
    }

    pub fn into_issues(self) -> Issues {
        Issues(in_order(self.file, self.errors.into_inner()))
    }

    pub fn into_warnings(self) -> Vec<Issue> {
        in_order(self.file, self.warnings.into_inner())
    }

    fn issue(&self, span: Range<usize>, key: &str, problem: String, advice: &str) -> Issue {
        let before = self.source.get(..span.start).unwrap_or(self.source);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        let excerpt = self.source.get(line_start..).and_then(|rest| rest.lines().next()).unwrap_or_default();
        let column = before.get(line_start..).unwrap_or_default().chars().count();
        let meant = self.source.get(span).unwrap_or_default().lines().next().unwrap_or_default();
        Issue {
            file: self.file.to_owned(),
            line: before.matches('\n').count() + 1,
            column: column + 1,
            key: key.to_owned(),
            problem,
            advice: advice.to_owned(),
            excerpt: excerpt.to_owned(),
            width: meant.chars().count(),
        }
    }
}

/// The document's own issues first, then those of other files.
fn in_order(file: &str, mut issues: Vec<Issue>) -> Vec<Issue> {
    issues.sort_by_cached_key(|i| (i.file != file, i.file.clone(), i.line, i.column));
    issues
}
