//! Imports go one way. The table in the crate's documentation (`src/lib.rs`) says which folder may import which; this
//! test reads it there and holds every source file against it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

const MAY_USE_TOKIO: [&str; 4] = ["src/daemon/", "src/cli/run/", "src/cli/tap/", "src/cli/demo/bridge.rs"];

/// Folder → the folders it may import; `None` for "everything".
type Rules = BTreeMap<String, Option<BTreeSet<String>>>;

#[test]
fn every_folder_imports_only_what_the_table_allows() {
    let rules = rules();
    let mut breaches = Vec::new();
    for source in sources() {
        let Some(allowed) = &rules[&source.folder] else { continue };
        for (line, target) in source.imports() {
            let known = rules.contains_key(&target);
            if known && target != source.folder && !allowed.contains(&target) {
                breaches.push(format!("{}:{line}: {} may not import {target}", source.path, source.folder));
            }
        }
    }
    assert!(breaches.is_empty(), "the table in src/lib.rs forbids:\n{}", breaches.join("\n"));
}

#[test]
fn the_table_and_the_folders_are_the_same() {
    let in_table: BTreeSet<_> = rules().into_keys().collect();
    let on_disk: BTreeSet<_> = sources().into_iter().map(|s| s.folder).collect();
    assert_eq!(in_table, on_disk);
}

#[test]
fn only_the_command_line_imports_the_daemon() {
    for source in sources().iter().filter(|s| s.folder != "daemon" && s.folder != "cli") {
        let breach = source.imports().into_iter().find(|(_, target)| target == "daemon");
        assert_eq!(breach, None, "{}", source.path);
    }
}

#[test]
fn tokio_stays_in_the_daemon() {
    for source in sources() {
        if MAY_USE_TOKIO.iter().any(|place| source.path.starts_with(place)) {
            continue;
        }
        for (i, line) in source.code.lines().enumerate() {
            assert!(!line.contains("tokio::") && !line.contains("tokio_util"), "{}:{}: {line}", source.path, i + 1);
        }
    }
}

#[test]
fn no_file_reaches_over_its_folder() {
    for source in sources() {
        // `super` from a file at depth n leaves the folder after n steps
        let depth = source.path.matches('/').count() - usize::from(source.path.ends_with("/mod.rs"));
        let escape = "super::".repeat(depth.max(1));
        for (i, line) in source.code.lines().enumerate() {
            let reach = line.find(&escape);
            assert_eq!(reach, None, "{}:{}: write crate:: instead: {line}", source.path, i + 1);
        }
    }
}

/// One source file, its comments and its unit tests left out (line numbers stay).
struct Source {
    path: String,
    folder: String,
    code: String,
}

impl Source {
    /// Line and folder of each `crate::folder` in the code, also inside `crate::{…}`.
    fn imports(&self) -> Vec<(usize, String)> {
        let mut found = Vec::new();
        for (at, token) in self.code.match_indices("crate::") {
            let line = self.code[..at].matches('\n').count() + 1;
            let rest = &self.code[at + token.len()..];
            match rest.strip_prefix('{') {
                Some(group) => found.extend(heads(group).into_iter().map(|name| (line, name))),
                None => found.push((line, identifier(rest))),
            }
        }
        found
    }
}

/// The first identifier of each member of a `{a, b::c, d::{e, f}}` group, given without its opening brace.
fn heads(group: &str) -> Vec<String> {
    let (mut depth, mut start, mut heads) = (0, 0, Vec::new());
    for (i, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                heads.push(identifier(group[start..i].trim_start()));
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    heads
}

fn identifier(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

#[test]
fn groups_are_read() {
    let code = "use crate::{sets::Interval, signal::{Stamp, Sample}, vehicle};\nfn f(x: crate::wire::Event) {}\n";
    let source = Source { path: String::new(), folder: String::new(), code: code.into() };
    let names: Vec<_> = source.imports().into_iter().map(|(line, name)| format!("{line} {name}")).collect();
    assert_eq!(names, ["1 sets", "1 signal", "1 vehicle", "2 wire"]);
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn sources() -> Vec<Source> {
    let mut files = Vec::new();
    collect(&root().join("src"), &mut files);
    assert!(files.len() > 20, "found only {} files", files.len());
    files
        .into_iter()
        .filter_map(|file| {
            let path = file.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
            let folder = path.split('/').nth(1)?.to_owned();
            // lib.rs and main.rs only wire; files of tests may look around
            let skip = folder.ends_with(".rs") || path.ends_with("/tests.rs") || path.contains("/tests/");
            let text = fs::read_to_string(&file).unwrap();
            (!skip).then(|| Source { path, folder, code: code_of(&text) })
        })
        .collect()
}

fn collect(dir: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// The code before the unit tests, comment lines emptied.
fn code_of(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    code.lines()
        .map(|line| if line.trim_start().starts_with("//") { "\n".into() } else { format!("{line}\n") })
        .collect()
}

/// Reads `//! | [`folder`] | … | imports |` rows; "all of the above" means the rows before.
fn rules() -> Rules {
    let lib = fs::read_to_string(root().join("src/lib.rs")).unwrap();
    let mut rules = Rules::new();
    for row in lib.lines().filter_map(|l| l.strip_prefix("//! | [`")) {
        let cells: Vec<_> = row.trim_end_matches([' ', '|']).split(" | ").collect();
        let [folder, _, allowed] = cells[..] else { panic!("no row of three cells: {row}") };
        let folder = folder.trim_end_matches("`]").to_owned();
        let allowed = match allowed {
            "everything" => None,
            "nothing" => Some(BTreeSet::new()),
            "all of the above" => Some(rules.keys().cloned().collect()),
            list => Some(list.split(", ").map(|name| name.trim_matches('`').to_owned()).collect()),
        };
        rules.insert(folder, allowed);
    }
    assert!(rules.len() > 10, "the table in src/lib.rs was not found");
    rules
}
