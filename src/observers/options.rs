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

    pub fn get(&self, key: &str) -> Option<&OptionValue> {
        self.0.get(key)
    }

    pub fn remove(&mut self, key: &str) {
        self.0.remove(key);
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

    /// Takes out a yes or no.
    pub fn flag(&mut self, key: &'static str) -> Result<Option<bool>, OptionError> {
        match self.0.remove(key) {
            None => Ok(None),
            Some(OptionValue::Bool(x)) => Ok(Some(x)),
            Some(_) => Err(OptionError::Type { key, wanted: "true or false" }),
        }
    }

    /// Takes out one of these words, and gives what stands beside it.
    pub fn choice<T: Copy>(
        &mut self,
        key: &'static str,
        words: &[(&'static str, T)],
    ) -> Result<Option<T>, OptionError> {
        let known = || words.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(", ");
        match self.0.remove(key) {
            None => Ok(None),
            Some(OptionValue::Text(text)) => match words.iter().find(|(word, _)| *word == text) {
                Some((_, value)) => Ok(Some(*value)),
                None => Err(OptionError::Word { key, text, known: known() }),
            },
            Some(_) => Err(OptionError::Word { key, text: "no text".to_owned(), known: known() }),
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
    #[error("`{key}` is {text}; it must be one of: {known}")]
    Word { key: &'static str, text: String, known: String },
}
