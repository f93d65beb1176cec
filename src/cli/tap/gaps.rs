use crate::observers::REGISTRY;
use crate::signal::Channel;
use crate::telemetry::requests::{Autopilot, Need, carried_by};
use crate::wire::message_info;
use crate::wire::stats::SourceStats;
use serde_json::{Value, json};

/// Below this part of the wanted rate a channel is a gap.
const ENOUGH: f64 = 0.8;

/// A channel that the observers need and that comes too seldom, or not at all.
pub(super) struct Gap {
    channel: Channel,
    wanted_hz: f64,
    /// The best message that carries it, with its rate.
    best: Option<(&'static str, f64)>,
}

/// What the observers would miss of this vehicle.
pub(super) fn gaps(autopilot: Autopilot, stats: &SourceStats, now_us: u64) -> Vec<Gap> {
    let mut channels: Vec<Channel> = REGISTRY.iter().flat_map(|r| r.needs.iter().copied()).collect();
    channels.sort_by_key(|channel| Channel::ALL.iter().position(|c| c == channel));
    channels.dedup();
    let name = |id: u32| message_info(id).map_or("?", |info| info.name);
    channels
        .into_iter()
        .filter_map(|channel| {
            let wanted_hz = Need::at_default_rate(channel).rate_hz;
            let rate = |id: u32| stats.message(id).map(|cadence| (name(id), cadence.rate_hz(now_us)));
            let best = carried_by(autopilot, channel).filter_map(rate).max_by(|a, b| a.1.total_cmp(&b.1));
            let gap = best.is_none_or(|(_, hz)| hz < ENOUGH * wanted_hz);
            gap.then_some(Gap { channel, wanted_hz, best })
        })
        .collect()
}

impl Gap {
    pub fn text(&self) -> String {
        let Self { channel, wanted_hz, best } = self;
        match best {
            Some((name, hz)) => format!("{channel}: {name} comes at {hz:.1} of {wanted_hz:.0} Hz"),
            None => format!("{channel}: missing, {wanted_hz:.0} Hz wanted"),
        }
    }

    pub fn json(&self) -> Value {
        json!({
            "channel": self.channel.to_string(), "wanted_hz": self.wanted_hz,
            "message": self.best.map(|(name, _)| name), "rate_hz": self.best.map_or(0.0, |(_, hz)| hz),
        })
    }
}
