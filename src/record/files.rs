//! Files: what they are, and how new ones come to be.

use super::error::RecordError;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::{Path, PathBuf};

/// Kinds of logs, told by their first bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// MAVLink frames, with or without receive times.
    Telemetry,
    Mcap,
    /// PX4's log.
    Ulog,
    /// ArduPilot's log (`.bin`).
    Dataflash,
}

impl FileKind {
    /// # Errors
    /// The file cannot be opened or read.
    pub fn of(path: &Path) -> Result<Self, RecordError> {
        let open = |source| RecordError::Open { path: path.to_owned(), source };
        let mut head = Vec::new();
        File::open(path).map_err(open)?.take(8).read_to_end(&mut head).map_err(RecordError::Read)?;
        Ok(match head.as_slice() {
            [0x89, b'M', b'C', b'A', b'P', ..] => Self::Mcap,
            [b'U', b'L', b'o', b'g', ..] => Self::Ulog,
            // two magic bytes, then the type of the message that describes messages
            [0xA3, 0x95, 0x80, ..] => Self::Dataflash,
            _ => Self::Telemetry,
        })
    }
}

/// A file that appears under its name only when it is whole: until [`Self::commit`] it has a temporary name beside it,
/// and dropping it removes it.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    temporary: PathBuf,
    file: File,
    force: bool,
    committed: bool,
}

impl NewFile {
    /// Makes the temporary file, and folders on the way. `force` lets it replace a file of that name.
    ///
    /// # Errors
    /// The file exists and `force` is not given, or the place cannot be written to.
    pub fn create(path: &Path, force: bool) -> Result<Self, RecordError> {
        let failed = |source| RecordError::Open { path: path.to_owned(), source };
        if !force && path.exists() {
            return Err(exists(path));
        }
        if let Some(folder) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(failed)?;
        }
        let name = path.file_name().ok_or_else(|| failed(io::ErrorKind::InvalidFilename.into()))?;
        let temporary = path.with_file_name(format!(".{}.{}.part", name.to_string_lossy(), std::process::id()));
        let file = File::create(&temporary).map_err(failed)?;
        Ok(Self { path: path.to_owned(), temporary, file, force, committed: false })
    }

    /// The file to write to.
    ///
    /// # Errors
    /// The system has no more handles.
    pub fn file(&self) -> Result<File, RecordError> {
        self.file.try_clone().map_err(RecordError::Write)
    }

    /// Brings everything to the disk and gives the file its name; returns its length.
    ///
    /// # Errors
    /// The disk is full or fails, or a file of that name has come to be.
    pub fn commit(mut self) -> Result<u64, RecordError> {
        self.file.sync_all().map_err(RecordError::Write)?;
        let len = self.file.metadata().map_err(RecordError::Write)?.len();
        if self.force {
            fs::rename(&self.temporary, &self.path).map_err(RecordError::Write)?;
        } else {
            // a link, unlike a rename, refuses a name that is taken
            match fs::hard_link(&self.temporary, &self.path) {
                Ok(()) => fs::remove_file(&self.temporary).map_err(RecordError::Write)?,
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => return Err(exists(&self.path)),
                // some file systems know no links
                Err(_) if !self.path.exists() => {
                    fs::rename(&self.temporary, &self.path).map_err(RecordError::Write)?;
                }
                Err(_) => return Err(exists(&self.path)),
            }
        }
        self.committed = true;
        Ok(len)
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        if !self.committed {
            // what remains under a temporary name harms nobody
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

fn exists(path: &Path) -> RecordError {
    RecordError::Unsupported(format!("{} exists; --force replaces it", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("below/out.mcap");
        let new = NewFile::create(&path, false).unwrap();
        new.file().unwrap().write_all(b"half").unwrap();
        assert!(!path.exists());
        drop(new);
        assert_eq!(fs::read_dir(folder.path().join("below")).unwrap().count(), 0, "nothing is left behind");

        let new = NewFile::create(&path, false).unwrap();
        new.file().unwrap().write_all(b"whole").unwrap();
        assert_eq!(new.commit().unwrap(), 5);
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert!(NewFile::create(&path, false).is_err());
        let replaced = NewFile::create(&path, true).unwrap();
        replaced.commit().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"");
    }

    #[test]
    fn a_file_that_comes_meanwhile_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.mcap");
        let new = NewFile::create(&path, false).unwrap();
        fs::write(&path, b"another's").unwrap();
        assert!(new.commit().is_err());
        assert_eq!(fs::read(&path).unwrap(), b"another's");
    }
}
