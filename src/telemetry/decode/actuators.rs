//! What drives the rotors and how fast they turn; the battery.

use super::{Decoded, Decoder, sample};
use crate::signal::{MAX_ROTORS, SampleKind, Stamp};
use crate::vehicle::OutputSource;
use crate::wire::Fields;

#[derive(Debug, Clone, Copy)]
pub(super) struct OutputSourceRank(pub(super) OutputSource);

impl Default for OutputSourceRank {
    fn default() -> Self {
        Self(OutputSource::Auto)
    }
}

impl OutputSourceRank {
    fn of(self, message: OutputSource) -> Option<u8> {
        match (self.0, message) {
            (OutputSource::Auto, OutputSource::ActuatorOutputStatus) => Some(2),
            (OutputSource::Auto, OutputSource::ServoOutputRaw) => Some(1),
            // its scale (0..1) differs from the two above: only when asked for
            (OutputSource::Auto, _) => None,
            (wanted, got) => (wanted == got).then_some(1),
        }
    }
}

impl Decoder {
    /// SERVO_OUTPUT_RAW: u32 µs that wraps; 16 outputs, of which `port` says which bank.
    pub(super) fn servo_output(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        if f.u8(20) != 0 {
            return;
        }
        let t = self.clock.from_u32_us(f.u32(0));
        let Some(t) = self.stamp(t, received_us, sink) else { return };
        // outputs 1..8 at 4, 9..16 are extension fields at 21
        let at = |i: usize| if i < 8 { 4 + 2 * i } else { 21 + 2 * (i - 8) };
        self.outputs(t, OutputSource::ServoOutputRaw, |i| f.u16(at(i)).into(), sink);
    }

    pub(super) fn outputs(
        &mut self,
        t: Stamp,
        source: OutputSource,
        value: impl Fn(usize) -> f64,
        sink: &mut dyn FnMut(Decoded),
    ) {
        if let Some(rank) = self.actuators.of(source)
            && self.outputs.accept(rank, t)
        {
            let outputs: [f64; MAX_ROTORS] = std::array::from_fn(|i| {
                let x = value(i);
                if x.is_finite() { x } else { 0.0 }
            });
            sink(sample(t, SampleKind::Actuators { outputs }));
        }
    }

    pub(super) fn battery(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        // the first battery only; cells not fitted read 65535
        if f.u8(32) != 0 {
            return;
        }
        let mv: u32 = (0..10).map(|i| f.u16(10 + 2 * i)).filter(|&c| c != u16::MAX).map(u32::from).sum();
        if mv > 0 {
            sink(self.unstamped(received_us, SampleKind::Battery { voltage_v: f64::from(mv) * 1e-3 }));
        }
    }

    /// Four rotor speeds from rotor `first` on. ESC messages have no boot stamp that can be trusted.
    pub(super) fn rpm(
        &mut self,
        first: u8,
        value: impl Fn(usize) -> f64,
        received_us: u64,
        sink: &mut dyn FnMut(Decoded),
    ) {
        let mut rpm = [f64::NAN; MAX_ROTORS];
        for i in 0..4 {
            if let Some(slot) = rpm.get_mut(usize::from(first) + i) {
                *slot = value(i);
            }
        }
        sink(self.unstamped(received_us, SampleKind::RotorRpm { rpm }));
    }
}

/// PARAM_VALUE of ArduPilot's SERVOn_FUNCTION: 33–40 are motors 1–8, 82–85 motors 9–12.
pub(super) fn rotor_output(f: Fields<'_>) -> Option<Decoded> {
    let mut id = [0u8; 16];
    for (i, b) in id.iter_mut().enumerate() {
        *b = f.u8(8 + i);
    }
    let name = id.split(|&b| b == 0).next().and_then(|b| std::str::from_utf8(b).ok())?;
    let n: usize = name.strip_prefix("SERVO")?.strip_suffix("_FUNCTION")?.parse().ok()?;
    let rotor = match f.f32(0) as u16 {
        m @ 33..=40 => m - 33,
        m @ 82..=85 => m - 82 + 8,
        _ => return None,
    };
    Some(Decoded::RotorOutput { rotor: rotor.into(), output: n.checked_sub(1)? })
}
