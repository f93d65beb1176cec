use super::Stamp;

/// Name, unit and frame of one scalar that an observer estimates. Schemas, plots and messages are made from these.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signal {
    pub name: &'static str,
    pub unit: &'static str,
    pub frame: &'static str,
}

/// How much a bound may be trusted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Guarantee {
    /// Holds whenever the declared assumptions hold.
    Guaranteed,
    /// Holds with this probability (0..1).
    Statistical(f64),
    /// No bound is given.
    None,
}

/// What an observer thinks of its own answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Assumptions hold as far as the data can tell; bounds have settled.
    Consistent,
    /// The bound was (re)opened from the declared envelope and is still shrinking.
    Settling,
    /// The data contradict the declared noise and rate bounds right now.
    AssumptionViolated,
    /// A needed channel is missing or too old: the answer is a prediction and its bound grows.
    Starved,
    /// The vehicle is disarmed or on the ground: contact forces act and nothing is claimed.
    Grounded,
}

/// One answer of an observer: a value and a half-width for each of its signals.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    pub stamp: Stamp,
    /// One value for each signal, in the signal's unit.
    pub values: Vec<f64>,
    /// The true value lies within `values[i] ± half_widths[i]`; infinite where nothing is claimed.
    pub half_widths: Vec<f64>,
    pub guarantee: Guarantee,
    /// Largest output residual over its admissible size: above 1 the data contradict the assumptions.
    pub residual: f64,
    pub verdict: Verdict,
}

impl Estimate {
    /// An estimate of `n` signals that claims nothing yet.
    pub fn unknown(n: usize) -> Self {
        Self {
            stamp: Stamp::default(),
            values: vec![0.0; n],
            half_widths: vec![f64::INFINITY; n],
            guarantee: Guarantee::None,
            residual: 0.0,
            verdict: Verdict::Starved,
        }
    }
}

/// One check of the data against what is admissible: an output against its prediction, or two sources against each
/// other. It is kept as data; whether it means a fault is decided elsewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// What is compared, such as a signal's name.
    pub name: &'static str,
    /// Measured less expected.
    pub value: f64,
    /// Largest size of `value` at which the two can still agree.
    pub admissible: f64,
    /// `Guaranteed`: beyond it no admissible noise explains the data. `Statistical(p)`: with nothing wrong it stays
    /// within it with probability p.
    pub guarantee: Guarantee,
}

impl Residual {
    /// Size over admissible size: above 1 the sources disagree.
    pub fn ratio(&self) -> f64 {
        self.value.abs() / self.admissible
    }
}
