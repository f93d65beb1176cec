use crate::signal::Channel;

/// HEARTBEAT's `autopilot` field, as far as it changes what is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Autopilot {
    ArduPilot,
    Px4,
    Other,
}

impl Autopilot {
    /// From the value of MAV_AUTOPILOT; `None` for MAV_AUTOPILOT_INVALID, which is no autopilot.
    pub fn from_mav(autopilot: u8) -> Option<Self> {
        match autopilot {
            3 => Some(Self::ArduPilot),
            8 => None,
            12 => Some(Self::Px4),
            _ => Some(Self::Other),
        }
    }
}

/// One thing to ask a vehicle for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Request {
    /// COMMAND_LONG with MAV_CMD_GET_MESSAGE_INTERVAL (510): param1 the message.
    TellInterval { message_id: u32 },
    /// COMMAND_LONG with MAV_CMD_SET_MESSAGE_INTERVAL (511): param1 the message, param2 the interval in µs.
    MessageInterval { message_id: u32, interval_us: f32 },
    /// REQUEST_DATA_STREAM (66): a MAV_DATA_STREAM at a rate in Hz.
    DataStream { stream_id: u8, rate_hz: u16 },
}

/// A channel and the rate at which the observers want it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Need {
    pub channel: Channel,
    pub rate_hz: f64,
    /// The estimates are better with it and can be had without: its absence is not reported.
    pub optional: bool,
}

impl Need {
    /// Usual rate of the channels that move an observer's state.
    pub const FAST_HZ: f64 = 50.0;

    /// The rate that serves the observers without filling a telemetry radio.
    pub fn at_default_rate(channel: Channel) -> Self {
        let rate_hz = match channel {
            Channel::Imu | Channel::Attitude | Channel::Velocity | Channel::Actuators => Self::FAST_HZ,
            Channel::Magnetometer | Channel::Rpm => 10.0,
            Channel::Gnss | Channel::Pressure => 5.0,
            Channel::Battery => 1.0,
        };
        Self { channel, rate_hz, optional: false }
    }

    /// The same channel, welcome but not needed.
    pub fn optional(self) -> Self {
        Self { optional: true, ..self }
    }
}
