/// How the detectors judge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultSettings {
    /// Bearable false alarms of all residuals together that are held against chance, per hour of flight: fewer make the
    /// detectors slower.
    pub false_alarms_per_hour: f64,
}

impl FaultSettings {
    /// Least and greatest rate that makes sense.
    pub const RATES: [f64; 2] = [1e-6, 10.0];

    /// The share of one of the residuals that are held against chance: gyroscopes, accelerometers, field, GNSS drift.
    pub(super) fn each_per_hour(self) -> f64 {
        self.false_alarms_per_hour.clamp(Self::RATES[0], Self::RATES[1]) / 4.0
    }
}

impl Default for FaultSettings {
    /// One in ten days of flight.
    fn default() -> Self {
        Self { false_alarms_per_hour: 0.004 }
    }
}
