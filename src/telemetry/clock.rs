use crate::signal::Stamp;

/// Why a vehicle's time had to be started anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClockEvent {
    /// The boot clock went back: the vehicle restarted.
    Reboot,
}

/// A stamp that lies this far behind the newest is a restart, not a late message, s.
const REBOOT_BACKSTEP_S: f64 = 5.0;
/// Time constant with which the receive-time offset may grow again, s: follows the drift of two quartz clocks.
const OFFSET_RELAX_S: f64 = 60.0;
/// Stamps above this are UNIX time, not time since boot (MAVLink's own rule: tell by size), µs.
const UNIX_THRESHOLD_US: u64 = 1_000_000_000_000_000;

/// One vehicle's boot clock as seen through its messages.
///
/// Most messages carry boot time. Those that don't (ESC_TELEMETRY, BATTERY_STATUS, …) get their receive time mapped
/// to boot time with the least delay seen lately: `boot ≈ received − offset`, offset = min(received − boot).
#[derive(Debug, Clone, Default)]
pub struct VehicleClock {
    newest: Option<Stamp>,
    /// Received (µs since 1970) minus boot (µs): the smallest seen lately, and when it was last touched.
    offset_us: Option<(f64, u64)>,
    /// UNIX time minus boot time, µs, from SYSTEM_TIME: for messages stamped with UNIX time.
    unix_minus_boot_us: Option<i64>,
}

impl VehicleClock {
    /// Takes in a boot stamp and when it was received (µs since 1970).
    pub fn observe(&mut self, stamp: Stamp, received_us: u64) -> Option<ClockEvent> {
        let mut event = None;
        if let Some(newest) = self.newest
            && newest - stamp > REBOOT_BACKSTEP_S
        {
            *self = Self::default();
            event = Some(ClockEvent::Reboot);
        }
        self.newest = Some(self.newest.map_or(stamp, |n| n.max(stamp)));
        let offset = received_us as f64 - stamp.nanos() as f64 * 1e-3;
        self.offset_us = Some(match self.offset_us {
            Some((old, at)) if offset > old => {
                let share = received_us.saturating_sub(at) as f64 * 1e-6 / OFFSET_RELAX_S;
                (old + (offset - old) * share.min(1.0), received_us)
            }
            _ => (offset, received_us),
        });
        event
    }

    /// Boot time of something received at `received_us`, when any stamp is known yet.
    pub fn from_receive_time(&self, received_us: u64) -> Option<Stamp> {
        let (offset, _) = self.offset_us?;
        let boot_us = received_us as f64 - offset;
        // a message cannot have been sent after the newest stamp seen plus the link's jitter
        Some(Stamp::from_micros(boot_us as i64))
    }

    /// When something stamped so arrives with the least delay seen lately, µs since 1970: boot time on the receiver's
    /// clock.
    pub fn to_receive_time(&self, stamp: Stamp) -> Option<u64> {
        let (offset, _) = self.offset_us?;
        let unix_us = stamp.nanos() as f64 * 1e-3 + offset;
        (unix_us >= 0.0).then_some(unix_us as u64)
    }

    /// The newest boot stamp.
    pub fn newest(&self) -> Option<Stamp> {
        self.newest
    }

    /// Learns how UNIX time and boot time lie to each other (SYSTEM_TIME).
    pub fn observe_unix(&mut self, unix_us: u64, boot_ms: u32) {
        if unix_us > UNIX_THRESHOLD_US {
            self.unix_minus_boot_us = Some((unix_us as i64).saturating_sub(i64::from(boot_ms) * 1_000));
        }
    }

    /// A 64-bit µs field that may be boot or UNIX time.
    pub fn from_u64_us(&self, us: u64) -> Option<Stamp> {
        if us == 0 {
            None
        } else if us < UNIX_THRESHOLD_US {
            Some(Stamp::from_micros(us as i64))
        } else {
            self.unix_minus_boot_us.map(|d| Stamp::from_micros((us as i64).saturating_sub(d)))
        }
    }

    /// Seconds since 1970 at a boot stamp, once the vehicle has told its date.
    pub fn unix_s(&self, t: Stamp) -> Option<f64> {
        self.unix_minus_boot_us.map(|d| d as f64 * 1e-6 + t.secs())
    }

    /// A 32-bit µs field, which wraps every 71.6 minutes: the unwrapped value nearest to the newest stamp.
    pub fn from_u32_us(&self, us: u32) -> Stamp {
        const WRAP: i64 = 1 << 32;
        let near = self.newest.map_or(0, |n| n.nanos() / 1_000);
        let wraps = (near - i64::from(us) + WRAP / 2).div_euclid(WRAP);
        Stamp::from_micros(i64::from(us) + wraps * WRAP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_is_seen_and_a_late_message_is_not() {
        let mut c = VehicleClock::default();
        assert_eq!(c.observe(Stamp::from_millis(100_000), 1_000_000), None);
        assert_eq!(c.observe(Stamp::from_millis(99_700), 1_010_000), None);
        assert_eq!(c.observe(Stamp::from_millis(2_000), 9_000_000), Some(ClockEvent::Reboot));
        assert_eq!(c.observe(Stamp::from_millis(2_020), 9_020_000), None);
    }

    #[test]
    fn receive_time_maps_through_the_least_delay() {
        let mut c = VehicleClock::default();
        for (boot_ms, delay_us) in [(1_000, 30_000), (1_020, 5_000), (1_040, 25_000)] {
            c.observe(Stamp::from_millis(boot_ms), 5_000_000 + boot_ms as u64 * 1_000 + delay_us);
        }
        let t = c.from_receive_time(5_000_000 + 1_060_000 + 5_000).unwrap();
        assert!((t - Stamp::from_millis(1_060)).abs() < 1e-4);
    }

    #[test]
    fn thirty_two_bit_microseconds_unwrap() {
        let mut c = VehicleClock::default();
        let boot_us = (1_i64 << 32) + 1_000;
        c.observe(Stamp::from_micros(boot_us), 10_000_000_000);
        assert_eq!(c.from_u32_us(3_000), Stamp::from_micros((1 << 32) + 3_000));
        assert_eq!(c.from_u32_us(u32::MAX), Stamp::from_micros((1 << 32) - 1));
    }

    #[test]
    fn unix_stamps_need_system_time() {
        let mut c = VehicleClock::default();
        let unix = 1_795_331_082_000_000;
        assert_eq!(c.from_u64_us(unix + 5_000_000), None);
        c.observe_unix(unix, 1_000);
        assert_eq!(c.from_u64_us(unix + 5_000_000), Some(Stamp::from_millis(6_000)));
        assert_eq!(c.from_u64_us(6_000_000), Some(Stamp::from_millis(6_000)));
    }
}
