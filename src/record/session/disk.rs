//! Where a recording is kept. A trait, so that a full disk can be tried without filling one.

use std::fs::{self, File};
use std::io::{self, Seek, Write};
use std::path::{Path, PathBuf};

/// A folder of recordings.
pub trait Disk {
    type File: Write + Seek;

    /// Makes a file that does not exist yet.
    ///
    /// # Errors
    /// It exists, or the place cannot be written to.
    fn create(&mut self, name: &str) -> io::Result<Self::File>;

    /// Brings what was written to the disk itself.
    ///
    /// # Errors
    /// Those of the disk.
    fn sync(&mut self, name: &str) -> io::Result<()>;

    /// # Errors
    /// Those of the disk.
    fn remove(&mut self, name: &str) -> io::Result<()>;

    /// Names and sizes of the recordings.
    ///
    /// # Errors
    /// Those of the disk.
    fn list(&self) -> io::Result<Vec<(String, u64)>>;
}

/// A folder of the file system, made if it is not there.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
}

impl Folder {
    /// # Errors
    /// It cannot be made.
    pub fn create(path: &Path) -> io::Result<Self> {
        fs::create_dir_all(path)?;
        Ok(Self { path: path.to_owned() })
    }
}

impl Disk for Folder {
    type File = File;

    fn create(&mut self, name: &str) -> io::Result<File> {
        File::create_new(self.path.join(name))
    }

    fn sync(&mut self, name: &str) -> io::Result<()> {
        // any handle serves: it is the file's data that are brought to the disk
        File::options().append(true).open(self.path.join(name))?.sync_data()
    }

    fn remove(&mut self, name: &str) -> io::Result<()> {
        fs::remove_file(self.path.join(name))
    }

    fn list(&self) -> io::Result<Vec<(String, u64)>> {
        let mut found = Vec::new();
        for entry in fs::read_dir(&self.path)? {
            let entry = entry?;
            if let Some(name) = entry.file_name().to_str().filter(|name| is_recording(name)) {
                found.push((name.to_owned(), entry.metadata()?.len()));
            }
        }
        Ok(found)
    }
}

/// The part of a recording's name that is its time.
pub(super) fn stem(name: &str) -> &str {
    name.split('.').next().unwrap_or_default()
}

/// Whether a file is one of ours: nothing else may be removed to keep a budget.
fn is_recording(name: &str) -> bool {
    let (stem, extension) = name.split_once('.').unwrap_or((name, ""));
    let shape = stem.split('-').next().unwrap_or_default();
    let is_time = shape.len() == 16
        && shape.bytes().enumerate().all(|(i, b)| match i {
            8 => b == b'T',
            15 => b == b'Z',
            _ => b.is_ascii_digit(),
        });
    is_time && matches!(extension, "tlog" | "sent.tlog" | "mcap")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_our_own_files_are_recordings() {
        for (name, expected) in [
            ("20260131T235959Z.tlog", true),
            ("20260131T235959Z-2.sent.tlog", true),
            ("20260131T235959Z.mcap", true),
            ("20260131T235959Z.tlog.bak", false),
            ("flight.tlog", false),
            ("2026-01-31.mcap", false),
        ] {
            assert_eq!(is_recording(name), expected, "{name}");
        }
    }
}
