/// How often a message may leave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    hz: f64,
}

impl Rate {
    /// Never.
    pub const OFF: Self = Self { hz: 0.0 };
    /// With every snapshot.
    pub const EVERY: Self = Self { hz: f64::INFINITY };

    /// At most `hz` times a second; zero, negative and NaN mean never.
    pub const fn hz(hz: f64) -> Self {
        Self { hz: if hz > 0.0 { hz } else { 0.0 } }
    }

    /// Messages a second: 0 for never, infinite for every one.
    pub fn as_hz(self) -> f64 {
        self.hz
    }

    /// Time between two messages, µs; `None` if none is ever sent.
    pub(super) fn period_us(self) -> Option<u64> {
        // saturates: the slowest rates give a period of 580 000 years
        (self.hz > 0.0).then(|| (1e6 / self.hz).round() as u64)
    }
}

/// One rate for each message that leaves, on one link and for one vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// DEBUG_VECT `WR_F` and `WR_T`.
    pub debug_vect: Rate,
    /// DEBUG_FLOAT_ARRAY 1.
    pub wrench_array: Rate,
    /// DEBUG_FLOAT_ARRAY 2 and 3.
    pub bound_arrays: Rate,
    /// All NAMED_VALUE_FLOAT together: one name at a time.
    pub named_values: Rate,
    /// WIND_COV. QGroundControl shows it from any component and would alternate with the autopilot's own, so it is off
    /// unless asked for.
    pub wind_cov: Rate,
    /// ArduPilot's own WIND, which its ground stations draw: off unless asked for, for the same reason.
    pub wind: Rate,
    pub wrench_estimate: Rate,
    pub wind_estimate: Rate,
    pub state_bounds: Rate,
    /// In addition to every change.
    pub fault_status: Rate,
    pub observer_status: Rate,
}

impl Rates {
    /// Nothing leaves.
    pub const OFF: Self = Self {
        debug_vect: Rate::OFF,
        wrench_array: Rate::OFF,
        bound_arrays: Rate::OFF,
        named_values: Rate::OFF,
        wind_cov: Rate::OFF,
        wind: Rate::OFF,
        wrench_estimate: Rate::OFF,
        wind_estimate: Rate::OFF,
        state_bounds: Rate::OFF,
        fault_status: Rate::OFF,
        observer_status: Rate::OFF,
    };
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            debug_vect: Rate::hz(10.0),
            wrench_array: Rate::hz(5.0),
            bound_arrays: Rate::hz(2.0),
            named_values: Rate::hz(10.0),
            wind_cov: Rate::OFF,
            wind: Rate::OFF,
            wrench_estimate: Rate::hz(10.0),
            wind_estimate: Rate::hz(10.0),
            state_bounds: Rate::hz(2.0),
            fault_status: Rate::hz(1.0),
            observer_status: Rate::hz(1.0),
        }
    }
}

/// What leaves on one link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutputSettings {
    /// Component id that our messages carry, beside the vehicle's system id.
    pub component: u8,
    pub heartbeat: Rate,
    /// STATUSTEXT at start and on state changes.
    pub status_text: bool,
    pub rates: Rates,
}

impl OutputSettings {
    /// MAV_COMP_ID_ONBOARD_COMPUTER.
    pub const COMPONENT: u8 = 191;
}

impl Default for OutputSettings {
    fn default() -> Self {
        Self { component: Self::COMPONENT, heartbeat: Rate::hz(1.0), status_text: true, rates: Rates::default() }
    }
}
