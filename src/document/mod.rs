//! TOML documents, read key by key, with every problem collected and none of them fatal.
//!
//! In: the text of a file. Out: whatever the reader builds from it, or [`Issues`]: each with file, line, column, key,
//! what is wrong and what to do. The keys that a reader asks for *are* the schema: whatever else a table holds is an
//! unknown key, and the nearest known one is suggested. Nothing can therefore be read without being checked, and no
//! list of keys can go stale.
//!
//! Imports nothing of this crate.

mod issue;
mod table;

pub use issue::{Issue, Issues};
pub use table::{Limit, Table, Value};

use std::path::Path;
use toml::de::DeTable;

/// The text of a TOML file and the name by which messages call it.
#[derive(Debug, Clone)]
pub struct Document {
    name: String,
    source: String,
}

impl Document {
    pub fn new(name: impl Into<String>, source: impl Into<String>) -> Self {
        Self { name: name.into(), source: source.into() }
    }

    /// Reads a file; messages call it by its path as given.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        Ok(Self::new(path.display().to_string(), std::fs::read_to_string(path)?))
    }

    /// Hands the root table to `build` and gives what it built together with any warnings, or every issue there is.
    ///
    /// `build` reports problems through the table and answers `None` where it cannot go on.
    pub fn read<T>(&self, build: impl FnOnce(&mut Table<'_>) -> Option<T>) -> Result<(T, Vec<Issue>), Issues> {
        let (root, syntax) = DeTable::parse_recoverable(&self.source);
        let log = issue::Log::new(&self.name, &self.source);
        for error in &syntax {
            log.error(error.span().unwrap_or(0..0), "", format!("not valid TOML: {}", error.message()), "");
        }
        // what follows a syntax error is guesswork: its issues would mislead
        if !syntax.is_empty() {
            return Err(log.into_issues());
        }
        let mut table = Table::root(root.get_ref(), root.span(), &log);
        let built = build(&mut table);
        table.finish();
        match built {
            Some(value) if !log.has_errors() => Ok((value, log.into_warnings())),
            _ => Err(log.into_issues()),
        }
    }
}

/// The candidate most like `word`, if any is like enough to be what was meant.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    candidates
        .into_iter()
        .map(|c| (strsim::jaro_winkler(&word.to_lowercase(), &c.to_lowercase()), c))
        .filter(|(likeness, _)| *likeness > 0.75)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, c)| c)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn issues(source: &str, build: impl FnOnce(&mut Table<'_>) -> Option<()>) -> Vec<Issue> {
        Document::new("a.toml", source).read(build).map(|_| ()).unwrap_err().into_iter().collect()
    }

    #[test]
    fn an_unknown_key_is_placed_and_the_nearest_known_one_named() {
        let found = issues("rate_hz = 5\n\n[out]\nheartbeet = true\n", |t| {
            t.get("rate_hz");
            t.section("out", |t| t.get("heartbeat").is_some());
            Some(())
        });
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].line, found[0].column, found[0].key.as_str()), (4, 1, "out.heartbeet"));
        assert!(found[0].to_string().contains("did you mean `heartbeat`?"), "{}", found[0]);
    }

    #[test]
    fn single_brackets_for_double_ones_are_told() {
        let found = issues("[observer]\nname = 'x'\n", |t| t.require("observer")?.list().map(|_| ()));
        assert!(found[0].to_string().contains("begin each entry with `[[observer]]`"), "{}", found[0]);
    }

    #[test]
    fn every_issue_is_reported_in_the_order_of_the_file() {
        let found = issues("a = -1\nb = 'x'\nc = nan\n", |t| {
            let c = t.require("c").and_then(|v| v.number(Limit::Any));
            let a = t.require("a").and_then(|v| v.number(Limit::Positive));
            let b = t.require("b").and_then(|v| v.number(Limit::Any));
            t.require("d");
            (a, b, c).0.map(|_| ())
        });
        let keys: Vec<_> = found.iter().map(|i| i.key.as_str()).collect();
        assert_eq!(keys, ["d", "a", "b", "c"], "a missing key is reported where its table begins");
    }

    #[test]
    fn syntax_errors_come_alone_and_all_at_once() {
        let found = issues("a = \nb = 1\nc = [1,\n", |t| {
            t.require("zzz");
            Some(())
        });
        assert!(found.len() >= 2 && found.iter().all(|i| i.problem.starts_with("not valid TOML")), "{found:?}");
        assert_eq!(found[0].line, 1);
    }

    #[test]
    fn suggestions_need_likeness() {
        assert_eq!(nearest("mas_kg", ["name", "mass_kg"]), Some("mass_kg"));
        assert_eq!(nearest("colour", ["name", "mass_kg"]), None);
    }
}
