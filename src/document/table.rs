use super::issue::{Issues, Log};
use super::nearest;
use std::ops::{Range, RangeInclusive};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A table being read. Asking for a key makes it known; whatever else the table holds is reported in the end.
pub struct Table<'d> {
    /// `None` for a section that the document leaves out: it reads as an empty one, so that defaults live in one place.
    entries: Option<&'d DeTable<'d>>,
    path: String,
    span: Range<usize>,
    known: Vec<&'d str>,
    log: &'d Log<'d>,
}

/// One value and where it stands.
#[derive(Clone)]
pub struct Value<'d> {
    value: &'d DeValue<'d>,
    path: String,
    span: Range<usize>,
    log: &'d Log<'d>,
}

/// What a number may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Limit {
    Any,
    /// Above zero.
    Positive,
    /// Zero or above.
    NonNegative,
    /// Both ends allowed.
    Within(f64, f64),
}

impl Limit {
    pub fn allows(self, x: f64) -> bool {
        match self {
            Self::Any => true,
            Self::Positive => x > 0.0,
            Self::NonNegative => x >= 0.0,
            Self::Within(lo, hi) => lo <= x && x <= hi,
        }
    }

    fn rule(self) -> String {
        match self {
            Self::Any => "must be a finite number".to_owned(),
            Self::Positive => "must be greater than 0".to_owned(),
            Self::NonNegative => "must not be negative".to_owned(),
            Self::Within(lo, hi) => format!("must lie between {lo} and {hi}"),
        }
    }
}

impl<'d> Table<'d> {
    pub(super) fn root(entries: &'d DeTable<'d>, span: Range<usize>, log: &'d Log<'d>) -> Self {
        Self { entries: Some(entries), path: String::new(), span: span.start..span.start, known: Vec::new(), log }
    }

    /// The value of a key that may be left out.
    pub fn get(&mut self, key: &'static str) -> Option<Value<'d>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        let value = self.entries?.get(key)?;
        Some(self.value(key, value))
    }

    /// The value of a key that must be there.
    pub fn require(&mut self, key: &'static str) -> Option<Value<'d>> {
        let value = self.get(key);
        if value.is_none() {
            let path = self.join(key);
            self.log.error(self.span.clone(), &path, format!("`{path}` is missing"), &format!("add `{key} = …`"));
        }
        value
    }

    /// True if the document has nothing in this table.
    pub fn is_empty(&self) -> bool {
        self.entries.is_none_or(|entries| entries.is_empty())
    }

    /// Reads the table under a key. One that is left out reads as an empty one.
    pub fn section<T>(&mut self, key: &'static str, read: impl FnOnce(&mut Table<'d>) -> T) -> T {
        let table = self.get(key).and_then(|v| v.into_table());
        let mut table = table.unwrap_or_else(|| Table {
            entries: None,
            path: self.join(key),
            span: self.span.clone(),
            known: Vec::new(),
            log: self.log,
        });
        let built = read(&mut table);
        table.finish();
        built
    }

    /// Reads each table of an array of tables (`[[key]]`); none when it is left out.
    pub fn sections<T>(&mut self, key: &'static str, mut read: impl FnMut(&mut Table<'d>) -> T) -> Vec<T> {
        let mut built = Vec::new();
        for value in self.get(key).and_then(|v| v.list()).unwrap_or_default() {
            if let Some(mut table) = value.into_table() {
                built.push(read(&mut table));
                table.finish();
            }
        }
        built
    }

    /// The values of the keys that `choose` takes, such as numbers; those keys become known.
    pub fn take_matching<K>(&mut self, choose: impl Fn(&str) -> Option<K>) -> Vec<(K, Value<'d>)> {
        let Some(entries) = self.entries else { return Vec::new() };
        let mut taken = Vec::new();
        for (key, value) in entries {
            let name: &'d str = key.get_ref().as_ref();
            if let Some(k) = choose(name) {
                self.known.push(name);
                taken.push((k, self.value(name, value)));
            }
        }
        taken
    }

    /// Reports a problem with this table as a whole.
    pub fn problem(&self, problem: impl Into<String>, advice: &str) {
        self.log.error(self.span.clone(), &self.path, problem.into(), advice);
    }

    /// Reports something about this table that is allowed but doubtful.
    pub fn warn(&self, problem: impl Into<String>, advice: &str) {
        self.log.warning(self.span.clone(), &self.path, problem.into(), advice);
    }

    pub(super) fn finish(self) {
        let Some(entries) = self.entries else { return };
        for key in entries.keys() {
            let name = key.get_ref().as_ref();
            if self.known.contains(&name) {
                continue;
            }
            let advice = match nearest(name, self.known.iter().copied()) {
                Some(known) => format!("did you mean `{known}`?"),
                None => format!("known here: {}", self.known.join(", ")),
            };
            let place = if self.path.is_empty() { String::new() } else { format!(" in `{}`", self.path) };
            self.log.error(key.span(), &self.join(name), format!("unknown key `{name}`{place}"), &advice);
        }
    }

    fn value(&self, key: &str, value: &'d Spanned<DeValue<'d>>) -> Value<'d> {
        Value { value: value.get_ref(), path: self.join(key), span: value.span(), log: self.log }
    }

    fn join(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

impl<'d> Value<'d> {
    /// Reports a problem with this value. `problem` continues a sentence that begins with the key.
    pub fn problem(&self, problem: impl AsRef<str>, advice: &str) {
        let sentence = format!("`{}` {}", self.path, problem.as_ref());
        self.log.error(self.span.clone(), &self.path, sentence, advice);
    }

    /// Reports something about this value that is allowed but doubtful.
    pub fn warn(&self, problem: impl AsRef<str>, advice: &str) {
        let sentence = format!("`{}` {}", self.path, problem.as_ref());
        self.log.warning(self.span.clone(), &self.path, sentence, advice);
    }

    /// Takes over the issues of another document that this value names.
    pub fn adopt(&self, issues: Issues) {
        self.log.adopt(issues);
    }

    /// A finite number within `limit`.
    pub fn number(&self, limit: Limit) -> Option<f64> {
        let x = match self.value {
            DeValue::Float(x) => x.as_str().parse().ok(),
            DeValue::Integer(i) => i64::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
            _ => return self.mistyped("a number"),
        };
        match x {
            Some(x) if x.is_finite() && limit.allows(x) => Some(x),
            Some(x) if x.is_finite() => self.refuse(&format!("{}, not {x}", limit.rule())),
            _ => self.refuse("must be a finite number"),
        }
    }

    /// A whole number within `range`.
    pub fn integer(&self, range: RangeInclusive<i64>) -> Option<i64> {
        let DeValue::Integer(i) = self.value else { return self.mistyped("a whole number") };
        match i64::from_str_radix(i.as_str(), i.radix()) {
            Ok(i) if range.contains(&i) => Some(i),
            _ => self.refuse(&format!("must lie between {} and {}, not {i}", range.start(), range.end())),
        }
    }

    pub fn flag(&self) -> Option<bool> {
        self.value.as_bool().or_else(|| self.mistyped("true or false"))
    }

    pub fn text(&self) -> Option<&'d str> {
        self.value.as_str().or_else(|| self.mistyped("a text in quotes"))
    }

    /// One of a few words, each with what it means.
    pub fn one_of<T: Copy>(&self, words: &[(&str, T)]) -> Option<T> {
        let word = self.text()?;
        if let Some((_, meaning)) = words.iter().find(|(w, _)| *w == word) {
            return Some(*meaning);
        }
        let all: Vec<_> = words.iter().map(|(w, _)| format!("\"{w}\"")).collect();
        let advice = match nearest(word, words.iter().map(|(w, _)| *w)) {
            Some(near) => format!("did you mean \"{near}\"?"),
            None => String::new(),
        };
        self.problem(format!("must be one of {}, not \"{word}\"", all.join(", ")), &advice);
        None
    }

    pub fn is_list(&self) -> bool {
        self.value.is_array()
    }

    pub fn is_table(&self) -> bool {
        self.value.is_table()
    }

    pub fn is_flag(&self) -> bool {
        self.value.is_bool()
    }

    pub fn is_text(&self) -> bool {
        self.value.is_str()
    }

    /// The members of a list; their paths count from 1.
    pub fn list(&self) -> Option<Vec<Value<'d>>> {
        let Some(items) = self.value.as_array() else { return self.mistyped("a list") };
        let member = |(i, v): (usize, &'d Spanned<DeValue<'d>>)| Value {
            value: v.get_ref(),
            path: format!("{}[{}]", self.path, i + 1),
            span: v.span(),
            log: self.log,
        };
        Some(items.iter().enumerate().map(member).collect())
    }

    /// A list of exactly `N` members.
    pub fn array<const N: usize>(&self) -> Option<[Value<'d>; N]> {
        let items = self.list()?;
        let n = items.len();
        items.try_into().ok().or_else(|| self.refuse(&format!("must be a list of {N}, not of {n}")))
    }

    /// Reads this value as a table of its own.
    pub fn table<T>(&self, read: impl FnOnce(&mut Table<'d>) -> Option<T>) -> Option<T> {
        let mut table = self.clone().into_table()?;
        let built = read(&mut table);
        table.finish();
        built
    }

    fn into_table(self) -> Option<Table<'d>> {
        let Some(entries) = self.value.as_table() else { return self.mistyped("a table") };
        Some(Table { entries: Some(entries), path: self.path, span: self.span, known: Vec::new(), log: self.log })
    }

    fn mistyped<T>(&self, wanted: &str) -> Option<T> {
        let is = self.value.type_str();
        let advice = match (wanted, is) {
            // the mistake that TOML invites
            ("a list", "table") => format!("begin each entry with `[[{}]]`", self.path),
            _ => String::new(),
        };
        self.problem(format!("must be {wanted}, not a {is}"), &advice);
        None
    }

    fn refuse<T>(&self, problem: &str) -> Option<T> {
        self.problem(problem, "");
        None
    }
}
