use super::options::Shared;
use crate::cli::{Failure, print};
use serde_json::{Map, Value};

/// What designing one observer for one plant gave.
#[derive(Debug, Default)]
pub struct Sheet {
    pub observer: &'static str,
    pub plant: String,
    /// What belongs to all rows: the plant's matrices, weights, ends of a trade-off.
    pub more: Map<String, Value>,
    /// One object per design, with `gain` or `gains`, A, B, C, L, P as far as they exist, `verified`, `margin`, `solve_s`.
    pub rows: Vec<Value>,
    /// The designs that a criterion chose, in the form of rows.
    pub selected: Vec<Value>,
    /// The same for a reader, without a newline at the end.
    pub text: String,
}

impl Sheet {
    /// {observer, plant, …, rows, selected}.
    pub fn json(&self) -> Value {
        let mut object = self.more.clone();
        object.insert("observer".into(), self.observer.into());
        object.insert("plant".into(), self.plant.clone().into());
        object.insert("rows".into(), self.rows.clone().into());
        object.insert("selected".into(), self.selected.clone().into());
        Value::Object(object)
    }

    /// Prints it as the options ask.
    pub fn deliver(&self, options: &Shared) -> Result<(), Failure> {
        print(&if options.json { format!("{:#}", self.json()) } else { self.text.trim_end().to_owned() })
    }
}
