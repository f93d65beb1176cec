use crate::outputs::{OutputSettings, Rate};
use crate::wire::dialect::ardupilotmega::MavParamType;

/// One of our parameters, as a ground station sees it.
pub struct Parameter {
    /// At most 16 characters.
    pub name: &'static str,
    pub meaning: &'static str,
    pub kind: MavParamType,
    /// The largest value; the smallest is 0.
    pub most: f64,
    get: fn(&OutputSettings) -> f64,
    set: fn(&mut OutputSettings, f64),
}

impl Parameter {
    pub fn get(&self, settings: &OutputSettings) -> f64 {
        (self.get)(settings)
    }

    /// Takes a value into the range, and the settings; the value that was taken. What is no number changes nothing.
    pub fn set(&self, settings: &mut OutputSettings, value: f64) -> f64 {
        if value.is_finite() {
            let value = value.clamp(0.0, self.most);
            let whole = self.kind != MavParamType::MAV_PARAM_TYPE_REAL32;
            (self.set)(settings, if whole { value.round() } else { value });
        }
        self.get(settings)
    }
}

/// Faster than any measurement comes: more is the same.
const MOST_HZ: f64 = 400.0;

macro_rules! rate {
    ($name:literal, $field:ident, $meaning:literal) => {
        Parameter {
            name: $name,
            meaning: $meaning,
            kind: MavParamType::MAV_PARAM_TYPE_REAL32,
            most: MOST_HZ,
            get: |s| s.rates.$field.as_hz().min(MOST_HZ),
            set: |s, hz| s.rates.$field = Rate::hz(hz),
        }
    };
}

const ALL: [Parameter; 13] = [
    Parameter {
        name: "OUT_HEARTBEAT_HZ",
        meaning: "our heartbeat",
        kind: MavParamType::MAV_PARAM_TYPE_REAL32,
        most: 50.0,
        get: |s| s.heartbeat.as_hz().min(50.0),
        set: |s, hz| s.heartbeat = Rate::hz(hz),
    },
    Parameter {
        name: "OUT_TEXT",
        meaning: "1: status texts at start and on changes",
        kind: MavParamType::MAV_PARAM_TYPE_UINT8,
        most: 1.0,
        get: |s| f64::from(u8::from(s.status_text)),
        set: |s, on| s.status_text = on > 0.5,
    },
    rate!("OUT_VECT_HZ", debug_vect, "DEBUG_VECT WR_F and WR_T"),
    rate!("OUT_ARRAY_HZ", wrench_array, "DEBUG_FLOAT_ARRAY 1"),
    rate!("OUT_BOUNDS_HZ", bound_arrays, "DEBUG_FLOAT_ARRAY 2 and 3"),
    rate!("OUT_NAMED_HZ", named_values, "NAMED_VALUE_FLOAT, one name at a time"),
    rate!("OUT_WINDCOV_HZ", wind_cov, "WIND_COV"),
    rate!("OUT_WRENCH_HZ", wrench_estimate, "WRENCH_ESTIMATE"),
    rate!("OUT_WIND_HZ", wind_estimate, "WIND_ESTIMATE"),
    rate!("OUT_STATE_HZ", state_bounds, "STATE_BOUNDS"),
    rate!("OUT_FAULT_HZ", fault_status, "FAULT_STATUS, beside every change"),
    rate!("OUT_OBSERVER_HZ", observer_status, "OBSERVER_STATUS"),
    rate!("OUT_WINDAP_HZ", wind, "WIND, as ArduPilot sends it"),
];

/// Every parameter, in the order of their indices.
pub fn all() -> &'static [Parameter] {
    &ALL
}

/// The parameter of a name, with its index.
pub fn find(name: &str) -> Option<(usize, &'static Parameter)> {
    ALL.iter().enumerate().find(|(_, p)| p.name == name)
}

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
            values.push((parameter.name, value));
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_and_differ() {
        let mut names: Vec<_> = ALL.iter().map(|p| p.name).collect();
        assert!(names.iter().all(|n| n.len() <= 16 && n.is_ascii()));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), ALL.len());
    }

    #[test]
    fn values_are_clamped_and_nonsense_changes_nothing() {
        let mut settings = OutputSettings::default();
        let (_, rate) = find("OUT_WIND_HZ").unwrap();
        assert_eq!(rate.set(&mut settings, 25.0), 25.0);
        assert_eq!(rate.set(&mut settings, f64::NAN), 25.0);
        assert_eq!(rate.set(&mut settings, -3.0), 0.0);
        assert_eq!(rate.set(&mut settings, 1e9), MOST_HZ);
        assert_eq!(find("OUT_TEXT").unwrap().1.set(&mut settings, 0.4), 0.0);
        assert!(find("OUT_wind_HZ").is_none());
    }

    #[test]
    fn a_file_brings_back_what_was_set() {
        let set = [("OUT_NAMED_HZ", 2.5), ("OUT_TEXT", 0.0)];
        assert_eq!(ParameterFile::values(&ParameterFile::write(&set)).unwrap(), set);
        let told = |text: &str| ParameterFile::values(text).unwrap_err().to_string();
        assert_eq!(told("# fine\nOUT_WIND_HZ\n"), "line 2: `OUT_WIND_HZ` is no `NAME VALUE`");
        assert_eq!(told("OUT_WIN_HZ 3"), "line 1: there is no parameter `OUT_WIN_HZ`");
    }
}
