use serde::Serialize;

/// What an experiment found.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Findings {
    pub figures: Vec<Figure>,
    pub traces: Vec<Trace>,
    /// What a reader must know to read the figures right.
    pub remarks: Vec<String>,
}

/// One number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    pub what: String,
    pub value: f64,
    pub unit: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<Limit>,
}

/// What a figure must keep to.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Limit {
    AtMost(f64),
    AtLeast(f64),
}

/// Lines over time, to be drawn into one picture.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Trace {
    pub title: String,
    pub unit: &'static str,
    pub t_s: Vec<f64>,
    /// Name and values, as many as there are times; NaN where there is none.
    pub lines: Vec<(String, Vec<f64>)>,
}

impl Findings {
    /// A number without a limit.
    pub fn tell(&mut self, what: impl Into<String>, value: f64, unit: &'static str) {
        self.figures.push(Figure { what: what.into(), value, unit, limit: None });
    }

    /// A number that must keep a limit.
    pub fn judge(&mut self, what: impl Into<String>, value: f64, unit: &'static str, limit: Limit) {
        self.figures.push(Figure { what: what.into(), value, unit, limit: Some(limit) });
    }

    /// The figures that miss their limit.
    pub fn missed(&self) -> impl Iterator<Item = &Figure> {
        self.figures.iter().filter(|f| !f.met())
    }
}

impl Figure {
    /// True without a limit. NaN keeps none.
    pub fn met(&self) -> bool {
        match self.limit {
            None => true,
            Some(Limit::AtMost(most)) => self.value <= most,
            Some(Limit::AtLeast(least)) => self.value >= least,
        }
    }
}

impl Trace {
    pub fn new(title: impl Into<String>, unit: &'static str, lines: &[&str]) -> Self {
        let lines = lines.iter().map(|name| ((*name).to_owned(), Vec::new())).collect();
        Self { title: title.into(), unit, t_s: Vec::new(), lines }
    }

    /// One instant: a value for each line.
    pub fn push(&mut self, t_s: f64, values: &[f64]) {
        self.t_s.push(t_s);
        for (k, (_, line)) in self.lines.iter_mut().enumerate() {
            line.push(values.get(k).copied().unwrap_or(f64::NAN));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_kept_or_not() {
        let mut f = Findings::default();
        f.tell("free", f64::NAN, "m");
        f.judge("low", 1.0, "m", Limit::AtMost(1.0));
        f.judge("high", 1.0, "m", Limit::AtLeast(2.0));
        f.judge("unknown", f64::NAN, "m", Limit::AtMost(2.0));
        assert_eq!(f.missed().map(|f| f.what.as_str()).collect::<Vec<_>>(), ["high", "unknown"]);
    }
}
