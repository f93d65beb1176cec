use crate::wire::FrameRef;
use std::collections::HashMap;

/// Senders of limited messages that one link tells apart; what comes beyond passes unlimited.
const MOST: usize = 4096;

/// Lowest time between two of a message from one sender.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Limits {
    /// Message id and period, µs; sorted. A period of `u64::MAX` means never.
    periods: Vec<(u32, u64)>,
}

impl Limits {
    /// `rates` holds message ids with their highest rate, Hz; 0 means never.
    pub fn new(rates: impl IntoIterator<Item = (u32, f64)>) -> Self {
        let period = |hz: f64| if hz > 0.0 { (1e6 / hz).round() as u64 } else { u64::MAX };
        let mut periods: Vec<_> = rates.into_iter().map(|(id, hz)| (id, period(hz))).collect();
        periods.sort_unstable();
        periods.dedup_by_key(|&mut (id, _)| id);
        Self { periods }
    }

    fn period_us(&self, message: u32) -> Option<u64> {
        let at = self.periods.binary_search_by_key(&message, |&(id, _)| id).ok()?;
        self.periods.get(at).map(|&(_, period)| period)
    }
}

/// When each limited message of each sender may next leave on one link.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    next_us: HashMap<(u32, u8, u8), u64>,
}

impl Schedule {
    /// True if the frame may go at `now_us`, which then counts as sent.
    ///
    /// The schedule is kept, so that a stream of 50 Hz with jitter leaves at 10 Hz and not at 8.3. After a pause, or
    /// when the clock was set back, it begins anew.
    pub(super) fn pass(&mut self, limits: &Limits, frame: FrameRef<'_>, now_us: u64) -> bool {
        if limits.periods.is_empty() {
            return true;
        }
        let Some(period) = limits.period_us(frame.message_id()) else { return true };
        if period == u64::MAX {
            return false;
        }
        let key = (frame.message_id(), frame.system_id(), frame.component_id());
        if self.next_us.len() >= MOST && !self.next_us.contains_key(&key) {
            return true;
        }
        let next_us = self.next_us.entry(key).or_insert(now_us);
        let clock_went_back = *next_us > now_us.saturating_add(period.saturating_mul(2));
        if now_us < *next_us && !clock_went_back {
            return false;
        }
        let on_schedule = now_us >= *next_us && now_us - *next_us < period;
        *next_us = if on_schedule { *next_us } else { now_us }.saturating_add(period);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Encoder;
    use crate::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};

    #[test]
    fn each_sender_has_its_rate_and_other_messages_none() {
        let limits = Limits::new([(30, 10.0), (1, 0.0)]);
        let mut schedule = Schedule::default();
        let (mut first, mut second) = (Encoder::new(1, 1), Encoder::new(2, 1));
        let mut passed = [0; 3];
        // 50 Hz for ten seconds, every other message 9 ms late
        for k in 0..500u64 {
            let now_us = 1_000_000 + k * 20_000 + (k % 2) * 9_000;
            let frames = [first.encode(&ATTITUDE_DATA::DEFAULT), second.encode(&ATTITUDE_DATA::DEFAULT)];
            let heartbeat = first.encode(&HEARTBEAT_DATA::DEFAULT);
            for (count, frame) in passed.iter_mut().zip(frames.iter().chain([&heartbeat])) {
                *count += u32::from(schedule.pass(&limits, frame.as_ref(), now_us));
            }
        }
        assert!(passed[..2].iter().all(|count| (99..=101).contains(count)), "{passed:?}");
        assert_eq!(passed[2], 500);
    }

    #[test]
    fn a_clock_set_back_does_not_silence_it_and_zero_does() {
        let limits = Limits::new([(0, 10.0), (30, 0.0)]);
        let mut schedule = Schedule::default();
        let mut encoder = Encoder::new(1, 1);
        let heartbeat = encoder.encode(&HEARTBEAT_DATA::DEFAULT);
        let times = [1_000_000_000_u64, 5_000_000, 5_050_000, 5_100_000];
        assert_eq!(times.iter().filter(|&&t| schedule.pass(&limits, heartbeat.as_ref(), t)).count(), 3);
        let attitude = encoder.encode(&ATTITUDE_DATA::DEFAULT);
        assert!(!schedule.pass(&limits, attitude.as_ref(), 0));
    }
}
