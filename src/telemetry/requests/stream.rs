use super::SETTLE_MS;
use super::rate::RateMeter;

/// What became of the last request for a message or group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Asked {
    /// Not yet, or not since it was given up; `attempts` went without an answer.
    No {
        attempts: u32,
        not_before_ms: u64,
    },
    /// The one open command.
    Open {
        since_ms: u64,
        attempt: u32,
    },
    Granted {
        at_ms: u64,
    },
    Refused,
    Unanswered,
}

pub(super) const NOT_ASKED: Asked = Asked::No { attempts: 0, not_before_ms: 0 };

/// What is known of a message's interval before the first request of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Before {
    NotAsked,
    /// The one open command.
    Open {
        since_ms: u64,
    },
    /// The vehicle does not say; whether the message came all the same.
    Untold {
        came: bool,
    },
    /// In the words of MESSAGE_INTERVAL.
    Told {
        interval_us: i32,
    },
}

/// One message or group that may be asked for.
#[derive(Debug)]
pub(super) struct Stream {
    pub(super) request: Target,
    pub(super) asked: Asked,
    pub(super) before: Before,
    /// The rate of the last request that the vehicle may have obeyed, Hz; 0 where there is none.
    pub(super) asked_hz: f64,
    /// It is to be asked for once more, at another pace.
    pub(super) again: bool,
    pub(super) rate: RateMeter,
}

impl Stream {
    pub(super) fn new(request: Target, now_ms: u64) -> Self {
        let (asked, before, rate) = (NOT_ASKED, Before::NotAsked, RateMeter::new(now_ms));
        Self { request, asked, before, asked_hz: 0.0, again: false, rate }
    }

    /// Is it a message that was granted, as far as we know?
    pub(super) fn runs(&self) -> bool {
        matches!((self.request, self.asked), (Target::Message(_), Asked::Granted { .. } | Asked::Unanswered))
    }

    /// Was it asked for so lately that its rate says nothing yet?
    pub(super) fn unsettled(&self, now_ms: u64) -> bool {
        match self.asked {
            Asked::Open { .. } => true,
            Asked::Granted { at_ms } => self.again || now_ms.saturating_sub(at_ms) < SETTLE_MS,
            _ => matches!(self.before, Before::Open { .. }),
        }
    }

    /// The vehicle does not say at which interval it sends this.
    pub(super) fn untold(&mut self, now_ms: u64) {
        if let Before::Open { .. } = self.before {
            self.before = Before::Untold { came: self.rate.hz(now_ms) > 0.0 };
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Target {
    Message(u32),
    Group(u8),
}
