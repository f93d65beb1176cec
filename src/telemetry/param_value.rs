//! PARAM_VALUE: one parameter, in the two ways in which autopilots put integers into its float field.

use crate::wire::FrameRef;

/// How a parameter that is no float travels in a float field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Converted: ArduPilot.
    Cast,
    /// Its bytes: PX4.
    Bytewise,
}

/// MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE.
const CAPABILITY_BYTEWISE: u64 = 16;
/// MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST.
const CAPABILITY_CAST: u64 = 131_072;
/// MAV_AUTOPILOT_PX4.
const PX4: u8 = 12;

impl Encoding {
    /// By AUTOPILOT_VERSION's capabilities where they are known, else by the autopilot's habit.
    pub fn of(autopilot: u8, capabilities: Option<u64>) -> Self {
        match capabilities {
            Some(c) if c & CAPABILITY_BYTEWISE != 0 => Self::Bytewise,
            Some(c) if c & CAPABILITY_CAST != 0 => Self::Cast,
            _ if autopilot == PX4 => Self::Bytewise,
            _ => Self::Cast,
        }
    }

    /// The number in a float field of the given MAV_PARAM_TYPE; `None` for types that no float field holds.
    pub fn decode(self, field: f32, kind: u8) -> Option<f64> {
        let bits = field.to_bits();
        match (self, kind) {
            (_, 9) => Some(field.into()),
            (Self::Cast, 1..=6) => Some(field.into()),
            (Self::Bytewise, 1) => Some(f64::from(bits as u8)),
            (Self::Bytewise, 2) => Some(f64::from(bits as u8 as i8)),
            (Self::Bytewise, 3) => Some(f64::from(bits as u16)),
            (Self::Bytewise, 4) => Some(f64::from(bits as u16 as i16)),
            (Self::Bytewise, 5) => Some(f64::from(bits)),
            (Self::Bytewise, 6) => Some(f64::from(bits as i32)),
            _ => None,
        }
    }

    /// The float field that carries a number as the given MAV_PARAM_TYPE.
    pub fn encode(self, value: f64, kind: u8) -> f32 {
        match (self, kind) {
            (Self::Bytewise, 1 | 3 | 5) => f32::from_bits(value as u32),
            (Self::Bytewise, 2 | 4 | 6) => f32::from_bits(value as i32 as u32),
            _ => value as f32,
        }
    }
}

/// One PARAM_VALUE.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParamValue<'a> {
    pub name: &'a str,
    pub value: f64,
    /// MAV_PARAM_TYPE.
    pub kind: u8,
    /// How many parameters there are.
    pub count: u16,
    /// 65535 where the sender gives none.
    pub index: u16,
}

impl<'a> ParamValue<'a> {
    /// Reads a frame; `None` for other messages, names that are no text and types that no float field holds.
    pub fn read(frame: FrameRef<'a>, encoding: Encoding) -> Option<Self> {
        if frame.message_id() != 22 {
            return None;
        }
        let f = frame.fields();
        let kind = f.u8(24);
        let name = f.text(8, 16).filter(|n| !n.is_empty())?;
        Some(Self { name, value: encoding.decode(f.f32(0), kind)?, kind, count: f.u16(4), index: f.u16(6) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn integers_survive_both_ways(value in -100_000_i32..100_000) {
            for encoding in [Encoding::Cast, Encoding::Bytewise] {
                let field = encoding.encode(value.into(), 6);
                prop_assert_eq!(encoding.decode(field, 6), Some(value.into()));
            }
        }
    }

    #[test]
    fn capabilities_count_more_than_habits() {
        assert_eq!(Encoding::of(PX4, None), Encoding::Bytewise);
        assert_eq!(Encoding::of(PX4, Some(CAPABILITY_CAST)), Encoding::Cast);
        assert_eq!(Encoding::of(3, Some(CAPABILITY_BYTEWISE)), Encoding::Bytewise);
        assert_eq!(Encoding::of(3, Some(2)), Encoding::Cast);
    }
}
