use super::parameters::find;

/// What is wrong with the text of a parameter file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ParameterFileError {
    #[error("line {line}: `{text}` is no `NAME VALUE`")]
    Line { line: usize, text: String },
    #[error("line {line}: there is no parameter `{name}`")]
    Name { line: usize, name: String },
}

/// Parameters as text, a `NAME VALUE` a line: what was set by a ground station outlives a restart.
pub struct ParameterFile;

impl ParameterFile {
    pub fn write(values: &[(&str, f64)]) -> String {
        let lines: String = values.iter().map(|(name, value)| format!("{name} {value}\n")).collect();
        format!("# Set over MAVLink; written by mavobserver.\n{lines}")
    }

    /// The values of a file.
    ///
    /// # Errors
    /// The first line that is not understood.
    pub fn values(text: &str) -> Result<Vec<(&'static str, f64)>, ParameterFileError> {
        let mut values = Vec::new();
        for (i, text) in text.lines().enumerate() {
            let (line, text) = (i + 1, text.trim());
            if text.is_empty() || text.starts_with('#') {
                continue;
            }
            let pair = text.split_once(char::is_whitespace);
            let parsed = pair.and_then(|(name, value)| Some((name, value.trim().parse::<f64>().ok()?)));
            let Some((name, value)) = parsed else {
                return Err(ParameterFileError::Line { line, text: text.to_owned() });
            };
            let Some((_, parameter)) = find(name) else {
                return Err(ParameterFileError::Name { line, name: name.to_owned() });
            };
            values.push((parameter.name.as_str(), value));
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_brings_back_what_was_set() {
        let set = [("OUT_NAMED_HZ", 2.5), ("OUT_TEXT", 0.0)];
        assert_eq!(ParameterFile::values(&ParameterFile::write(&set)).unwrap(), set);
        let told = |text: &str| ParameterFile::values(text).unwrap_err().to_string();
        assert_eq!(told("# fine\nOUT_WIND_HZ\n"), "line 2: `OUT_WIND_HZ` is no `NAME VALUE`");
        assert_eq!(told("OUT_WIN_HZ 3"), "line 1: there is no parameter `OUT_WIN_HZ`");
    }
}
