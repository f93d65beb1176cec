use crate::document::{Table, Value};
use crate::wire::signing::{Key, Unsigned};
use std::path::{Path, PathBuf};

/// How frames are signed and checked on one link.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Signing {
    pub key: Key,
    /// Tells our signatures on this link from those on others with the same key.
    pub link_id: u8,
    pub unsigned: Unsigned,
    /// Where the newest time that was seen or signed is kept.
    pub times: PathBuf,
}

/// Reads the table `signing` of the `number`-th link (from 0); `None` where it is left out or wrong.
pub(super) fn signing(t: &mut Table<'_>, base: &Path, number: usize) -> Option<Signing> {
    let file = t.get("key_file");
    let link_id = t.get("link_id").and_then(|v| v.integer(0..=255)).and_then(|id| u8::try_from(id).ok());
    let words = [("refuse", Unsigned::Refuse), ("accept", Unsigned::Accept)];
    let unsigned = t.get("unsigned").map_or(Some(Unsigned::Refuse), |v| v.one_of(&words));
    let Some(file) = file else {
        if !t.is_empty() {
            t.problem("`signing` has no key", "add `key_file = …`");
        }
        return None;
    };
    let path = base.join(file.text()?);
    let key = read_key(&file, &path)?;
    let mut times = path.into_os_string();
    times.push(".times");
    let link_id = link_id.unwrap_or(u8::try_from(number).unwrap_or(u8::MAX));
    Some(Signing { key, link_id, unsigned: unsigned?, times: times.into() })
}

fn read_key(v: &Value<'_>, path: &Path) -> Option<Key> {
    if let Some(others) = open_to_others(path) {
        v.problem(
            format!("may be read by others (its mode is {others:03o})"),
            &format!("chmod 600 {}", path.display()),
        );
        return None;
    }
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(e) => {
            v.problem(format!("cannot be read: {}: {e}", path.display()), "it holds 64 hexadecimal digits");
            return None;
        }
    };
    match Key::parse(&text) {
        Ok(key) => Some(key),
        Err(e) => {
            v.problem(format!("is no key: {e}"), "");
            None
        }
    }
}

/// The mode of a file that others than its owner may use.
#[cfg(unix)]
fn open_to_others(path: &Path) -> Option<u32> {
    use std::os::unix::fs::MetadataExt;
    let mode = std::fs::metadata(path).ok()?.mode() & 0o777;
    (mode & 0o077 != 0).then_some(mode)
}

#[cfg(not(unix))]
fn open_to_others(_: &Path) -> Option<u32> {
    None
}

#[cfg(test)]
mod tests {
    use crate::config::Config;
    use crate::document::Document;
    use crate::wire::signing::Unsigned;
    use std::path::Path;

    fn read(folder: &Path, rest: &str) -> Result<Config, String> {
        let source = format!("[[link]]\nurl = 'udpin:0.0.0.0:14550'\n{rest}");
        let read = Config::read(&Document::new("c.toml", source.as_str()), folder);
        read.map(|(config, _)| config).map_err(|issues| issues.to_string())
    }

    #[cfg(unix)]
    #[test]
    fn a_key_is_read_from_a_file_of_its_owner_alone() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("link.key");
        std::fs::write(&file, "passphrase: correct horse\n").unwrap();
        let mode = |mode| std::fs::set_permissions(&file, PermissionsExt::from_mode(mode)).unwrap();
        mode(0o640);
        let refused = read(folder.path(), "signing = { key_file = 'link.key' }").unwrap_err();
        assert!(refused.contains("may be read by others") && refused.contains("chmod 600"), "{refused}");
        mode(0o600);
        let config = read(folder.path(), "signing = { key_file = 'link.key', unsigned = 'accept' }").unwrap();
        let signing = config.links[0].signing.as_ref().unwrap();
        assert_eq!((signing.unsigned, signing.link_id), (Unsigned::Accept, 0));
        assert!(signing.times.ends_with("link.key.times"));
        std::fs::write(&file, "no key").unwrap();
        assert!(read(folder.path(), "signing = { key_file = 'link.key' }").unwrap_err().contains("is no key"));
    }

    #[test]
    fn what_is_missing_is_told() {
        let here = Path::new(".");
        assert!(read(here, "signing.unsigned = 'refuse'").unwrap_err().contains("has no key"));
        assert!(read(here, "signing.key_file = 'no/such.key'").unwrap_err().contains("cannot be read"));
        assert!(read(here, "").unwrap().links[0].signing.is_none());
    }
}
