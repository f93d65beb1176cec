use sha2::{Digest, Sha256};
use std::fmt;

/// A secret of 32 bytes that both ends of a link share. Its `Debug` does not show it.
#[derive(Clone, PartialEq, Eq)]
pub struct Key([u8; 32]);

/// What is wrong with the text of a key file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum KeyError {
    #[error("the key file is empty; it holds 64 hexadecimal digits, or `passphrase: …`")]
    Empty,
    #[error("the key file holds {0} characters that are no key; write 64 hexadecimal digits, or `passphrase: …`")]
    NotHex(usize),
    #[error("the passphrase has fewer than 8 characters")]
    Short,
}

impl Key {
    pub fn new(secret: [u8; 32]) -> Self {
        Self(secret)
    }

    /// The key that ground stations make of a passphrase: its SHA-256.
    pub fn from_passphrase(passphrase: &str) -> Self {
        Self(Sha256::digest(passphrase.as_bytes()).into())
    }

    /// The text of a key file: 64 hexadecimal digits, or `passphrase: …`; lines that begin with `#` are comments.
    ///
    /// # Errors
    /// [`KeyError`] for anything else.
    pub fn parse(text: &str) -> Result<Self, KeyError> {
        let line = text.lines().map(str::trim).find(|l| !l.is_empty() && !l.starts_with('#')).ok_or(KeyError::Empty)?;
        if let Some(phrase) = line.strip_prefix("passphrase:") {
            let phrase = phrase.trim();
            return if phrase.chars().count() < 8 { Err(KeyError::Short) } else { Ok(Self::from_passphrase(phrase)) };
        }
        let not_hex = || KeyError::NotHex(line.chars().count());
        let digits: Vec<u8> = line
            .chars()
            .map(|c| c.to_digit(16).and_then(|d| u8::try_from(d).ok()))
            .collect::<Option<_>>()
            .ok_or_else(not_hex)?;
        if digits.len() != 64 {
            return Err(not_hex());
        }
        let bytes: Vec<u8> =
            digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit)).collect();
        bytes.try_into().map(Self).map_err(|_| not_hex())
    }

    /// The first 48 bits of SHA-256(key ‖ frame ‖ link id ‖ time).
    pub(super) fn digest(&self, frame: &[u8], link_id: u8, time: [u8; 6]) -> [u8; 6] {
        let mut hash = Sha256::new();
        hash.update(self.0);
        hash.update(frame);
        hash.update([link_id]);
        hash.update(time);
        let [a, b, c, d, e, f, ..]: [u8; 32] = hash.finalize().into();
        [a, b, c, d, e, f]
    }
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(secret)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hexadecimal_and_passphrases_are_read() {
        let hex = "000102030405060708090a0b0c0d0e0f101112131415161718191A1B1C1D1E1F";
        assert_eq!(Key::parse(&format!("# ours\n\n {hex} \n")), Ok(Key::new(std::array::from_fn(|i| i as u8))));
        assert_eq!(Key::parse("passphrase: correct horse"), Ok(Key::from_passphrase("correct horse")));
    }

    #[test]
    fn what_is_no_key_is_refused_without_being_repeated() {
        assert_eq!(Key::parse("# nothing"), Err(KeyError::Empty));
        assert_eq!(Key::parse(&"0".repeat(63)), Err(KeyError::NotHex(63)));
        assert_eq!(Key::parse("passphrase: short"), Err(KeyError::Short));
        let message = Key::parse("my secret phrase").unwrap_err().to_string();
        assert!(!message.contains("secret phrase"), "{message}");
        assert_eq!(format!("{:?}", Key::new([1; 32])), "Key(secret)");
    }
}
