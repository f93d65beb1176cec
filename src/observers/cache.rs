//! Gains kept on disk, so that a start costs a proof instead of a synthesis.
//!
//! One JSON file per design under `$XDG_CACHE_HOME/mavobserver` (else `~/.cache/mavobserver`), named by a hash of all
//! inputs, which stand in the file too and are compared. A file holds only numbers: everything that is claimed about
//! them is proven anew when they are read, so a damaged or doctored file is redone, never believed. Trouble with the
//! cache is no error: the design is then made.
//!
//! An observer gives [`Cache::fetch`] its inputs, a proof and a synthesis; see `quadratic_bounded` for an example.

use nalgebra::DMatrix;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::fmt::{Display, Write as _};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Raised when the same inputs come to mean another design.
const FORMAT: u32 = 2;

/// Where designs are kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cache {
    Directory(PathBuf),
    /// Nothing is read or written.
    Off,
}

impl Cache {
    /// The user's cache directory; off when the environment names none.
    pub fn of_user() -> Self {
        let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|p| p.is_absolute());
        absolute("XDG_CACHE_HOME")
            .or_else(|| absolute("HOME").map(|h| h.join(".cache")))
            .map_or(Self::Off, |base| Self::Directory(base.join("mavobserver")))
    }

    /// The design of these inputs: read and proven anew when it is kept, else made and then kept.
    ///
    /// `kind` begins the file's name. `prove` turns the numbers of a file into a design, or says why they are none; it
    /// must believe nothing about them, not even their shapes. `make` gives the numbers to keep beside the design.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn fetch<I, N, D, R: Display, E>(
        &self,
        kind: &str,
        inputs: &I,
        prove: impl FnOnce(&N) -> Result<D, R>,
        make: impl FnOnce() -> Result<(N, D), E>,
    ) -> Result<D, E>
    where
        I: Serialize + DeserializeOwned + PartialEq,
        N: Serialize + DeserializeOwned,
    {
        let place = match self {
            Self::Directory(directory) => Self::key(inputs).map(|key| (directory, key)),
            Self::Off => None,
        };
        let Some((directory, key)) = place else { return make().map(|(_, design)| design) };
        let path = directory.join(format!("{kind}-{key}.json"));
        if let Some(design) = read(&path, inputs, prove) {
            return Ok(design);
        }
        let (numbers, design) = make()?;
        if let Err(e) = write(directory, &path, &Kept { inputs, numbers }) {
            tracing::debug!("design not cached in {}: {e}", path.display());
        }
        Ok(design)
    }

    /// A name for these inputs; `None` when they cannot be written down.
    pub(super) fn key<I: Serialize>(inputs: &I) -> Option<String> {
        let text = serde_json::to_vec(&(FORMAT, inputs)).ok()?;
        let mut key = String::new();
        for byte in Sha256::digest(text).iter().take(8) {
            // writing to a String cannot fail
            let _ = write!(key, "{byte:02x}");
        }
        Some(key)
    }
}

/// A matrix as rows, as one reads it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rows(pub Vec<Vec<f64>>);

impl Rows {
    pub fn of(m: &DMatrix<f64>) -> Self {
        Self(m.row_iter().map(|r| r.iter().copied().collect()).collect())
    }

    /// The matrix; `None` unless it has this shape and every entry is finite.
    pub fn matrix(&self, rows: usize, cols: usize) -> Option<DMatrix<f64>> {
        let fits = self.0.len() == rows && self.0.iter().all(|r| r.len() == cols);
        (fits && self.0.iter().flatten().all(|x| x.is_finite()))
            .then(|| DMatrix::from_fn(rows, cols, |i, j| self.0[i][j]))
    }
}

#[derive(Serialize)]
struct Kept<'a, I, N> {
    inputs: &'a I,
    numbers: N,
}

#[derive(Deserialize)]
struct Found<I, N> {
    inputs: I,
    numbers: N,
}

fn read<I, N, D, R: Display>(path: &Path, inputs: &I, prove: impl FnOnce(&N) -> Result<D, R>) -> Option<D>
where
    I: DeserializeOwned + PartialEq,
    N: DeserializeOwned,
{
    let text = std::fs::read_to_string(path).ok()?;
    let redo = |why: &dyn Display| tracing::warn!("{} is redone: {why}", path.display());
    let Ok(found) = serde_json::from_str::<Found<I, N>>(&text) else {
        redo(&"not a design");
        return None;
    };
    if found.inputs != *inputs {
        redo(&"made for other inputs");
        return None;
    }
    prove(&found.numbers).inspect_err(|e| redo(e)).ok()
}

/// Writes beside the file and renames, so that no reader meets half an entry.
fn write<I: Serialize, N: Serialize>(directory: &Path, path: &Path, entry: &Kept<'_, I, N>) -> std::io::Result<()> {
    std::fs::create_dir_all(directory)?;
    let part = path.with_extension(format!("{}.part", std::process::id()));
    let written = std::fs::File::create(&part).and_then(|mut file| {
        file.write_all(&serde_json::to_vec(entry)?)?;
        file.sync_all()
    });
    written.and_then(|()| std::fs::rename(&part, path)).inspect_err(|_| {
        // best effort: a leftover part is harmless
        let _ = std::fs::remove_file(&part);
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_is_proven_and_what_fails_is_made_again() {
        let home = tempfile::tempdir().unwrap();
        let cache = Cache::Directory(home.path().join("not/yet/there"));
        let fetch = |square: f64, proof: &dyn Fn(f64) -> bool| {
            cache.fetch(
                "root",
                &square,
                |root: &f64| if proof(*root) { Ok((*root, "kept")) } else { Err("not the root") },
                || Ok::<_, ()>((square.sqrt(), (square.sqrt(), "made"))),
            )
        };
        assert_eq!(fetch(2.0, &|_| true), Ok((2f64.sqrt(), "made")));
        assert_eq!(fetch(2.0, &|r| r * r == 2f64.sqrt() * 2f64.sqrt()), Ok((2f64.sqrt(), "kept")));
        assert_eq!(fetch(2.0, &|_| false), Ok((2f64.sqrt(), "made")));
        assert_eq!(fetch(3.0, &|_| true), Ok((3f64.sqrt(), "made")));
    }

    #[test]
    fn a_matrix_of_another_shape_is_none() {
        let m = DMatrix::from_row_slice(1, 2, &[1.0, 2.0]);
        assert_eq!(Rows::of(&m).matrix(1, 2), Some(m.clone()));
        assert_eq!(Rows::of(&m).matrix(2, 1), None);
        assert_eq!(Rows(vec![vec![1.0], vec![f64::NAN]]).matrix(2, 1), None);
    }
}
