use std::collections::BTreeMap;

/// One value of an observer's config table.
#[derive(Debug, Clone, PartialEq)]
pub enum OptionValue {
    Bool(bool),
    Number(f64),
    Text(String),
}

/// The config table of one observer, without its name: what its builder reads.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options(BTreeMap<String, OptionValue>);

impl Options {
    pub fn insert(&mut self, key: impl Into<String>, value: OptionValue) {
        self.0.insert(key.into(), value);
    }

    /// Takes out a number within `[lo, hi]`.
    pub fn number(&mut self, key: &'static str, lo: f64, hi: f64) -> Result<Option<f64>, OptionError> {
        match self.0.remove(key) {
            None => Ok(None),
            Some(OptionValue::Number(x)) if (lo..=hi).contains(&x) => Ok(Some(x)),
            Some(OptionValue::Number(x)) => Err(OptionError::OutOfRange { key, value: x, lo, hi }),
            Some(_) => Err(OptionError::Type { key, wanted: "a number" }),
        }
    }

    pub(super) fn keys(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OptionError {
    #[error("`{key}` is {value}, outside {lo} to {hi}")]
    OutOfRange { key: &'static str, value: f64, lo: f64, hi: f64 },
    #[error("`{key}` must be {wanted}")]
    Type { key: &'static str, wanted: &'static str },
}
