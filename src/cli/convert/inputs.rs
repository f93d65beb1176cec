use crate::cli::Failure;
use std::fs;
use std::path::{Path, PathBuf};

/// Names under which logs are looked for in folders.
const LOGS: [&str; 6] = ["tlog", "rlog", "raw", "mcap", "ulg", "bin"];

/// One file, and the folder it was found under, if it was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Input {
    pub path: PathBuf,
    pub below: Option<PathBuf>,
}

/// The files that paths, folders and patterns name, each once, in the order given and by name within.
pub(super) fn find(named: &[PathBuf]) -> Result<Vec<Input>, Failure> {
    let mut found: Vec<Input> = Vec::new();
    for path in named {
        let before = found.len();
        if path.is_dir() {
            walk(path, path, &mut found)?;
        } else if path.exists() {
            found.push(Input { path: path.clone(), below: None });
        } else {
            found.extend(matching(path)?.into_iter().map(|path| Input { path, below: None }));
        }
        if found.len() == before {
            return Err(Failure::Usage(format!("{}: no log found there", path.display())));
        }
    }
    let mut seen = std::collections::BTreeSet::new();
    found.retain(|input| seen.insert(input.path.clone()));
    Ok(found)
}

fn walk(folder: &Path, root: &Path, found: &mut Vec<Input>) -> Result<(), Failure> {
    for path in entries(folder)? {
        if path.is_dir() {
            walk(&path, root, found)?;
        } else if path.extension().is_some_and(|e| LOGS.iter().any(|l| e.eq_ignore_ascii_case(l))) {
            found.push(Input { path, below: Some(root.to_owned()) });
        }
    }
    Ok(())
}

/// The files that a pattern in the last part of a path names.
fn matching(pattern: &Path) -> Result<Vec<PathBuf>, Failure> {
    let missing = || Failure::Usage(format!("{}: no such file", pattern.display()));
    let name = pattern.file_name().and_then(|n| n.to_str()).filter(|n| n.contains(['*', '?'])).ok_or_else(missing)?;
    let folder = pattern.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut files = entries(folder)?;
    files.retain(|p| p.is_file() && p.file_name().and_then(|n| n.to_str()).is_some_and(|n| matches(name, n)));
    Ok(files)
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |e: std::io::Error| Failure::Failed(format!("{}: {e}", folder.display()));
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed)? {
        paths.push(entry.map_err(failed)?.path());
    }
    paths.sort();
    Ok(paths)
}

/// Whether a name matches a pattern, in which `*` stands for any characters and `?` for one.
fn matches(pattern: &str, name: &str) -> bool {
    let (pattern, name): (Vec<char>, Vec<char>) = (pattern.chars().collect(), name.chars().collect());
    // positions to return to: after the last star, and how far the star has reached
    let (mut p, mut n, mut star) = (0, 0, None);
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p + 1, n));
                p += 1;
            }
            Some(&c) if c == '?' || c == name[n] => (p, n) = (p + 1, n + 1),
            _ => match star {
                Some((after, reached)) => {
                    star = Some((after, reached + 1));
                    (p, n) = (after, reached + 1);
                }
                None => return false,
            },
        }
    }
    pattern.iter().skip(p).all(|&c| c == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns() {
        for (pattern, name, expected) in [
            ("*.tlog", "flight.tlog", true),
            ("*.tlog", "flight.tlog.gz", false),
            ("2026-??-*.tlog", "2026-01-flight.tlog", true),
            ("a*b*c", "axxbyybzc", true),
            ("a*b*c", "axxbyybz", false),
            ("*", "", true),
            ("?", "", false),
        ] {
            assert_eq!(matches(pattern, name), expected, "{pattern} {name}");
        }
    }

    #[test]
    fn folders_are_searched_and_files_named_twice_count_once() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join("day")).unwrap();
        for name in ["b.tlog", "a.TLOG", "day/c.rlog", "notes.txt"] {
            fs::write(root.path().join(name), b"x").unwrap();
        }
        let inputs = find(&[root.path().to_owned(), root.path().join("b.*")]).unwrap();
        let names: Vec<_> =
            inputs.iter().map(|i| i.path.strip_prefix(root.path()).unwrap().to_str().unwrap()).collect();
        assert_eq!(names, ["a.TLOG", "b.tlog", "day/c.rlog"]);
        assert!(find(&[root.path().join("z*.tlog")]).is_err());
        assert!(find(&[root.path().join("absent.tlog")]).is_err());
    }
}
