//! Reading payloads: as generated types, or field by field.

use super::{Check, FrameRef};
use mavlink_core::MessageData;

/// The frame as message `T`, or `None` if it is another message, unverified, or holds an enum value that `T` does not
/// know.
///
/// One unknown enum value makes the generated types refuse the whole message. Where that would cost too much (a
/// HEARTBEAT with a new vehicle type), read [`FrameRef::fields`] instead.
pub fn decode<T: MessageData>(frame: FrameRef<'_>) -> Option<T> {
    if frame.message_id() != T::ID || frame.check() != Check::Verified {
        return None;
    }
    T::deser(frame.version(), frame.payload()).ok()
}

/// A payload extended by zeros to any length, as MAVLink 2 defines it. Offsets are those on the wire: fields ordered by
/// size, extension fields last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Fields<'a> {
    payload: &'a [u8],
}

macro_rules! little_endian {
    ($($name:ident),*) => {$(
        #[doc = concat!("The `", stringify!($name), "` at a byte offset.")]
        pub fn $name(self, offset: usize) -> $name {
            $name::from_le_bytes(self.array(offset))
        }
    )*};
}

impl<'a> Fields<'a> {
    pub fn new(payload: &'a [u8]) -> Self {
        Self { payload }
    }

    little_endian!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

    /// A character field of `N` bytes up to its NUL, if that is UTF-8.
    pub fn text(self, offset: usize, len: usize) -> Option<&'a str> {
        let rest = self.payload.get(offset..).unwrap_or_default();
        let field = rest.get(..len).unwrap_or(rest);
        let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
        std::str::from_utf8(field.get(..end)?).ok()
    }

    /// `N` bytes at an offset.
    pub fn array<const N: usize>(self, offset: usize) -> [u8; N] {
        let rest = self.payload.get(offset..).unwrap_or_default();
        match rest.first_chunk() {
            Some(whole) => *whole,
            None => {
                let mut extended = [0; N];
                for (to, from) in extended.iter_mut().zip(rest) {
                    *to = *from;
                }
                extended
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn payloads_go_on_with_zeros() {
        let fields = Fields::new(&[0x01, 0x02, 0x03]);
        assert_eq!(fields.u8(2), 3);
        assert_eq!(fields.u16(0), 0x0201);
        assert_eq!(fields.u32(1), 0x0302);
        assert_eq!(fields.i64(usize::MAX), 0);
        assert_eq!(Fields::new(&1.5f32.to_le_bytes()).f32(0), 1.5);
    }

    #[test]
    fn text_ends_at_nul_or_at_the_field() {
        let fields = Fields::new(b"\x07QGC\0rest");
        assert_eq!(fields.text(1, 8), Some("QGC"));
        assert_eq!(fields.text(1, 2), Some("QG"));
        assert_eq!(fields.text(90, 2), Some(""));
        assert_eq!(Fields::new(&[0xFF]).text(0, 1), None);
    }
}
