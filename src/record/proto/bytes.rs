//! The protobuf wire format, as far as it is needed: writing into a buffer that is used again, and walking over fields.

const VARINT: u32 = 0;
const FIXED64: u32 = 1;
const LENGTH: u32 = 2;
const FIXED32: u32 = 5;

/// Appends protobuf fields to a buffer. Does not allocate once the buffer has grown.
pub(in crate::record) trait PutProto {
    fn put_varint(&mut self, value: u64);
    fn put_bytes(&mut self, number: u32, bytes: &[u8]);
    fn put_u64(&mut self, number: u32, value: u64);
    fn put_f64(&mut self, number: u32, value: f64);
    fn put_f32(&mut self, number: u32, value: f32);
    /// As zigzag: `sint32`, `sint64`.
    fn put_i64(&mut self, number: u32, value: i64);
    /// A message within the message. Its length is known only afterwards, so the bytes are moved once.
    fn put_message(&mut self, number: u32, write: impl FnOnce(&mut Self));
}

impl PutProto for Vec<u8> {
    #[inline]
    fn put_varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.push(value as u8);
    }

    fn put_bytes(&mut self, number: u32, bytes: &[u8]) {
        self.put_varint(tag(number, LENGTH));
        self.put_varint(bytes.len() as u64);
        self.extend_from_slice(bytes);
    }

    fn put_u64(&mut self, number: u32, value: u64) {
        self.put_varint(tag(number, VARINT));
        self.put_varint(value);
    }

    fn put_f64(&mut self, number: u32, value: f64) {
        self.put_varint(tag(number, FIXED64));
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn put_f32(&mut self, number: u32, value: f32) {
        self.put_varint(tag(number, FIXED32));
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn put_i64(&mut self, number: u32, value: i64) {
        self.put_u64(number, zigzag(value));
    }

    fn put_message(&mut self, number: u32, write: impl FnOnce(&mut Self)) {
        self.put_varint(tag(number, LENGTH));
        let at = self.len();
        write(self);
        let len = self.len() - at;
        let mut prefix = [0; 10];
        let mut used = 0;
        let mut rest = len as u64;
        loop {
            // seven bits at a time: ten bytes hold 64
            prefix[used] = (rest as u8 & 0x7F) | if rest >= 0x80 { 0x80 } else { 0 };
            used += 1;
            rest >>= 7;
            if rest == 0 {
                break;
            }
        }
        self.splice(at..at, prefix[..used].iter().copied());
    }
}

/// The tag of a varint, fixed or length-delimited field.
pub(super) fn tag(number: u32, wire_type: u32) -> u64 {
    u64::from(number << 3 | wire_type)
}

pub(super) const WIRE_VARINT: u32 = VARINT;
pub(super) const WIRE_FIXED64: u32 = FIXED64;
pub(super) const WIRE_LENGTH: u32 = LENGTH;
pub(super) const WIRE_FIXED32: u32 = FIXED32;

/// One field of an encoded message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::record) enum Value<'a> {
    Varint(u64),
    Fixed32([u8; 4]),
    Fixed64([u8; 8]),
    Bytes(&'a [u8]),
}

/// Walks over the fields of an encoded message. Ends early at bytes that are no field; [`Self::is_damaged`] tells.
#[derive(Debug, Clone)]
pub(in crate::record) struct ProtoFields<'a> {
    rest: &'a [u8],
    damaged: bool,
}

impl<'a> ProtoFields<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, damaged: false }
    }

    pub fn is_damaged(&self) -> bool {
        self.damaged
    }

    fn field(&mut self) -> Option<(u32, Value<'a>)> {
        let tag = varint(&mut self.rest)?;
        let value = match tag as u32 & 7 {
            VARINT => Value::Varint(varint(&mut self.rest)?),
            FIXED32 => Value::Fixed32(take(&mut self.rest)?),
            FIXED64 => Value::Fixed64(take(&mut self.rest)?),
            LENGTH => {
                let len = usize::try_from(varint(&mut self.rest)?).ok()?;
                let (bytes, rest) = self.rest.split_at_checked(len)?;
                self.rest = rest;
                Value::Bytes(bytes)
            }
            _ => return None,
        };
        Some((u32::try_from(tag >> 3).ok()?, value))
    }
}

impl<'a> Iterator for ProtoFields<'a> {
    type Item = (u32, Value<'a>);

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.is_empty() || self.damaged {
            return None;
        }
        let field = self.field();
        self.damaged = field.is_none();
        field
    }
}

/// Takes a varint off the beginning.
pub(in crate::record) fn varint(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for (i, &byte) in bytes.iter().enumerate().take(10) {
        value |= u64::from(byte & 0x7F) << (7 * i as u32);
        if byte < 0x80 {
            *bytes = bytes.get(i + 1..).unwrap_or_default();
            return Some(value);
        }
    }
    None
}

fn take<const N: usize>(bytes: &mut &[u8]) -> Option<[u8; N]> {
    let (head, rest) = bytes.split_first_chunk()?;
    *bytes = rest;
    Some(*head)
}

pub(super) fn zigzag(value: i64) -> u64 {
    ((value << 1) ^ (value >> 63)) as u64
}

pub(super) fn unzigzag(value: u64) -> i64 {
    (value >> 1) as i64 ^ -((value & 1) as i64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_was_put_is_read(a in any::<u64>(), b in any::<f64>(), c in proptest::collection::vec(any::<u8>(), 0..400)) {
            let mut out = Vec::new();
            out.put_u64(1, a);
            out.put_message(3, |m| {
                m.put_f64(2, b);
                m.put_bytes(1000, &c);
            });
            let mut fields = ProtoFields::new(&out);
            prop_assert_eq!(fields.next(), Some((1, Value::Varint(a))));
            let Some((3, Value::Bytes(inner))) = fields.next() else { panic!("no message") };
            prop_assert!(fields.next().is_none() && !fields.is_damaged());
            let inner: Vec<_> = ProtoFields::new(inner).collect();
            prop_assert_eq!(&inner[0], &(2, Value::Fixed64(b.to_le_bytes())));
            prop_assert_eq!(&inner[1], &(1000, Value::Bytes(&c)));
        }

        #[test]
        fn any_bytes_are_walked_without_panic(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            let _ = ProtoFields::new(&bytes).count();
        }

        #[test]
        fn zigzag_is_undone(x in any::<i64>()) {
            prop_assert_eq!(unzigzag(zigzag(x)), x);
        }
    }
}
