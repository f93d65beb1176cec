//! Raw solutions of a GNSS receiver.

use super::{Decoded, Decoder, sample};
use crate::signal::{FixType, GnssFix, SampleKind};
use crate::wire::Fields;

impl Decoder {
    /// GPS_RAW_INT: speed and course over ground, no vertical velocity. The stamp is that of the fix.
    pub(super) fn gps_raw(&mut self, f: Fields<'_>, received_us: u64, sink: &mut dyn FnMut(Decoded)) {
        let fix_type = match f.u8(28) {
            2 => FixType::TwoD,
            3 => FixType::ThreeD,
            4 => FixType::Differential,
            5 => FixType::RtkFloat,
            // RTK fixed, static, PPP
            6..=8 => FixType::RtkFixed,
            _ => return,
        };
        let time = self.clock.from_u64_us(f.u64(0)).or_else(|| self.clock.from_receive_time(received_us));
        let Some(t) = time else { return };
        let known = |x: u16| (x != u16::MAX).then(|| f64::from(x) * 1e-2);
        // extension fields are zero where the sender does not know them
        let accuracy = |at: usize| Some(f64::from(f.u32(at)) * 1e-3).filter(|x| *x > 0.0);
        let ground_velocity_mps = known(f.u16(24)).zip(known(f.u16(26))).map(|(speed, course_deg)| {
            let (east, north) = course_deg.to_radians().sin_cos();
            [speed * north, speed * east]
        });
        let satellites = f.u8(29);
        let fix = GnssFix {
            fix_type,
            latitude_deg: f64::from(f.i32(8)) * 1e-7,
            longitude_deg: f64::from(f.i32(12)) * 1e-7,
            altitude_m: f64::from(f.i32(16)) * 1e-3,
            position_ned_m: None,
            ground_velocity_mps,
            down_velocity_mps: None,
            hdop: known(f.u16(20)),
            vdop: known(f.u16(22)),
            horizontal_accuracy_m: accuracy(34),
            vertical_accuracy_m: accuracy(38),
            speed_accuracy_mps: accuracy(42),
            satellites: (satellites != u8::MAX).then_some(satellites),
            unix_s: self.clock.unix_s(t),
        };
        sink(sample(t, SampleKind::Gnss(fix)));
    }
}
