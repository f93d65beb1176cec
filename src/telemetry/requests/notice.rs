use crate::signal::Channel;
use std::fmt;

/// Why a channel does not arrive as wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The autopilot refused every message that carries it.
    Refused,
    /// No command was answered.
    Unanswered,
    /// At least one message was granted, none came.
    Silent,
    /// It was granted and comes, but too slowly: the autopilot, or the link, is at its limit.
    Slow,
}

/// What is reported, once for each change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Notice {
    Unmet {
        channel: Channel,
        wanted_hz: f64,
        measured_hz: f64,
        cause: Cause,
    },
    Met {
        channel: Channel,
        measured_hz: f64,
    },
    /// The link carries less than was asked for: the fastest messages are wanted at one rate and now asked for at another.
    Slowed {
        wanted_hz: f64,
        asked_hz: f64,
    },
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Slowed { wanted_hz, asked_hz } => write!(
                f,
                "the link is full: what is wanted at {wanted_hz:.0} Hz is asked for at {asked_hz:.1} Hz, which it carries"
            ),
            Self::Met { channel, measured_hz } => write!(f, "{channel} arrives at {measured_hz:.1} Hz"),
            Self::Unmet { channel, wanted_hz, measured_hz, cause } => {
                write!(f, "{channel} arrives at {measured_hz:.1} Hz, {wanted_hz:.0} Hz are wanted: ")?;
                f.write_str(match cause {
                    Cause::Refused => "the autopilot refused the request",
                    Cause::Unanswered => {
                        "the autopilot does not answer requests (does the link carry both directions?)"
                    }
                    Cause::Silent => "the autopilot granted the request but sends nothing",
                    Cause::Slow => "the autopilot or the link gives no more",
                })
            }
        }
    }
}
