use crate::faults::FaultSettings;
use crate::observers::{Dial, OptionValue, REGISTRY, Registration};
use crate::outputs::{OutputSettings, Rate, Rates};
use crate::pipeline::{ObserverSetting, Tuning};
use crate::wire::dialect::ardupilotmega::MavParamType;
use std::sync::LazyLock;

/// What our parameters stand for: what leaves on a link, and how the observers run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StationSettings {
    pub outputs: OutputSettings,
    pub tuning: Tuning,
}

/// One of our parameters, as a ground station sees it.
pub struct Parameter {
    /// At most 16 characters.
    pub name: String,
    pub meaning: String,
    pub kind: MavParamType,
    /// The largest value; the smallest is 0.
    pub most: f64,
    of: Of,
}

/// What a parameter changes.
enum Of {
    Heartbeat,
    Text,
    Rate(fn(&mut Rates) -> &mut Rate),
    Observer(&'static Registration),
    Dial(&'static Registration, &'static Dial),
    FalseAlarms,
}

impl Parameter {
    fn new(name: impl Into<String>, meaning: impl Into<String>, most: f64, of: Of) -> Self {
        let kind = match of {
            Of::Text | Of::Observer(_) => MavParamType::MAV_PARAM_TYPE_UINT8,
            _ => MavParamType::MAV_PARAM_TYPE_REAL32,
        };
        Self { name: name.into(), meaning: meaning.into(), kind, most, of }
    }

    pub fn get(&self, settings: &StationSettings) -> f64 {
        let StationSettings { outputs, tuning } = settings;
        match self.of {
            Of::Heartbeat => outputs.heartbeat.as_hz().min(self.most),
            Of::Text => f64::from(u8::from(outputs.status_text)),
            Of::Rate(of) => {
                let mut rates = outputs.rates;
                of(&mut rates).as_hz().min(self.most)
            }
            Of::Observer(r) => f64::from(u8::from(tuning.observers.iter().any(|o| o.name == r.name && !o.paused))),
            Of::Dial(r, dial) => {
                let setting = tuning.observers.iter().find(|o| o.name == r.name);
                match setting.and_then(|o| o.options.get(dial.option)) {
                    Some(OptionValue::Number(value)) => *value,
                    _ => 0.0,
                }
            }
            Of::FalseAlarms => tuning.faults.false_alarms_per_hour,
        }
    }

    /// Takes a value into the range, and the settings; the value that was taken. What is no number changes nothing.
    pub fn set(&self, settings: &mut StationSettings, value: f64) -> f64 {
        if value.is_finite() {
            self.take(settings, value.clamp(0.0, self.most));
        }
        self.get(settings)
    }

    fn take(&self, StationSettings { outputs, tuning }: &mut StationSettings, value: f64) {
        match self.of {
            Of::Heartbeat => outputs.heartbeat = Rate::hz(value),
            Of::Text => outputs.status_text = value >= 0.5,
            Of::Rate(of) => *of(&mut outputs.rates) = Rate::hz(value),
            Of::Observer(r) => {
                let paused = value < 0.5;
                match tuning.observers.iter_mut().find(|o| o.name == r.name) {
                    Some(known) => known.paused = paused,
                    None if paused => {}
                    None => tuning.observers.push(ObserverSetting::named(r.name)),
                }
            }
            Of::Dial(r, dial) => {
                // an observer that was never named has no options to turn
                let Some(observer) = tuning.observers.iter_mut().find(|o| o.name == r.name) else { return };
                if value > 0.0 {
                    observer.options.insert(dial.option, OptionValue::Number(value.clamp(dial.least, dial.most)));
                } else {
                    observer.options.remove(dial.option);
                }
            }
            Of::FalseAlarms => {
                let [least, most] = FaultSettings::RATES;
                tuning.faults.false_alarms_per_hour = value.clamp(least, most);
            }
        }
    }
}

/// Faster than any measurement comes: more is the same.
const MOST_HZ: f64 = 400.0;

static ALL: LazyLock<Vec<Parameter>> = LazyLock::new(|| {
    let rate = |name: &str, of, meaning: &str| Parameter::new(name, meaning, MOST_HZ, Of::Rate(of));
    let mut all = vec![
        Parameter::new("OUT_HEARTBEAT_HZ", "our heartbeat", 50.0, Of::Heartbeat),
        Parameter::new("OUT_TEXT", "1: status texts at start and on changes", 1.0, Of::Text),
        rate("OUT_VECT_HZ", |r| &mut r.debug_vect, "DEBUG_VECT WR_F and WR_T"),
        rate("OUT_ARRAY_HZ", |r| &mut r.wrench_array, "DEBUG_FLOAT_ARRAY 1"),
        rate("OUT_BOUNDS_HZ", |r| &mut r.bound_arrays, "DEBUG_FLOAT_ARRAY 2 and 3"),
        rate("OUT_NAMED_HZ", |r| &mut r.named_values, "NAMED_VALUE_FLOAT, one name at a time"),
        rate("OUT_WINDCOV_HZ", |r| &mut r.wind_cov, "WIND_COV"),
        rate("OUT_WRENCH_HZ", |r| &mut r.wrench_estimate, "WRENCH_ESTIMATE"),
        rate("OUT_WIND_HZ", |r| &mut r.wind_estimate, "WIND_ESTIMATE"),
        rate("OUT_STATE_HZ", |r| &mut r.state_bounds, "STATE_BOUNDS"),
        rate("OUT_FAULT_HZ", |r| &mut r.fault_status, "FAULT_STATUS, beside every change"),
        rate("OUT_OBSERVER_HZ", |r| &mut r.observer_status, "OBSERVER_STATUS"),
        rate("OUT_WINDAP_HZ", |r| &mut r.wind, "WIND, as ArduPilot sends it"),
    ];
    for r in REGISTRY {
        let runs = format!("1: {} runs", r.name);
        all.push(Parameter::new(format!("{}_EN", r.prefix), runs, 1.0, Of::Observer(r)));
        for dial in r.dials {
            let name = format!("{}_{}", r.prefix, dial.suffix);
            let meaning = format!("{}; 0: as configured", dial.meaning);
            all.push(Parameter::new(name, meaning, dial.most, Of::Dial(r, dial)));
        }
    }
    let most = FaultSettings::RATES[1];
    all.push(Parameter::new("FLT_ALARMS_HOUR", "bearable false alarms per hour of flight", most, Of::FalseAlarms));
    all
});

/// Every parameter, in the order of their indices.
pub fn all() -> &'static [Parameter] {
    &ALL
}

/// The parameter of a name, with its index.
pub fn find(name: &str) -> Option<(usize, &'static Parameter)> {
    ALL.iter().enumerate().find(|(_, p)| p.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_and_differ() {
        let mut names: Vec<_> = ALL.iter().map(|p| p.name.as_str()).collect();
        assert!(names.iter().all(|n| n.len() <= 16 && n.is_ascii()));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), ALL.len());
    }

    #[test]
    fn values_are_clamped_and_nonsense_changes_nothing() {
        let mut settings = StationSettings::default();
        let (_, rate) = find("OUT_WIND_HZ").unwrap();
        assert_eq!(rate.set(&mut settings, 25.0), 25.0);
        assert_eq!(rate.set(&mut settings, f64::NAN), 25.0);
        assert_eq!(rate.set(&mut settings, -3.0), 0.0);
        assert_eq!(rate.set(&mut settings, 1e9), MOST_HZ);
        assert_eq!(find("OUT_TEXT").unwrap().1.set(&mut settings, 0.4), 0.0);
        assert!(find("OUT_wind_HZ").is_none());
    }

    #[test]
    fn an_observer_is_paused_and_its_options_are_turned() {
        let mut settings = StationSettings::default();
        let set = |settings: &mut StationSettings, name: &str, value| find(name).unwrap().1.set(settings, value);
        assert_eq!(set(&mut settings, "QB_ALPHA_F", 2.0), 0.0, "nothing to turn before it runs");
        assert_eq!(set(&mut settings, "QB_EN", 1.0), 1.0);
        assert_eq!(set(&mut settings, "QB_ALPHA_F", 2.0), 2.0);
        assert_eq!(set(&mut settings, "QB_ALPHA_F", 1e-9), 0.5, "the least there is");
        assert_eq!(set(&mut settings, "QB_EN", 0.0), 0.0);
        assert_eq!(set(&mut settings, "QB_EN", 1.0), 1.0);
        let options = &settings.tuning.observers[0].options;
        assert_eq!(options.get("alpha_force"), Some(&OptionValue::Number(0.5)), "options outlive a pause");
        assert_eq!(set(&mut settings, "QB_ALPHA_F", 0.0), 0.0);
        assert_eq!(settings.tuning.observers, [ObserverSetting::named("quadratic_bounded")]);
        assert_eq!(set(&mut settings, "FLT_ALARMS_HOUR", 0.0), FaultSettings::RATES[0]);
    }
}
