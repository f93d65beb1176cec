/// What is recorded, and how it is kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    pub mcap: bool,
    pub tlog: bool,
    /// A part that is larger, all its files together, is closed and the next begun.
    pub rotate_bytes: Option<u64>,
    /// A part that is older is closed and the next begun, µs.
    pub rotate_us: Option<u64>,
    /// Records only while a vehicle is armed.
    pub only_armed: bool,
    /// An armed vehicle that is silent for longer counts as disarmed, µs.
    pub armed_silence_us: u64,
    /// The oldest recordings are removed when all together are larger.
    pub budget_bytes: Option<u64>,
    /// A killed process loses no more than this, µs.
    pub flush_every_us: u64,
    /// Brings every flush to the disk itself, so that a lost supply loses no more than a killed process.
    pub sync: bool,
}

impl Default for Policy {
    fn default() -> Self {
        Self {
            mcap: true,
            tlog: true,
            rotate_bytes: Some(1 << 30),
            rotate_us: None,
            only_armed: false,
            armed_silence_us: 30_000_000,
            budget_bytes: None,
            flush_every_us: 500_000,
            sync: false,
        }
    }
}
