//! What the measured rates say: who is content, who is asked for again, and what the link carries.

use super::carriers::Subject;
use super::stream::{Asked, NOT_ASKED, Target};
use super::want::WantState;
use super::{Cause, FIRST_REST_MS, Notice, SETTLE_MS, StreamRequester, pace};

/// Longest wait before an unmet channel is asked for again.
const LONGEST_REST_MS: u64 = 300_000;
/// A channel that was met for this long starts over with short rests.
const FORGIVEN_MS: u64 = 60_000;
/// Parts of the wanted rate: below `GOOD` ask; below `ENOUGH` after asking report; below `LOST` later, ask again.
const GOOD: f64 = 0.9;
const ENOUGH: f64 = 0.5;
const LOST: f64 = 0.4;
/// A frame more or less within the time over which rates are measured, Hz.
const FRAME_HZ: f64 = 0.25;

pub(super) fn is_good(measured_hz: f64, wanted_hz: f64) -> bool {
    measured_hz + FRAME_HZ >= GOOD * wanted_hz
}

impl StreamRequester {
    /// Moves one want on; returns the stream that it would like to ask for now.
    pub(super) fn judge(
        &mut self,
        index: usize,
        unsettled: bool,
        now_ms: u64,
        notice: &mut dyn FnMut(Notice),
    ) -> Option<usize> {
        let measured_hz = self.measured_hz(index, now_ms);
        let want = &mut self.wants[index];
        let wanted_hz = self.pace.of(want.rate_hz);
        match want.state {
            WantState::Met { since_ms } => {
                if measured_hz >= LOST * wanted_hz {
                    if now_ms.saturating_sub(since_ms) > FORGIVEN_MS {
                        want.rest_ms = FIRST_REST_MS;
                    }
                    return None;
                }
                // it stopped: ask again, but not more often than an unmet want may
                let rest = if now_ms.saturating_sub(since_ms) > FORGIVEN_MS { 0 } else { want.rest_ms };
                want.state = WantState::Resting { until_ms: now_ms + rest };
                return None;
            }
            WantState::Resting { until_ms } => {
                if !is_good(measured_hz, wanted_hz) {
                    if now_ms >= until_ms {
                        want.rest_ms = (want.rest_ms * 2).min(LONGEST_REST_MS);
                        want.state = WantState::Asking;
                        for &stream in &want.streams {
                            if !matches!(self.streams[stream].asked, Asked::Open { .. }) {
                                self.streams[stream].asked = NOT_ASKED;
                            }
                        }
                    }
                    return None;
                }
            }
            WantState::Asking => {}
        }
        if is_good(measured_hz, wanted_hz) {
            self.settle(index, measured_hz, now_ms, notice);
            return None;
        }
        let (mut refused, mut granted) = (false, false);
        for &stream in &self.wants[index].streams {
            let comes = self.streams[stream].rate.hz(now_ms) > 0.0;
            match self.streams[stream].asked {
                Asked::No { not_before_ms, .. } => return (now_ms >= not_before_ms).then_some(stream),
                Asked::Open { .. } => return None,
                Asked::Granted { at_ms } if now_ms.saturating_sub(at_ms) < SETTLE_MS => return None,
                // the answer was lost, and it was granted
                Asked::Unanswered if comes => {
                    granted = true;
                    if unsettled {
                        return None;
                    }
                    break;
                }
                Asked::Granted { .. } => {
                    let stream = &mut self.streams[stream];
                    let arrives = match stream.request {
                        Target::Message(_) => {
                            granted = true;
                            comes
                        }
                        // a group is obeyed without an answer: what it brings shows in the messages' rates
                        Target::Group(_) => measured_hz > 0.0,
                    };
                    if arrives && unsettled {
                        // several slow ones together are the link's doing: see `keep_pace`
                        return None;
                    }
                    if arrives {
                        break;
                    }
                }
                Asked::Refused => refused = true,
                Asked::Unanswered => {}
            }
        }
        if measured_hz >= ENOUGH * wanted_hz {
            self.settle(index, measured_hz, now_ms, notice);
            return None;
        }
        let cause = match (granted, refused) {
            (true, _) if measured_hz > 0.0 => Cause::Slow,
            (true, _) => Cause::Silent,
            (false, true) => Cause::Refused,
            (false, false) => Cause::Unanswered,
        };
        let want = &mut self.wants[index];
        want.state = WantState::Resting { until_ms: now_ms + want.rest_ms };
        if let (Subject::Channel(channel), false, false) = (want.subject, want.reported, want.optional) {
            want.reported = true;
            notice(Notice::Unmet { channel, wanted_hz: want.rate_hz, measured_hz, cause });
        }
        None
    }

    fn settle(&mut self, index: usize, measured_hz: f64, now_ms: u64, notice: &mut dyn FnMut(Notice)) {
        let want = &mut self.wants[index];
        want.state = WantState::Met { since_ms: now_ms };
        if let (Subject::Channel(channel), true) = (want.subject, want.reported) {
            want.reported = false;
            notice(Notice::Met { channel, measured_hz });
        }
    }

    /// Slows all fast messages down to what the link carries, and tries more of it later.
    pub(super) fn keep_pace(&mut self, now_ms: u64, notice: &mut dyn FnMut(Notice)) {
        if self.streams.iter().any(|s| s.unsettled(now_ms)) {
            return;
        }
        let mut observed = pace::Observed::default();
        for stream in &mut self.streams {
            if stream.runs() {
                if stream.rate.hz(now_ms) > 0.0 && pace::is_fast(stream.asked_hz) && !stream.rate.flows(now_ms) {
                    // it stopped, as all do at a reboot: that says nothing of what the link carries
                    return;
                }
                observed.add(stream.asked_hz, stream.rate.hz(now_ms));
            }
        }
        let before = self.pace.factor();
        if !self.pace.adapt(&observed, now_ms) {
            return;
        }
        for stream in &mut self.streams {
            stream.again = stream.runs() && pace::is_fast(stream.asked_hz);
        }
        if self.pace.factor() < before {
            let fastest_hz = self.wants.iter().map(|w| w.rate_hz).fold(0.0, f64::max);
            let asked_hz = self.pace.of(fastest_hz);
            notice(Notice::Slowed { wanted_hz: fastest_hz, asked_hz });
        }
    }

    /// The rate of the fastest message that carries the want, Hz.
    pub(super) fn measured_hz(&mut self, index: usize, now_ms: u64) -> f64 {
        let mut fastest: f64 = 0.0;
        for &stream in &self.wants[index].streams {
            fastest = fastest.max(self.streams[stream].rate.hz(now_ms));
        }
        fastest
    }
}
