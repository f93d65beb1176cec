/// A battery whose voltage sags under the rotors' power and falls as it empties.
///
/// Open-circuit voltage falls linearly from `full_v` to `empty_v`; the terminals settle to it less the resistive drop
/// within `settle_s`, which also keeps thrust and current from depending on each other at the same instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Battery {
    pub full_v: f64,
    pub empty_v: f64,
    pub capacity_ah: f64,
    pub resistance_ohm: f64,
    /// Current in hover, A; it grows with Σ T^1.5, the ideal power of a rotor.
    pub hover_current_a: f64,
    pub settle_s: f64,
}

impl Battery {
    /// A pack that matches a vehicle flown at `full_v`: about twenty minutes of hover, and a drop of 1.5 % in hover.
    pub fn typical(full_v: f64, hover_current_a: f64) -> Self {
        Self {
            full_v,
            empty_v: 0.83 * full_v,
            capacity_ah: hover_current_a / 3.0,
            resistance_ohm: 0.015 * full_v / hover_current_a.max(1e-3),
            hover_current_a,
            settle_s: 0.05,
        }
    }

    /// Rates of the terminal voltage (V/s) and of the charge used (A s per s), given the rotors' load as a multiple
    /// of that in hover.
    pub(super) fn rates(&self, voltage_v: f64, used_as: f64, load: f64) -> (f64, f64) {
        let current = self.current_a(load);
        ((self.open_v(used_as) - self.resistance_ohm * current - voltage_v) / self.settle_s, current)
    }

    pub(super) fn current_a(&self, load: f64) -> f64 {
        self.hover_current_a * load
    }

    fn open_v(&self, used_as: f64) -> f64 {
        let used = (used_as / (3600.0 * self.capacity_ah)).clamp(0.0, 1.0);
        self.full_v - (self.full_v - self.empty_v) * used
    }

    /// Share of the charge that is left.
    pub fn remaining(&self, used_as: f64) -> f64 {
        (1.0 - used_as / (3600.0 * self.capacity_ah)).clamp(0.0, 1.0)
    }
}
