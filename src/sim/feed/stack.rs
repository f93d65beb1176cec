/// Whose habits the simulated autopilot has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stack {
    /// ArduCopter: silent until asked, stamps of the sending instant, integers cut off, parameters cast to float.
    ArduPilot,
    /// PX4, onboard link: talks unasked, stamps on the 4 ms grid of its loop, parameters as raw bytes.
    Px4,
}

impl Stack {
    /// Physics step (s) and steps per autopilot loop: 400 Hz and 250 Hz, with about 1 ms for the physics.
    pub fn timing(self) -> (f64, u32) {
        match self {
            Self::ArduPilot => (0.001_25, 2),
            Self::Px4 => (0.001, 4),
        }
    }

    /// Own requests for the time of others, Hz.
    pub(super) fn timesync_hz(self) -> f64 {
        match self {
            Self::ArduPilot => 0.1,
            Self::Px4 => 10.0,
        }
    }

    /// How much slower streams are while parameters are sent.
    pub(super) fn slowdown_in_transfer(self) -> u64 {
        match self {
            Self::ArduPilot => 4,
            Self::Px4 => 1,
        }
    }

    /// Time between two parameters of a list, µs.
    pub(super) fn parameter_interval_us(self) -> u64 {
        match self {
            Self::ArduPilot => 5_000,
            Self::Px4 => 12_000,
        }
    }
}
