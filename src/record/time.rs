//! When a message was made: its own stamp, brought to the receiver's clock.

use crate::signal::Stamp;
use crate::telemetry::VehicleClock;
use crate::wire::Fields;
use crate::wire::definitions::{Definition, Kind};

/// A stamp that lands further than this from its receive time is not believed, ns.
const PLAUSIBLE_NS: u64 = 10_000_000_000;
/// Wire offset of SYSTEM_TIME's `time_boot_ms`, beside `time_unix_usec` at 0.
const SYSTEM_TIME_BOOT_MS: usize = 8;
const SYSTEM_TIME: u32 = 2;

/// Where a message type carries its own time.
#[derive(Debug, Clone, Copy)]
pub(super) enum OwnTime {
    None,
    BootMs(usize),
    /// Since boot or since 1970, µs.
    Us64(usize),
    /// Since boot, µs, wrapping every 71.6 minutes.
    Us32(usize),
    /// SYSTEM_TIME tells both.
    Both,
}

impl OwnTime {
    pub fn of(definition: &Definition) -> Self {
        if definition.id == SYSTEM_TIME {
            return Self::Both;
        }
        let stamp = definition.fields.iter().find_map(|f| {
            let at = usize::from(f.offset);
            match (f.name, f.kind) {
                ("time_boot_ms", Kind::U32) => Some(Self::BootMs(at)),
                ("time_usec" | "time_boot_us", Kind::U64) => Some(Self::Us64(at)),
                ("time_usec", Kind::U32) => Some(Self::Us32(at)),
                _ => None,
            }
        });
        stamp.unwrap_or(Self::None)
    }
}

/// One component's clock against the receiver's.
#[derive(Debug, Default)]
pub(super) struct ComponentTime {
    clock: VehicleClock,
}

impl ComponentTime {
    /// When a message was made, ns since 1970 on the receiver's clock; its receive time where it does not say.
    pub fn publish_time_ns(&mut self, own: OwnTime, fields: Fields<'_>, received_ns: u64) -> u64 {
        let stamp = self.stamp(own, fields, Some(received_ns / 1_000));
        stamp.map_or(received_ns, |s| self.unix_ns(s, received_ns))
    }

    /// Takes in a stamp and when it was received.
    pub fn learn(&mut self, stamp: Stamp, received_ns: u64) {
        self.clock.observe(stamp, received_ns / 1_000);
    }

    /// A stamp on the receiver's clock, if that is plausible, else the receive time.
    pub fn unix_ns(&self, stamp: Stamp, received_ns: u64) -> u64 {
        let aligned = self.clock.to_receive_time(stamp).and_then(|us| us.checked_mul(1_000));
        aligned.filter(|ns| ns.abs_diff(received_ns) <= PLAUSIBLE_NS).unwrap_or(received_ns)
    }

    /// Boot time of a message that was recorded without receive time: its own, or that of the newest before it.
    pub fn boot_time_ns(&mut self, own: OwnTime, fields: Fields<'_>) -> Option<u64> {
        // without a receive time the clock only unwraps and compares
        let stamp = self.stamp(own, fields, None).or(self.clock.newest())?;
        u64::try_from(stamp.nanos()).ok()
    }

    fn stamp(&mut self, own: OwnTime, fields: Fields<'_>, received_us: Option<u64>) -> Option<Stamp> {
        let learn = |clock: &mut VehicleClock, ms: u32| {
            let stamp = Stamp::from_millis(ms.into());
            clock.observe(stamp, received_us.unwrap_or(0));
            Some(stamp)
        };
        match own {
            OwnTime::None => None,
            OwnTime::BootMs(at) => learn(&mut self.clock, fields.u32(at)).filter(|s| *s > Stamp::default()),
            OwnTime::Both => {
                let boot_ms = fields.u32(SYSTEM_TIME_BOOT_MS);
                self.clock.observe_unix(fields.u64(0), boot_ms);
                learn(&mut self.clock, boot_ms)
            }
            OwnTime::Us64(at) => self.clock.from_u64_us(fields.u64(at)),
            OwnTime::Us32(at) => Some(self.clock.from_u32_us(fields.u32(at))),
        }
    }
}

/// `20260131T235959Z`: a moment as file names hold it.
pub(super) fn file_stamp(unix_us: u64) -> String {
    let seconds = unix_us / 1_000_000;
    let (year, month, day) = civil_date(seconds / 86_400);
    let (hour, minute, second) = (seconds / 3_600 % 24, seconds / 60 % 60, seconds % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}Z")
}

/// Year, month and day of a day counted from 1970-01-01.
///
/// Counts in 400-year cycles of 146 097 days from 0000-03-01, so that a leap day is the last of its year.
fn civil_date(days_since_1970: u64) -> (u64, u64, u64) {
    let days = days_since_1970 + 719_468;
    let (cycle, day_of_cycle) = (days / 146_097, days % 146_097);
    let year_of_cycle = (day_of_cycle - day_of_cycle / 1_460 + day_of_cycle / 36_524 - day_of_cycle / 146_096) / 365;
    let day_of_year = day_of_cycle - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    // months of March to February have 31, 30, 31, 30, 31 days, twice, and then the rest: 153 days in five
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (cycle * 400 + year_of_cycle + u64::from(month <= 2), month, day)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_read_as_dates() {
        for (seconds, text) in [
            (0, "19700101T000000Z"),
            (951_782_400, "20000229T000000Z"),
            (1_709_251_199, "20240229T235959Z"),
            (1_709_251_200, "20240301T000000Z"),
            (4_107_542_399, "21000228T235959Z"),
            (4_107_542_400, "21000301T000000Z"),
        ] {
            assert_eq!(file_stamp(seconds * 1_000_000), text);
        }
    }

    #[test]
    fn every_day_follows_the_one_before() {
        let mut last = civil_date(0);
        for day in 1..200_000 {
            let date = civil_date(day);
            let next_day = (last.0, last.1, last.2 + 1) == date;
            let next_month = date.2 == 1 && (date.0 * 12 + date.1) == (last.0 * 12 + last.1) + 1 && last.2 >= 28;
            assert!(next_day || next_month, "{last:?} then {date:?}");
            last = date;
        }
    }
}
