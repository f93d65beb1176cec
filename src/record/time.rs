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
