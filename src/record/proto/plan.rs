//! Payloads to protobuf and back, by a plan made once for each message type.

use super::bytes::{
    ProtoFields, PutProto, Value, WIRE_FIXED32, WIRE_FIXED64, WIRE_LENGTH, WIRE_VARINT, tag, unzigzag, varint, zigzag,
};
use super::descriptor::{RAW_FRAME, RAW_STAMP, is_enum};
use crate::wire::definitions::{Definition, Field, Kind};
use crate::wire::{FrameRef, MavlinkVersion};

/// A payload with room for a field that begins at its last byte.
const ROOM: usize = 256 + 8;
/// Marks a MAVLink 1 frame that the fields determine.
const PLAIN_V1: [u8; 1] = [0xFE];

/// How one message type is written.
#[derive(Debug)]
pub struct Plan {
    definition: &'static Definition,
    steps: Vec<Step>,
}

#[derive(Debug, Clone, Copy)]
struct Step {
    /// The tag as a varint of `tag_len` bytes.
    tag: [u8; 2],
    tag_len: u8,
    action: Action,
    offset: usize,
    size: usize,
}

#[derive(Debug, Clone, Copy)]
enum Action {
    /// The bytes on the wire are the protobuf bytes: 4 or 8 of them.
    Copy,
    U8,
    U16,
    I8,
    I16,
    /// As `I8` and `I16`, but not zigzag: an enum.
    SignedEnum8,
    SignedEnum16,
    /// A packed list whose elements are copied, or bytes.
    Block,
    /// A packed list of varints.
    List(Kind, bool),
    Text,
}

/// Why a recorded message does not give a payload.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum PayloadError {
    #[error("the message is cut off or damaged")]
    Damaged,
    #[error("field {number} of {message} has another type than the dialect says")]
    Mismatch { message: &'static str, number: u32 },
}

/// What a recorded message says beside its fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kept<'a> {
    /// How the frame was made.
    pub frame: KeptFrame<'a>,
    /// What stood in place of the receive time: eight bytes or none.
    pub stamp: Option<&'a [u8]>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeptFrame<'a> {
    /// The fields determine it; the payload has this many bytes.
    Plain(MavlinkVersion, usize),
    /// As received.
    Raw(&'a [u8]),
}

impl Plan {
    pub fn new(definition: &'static Definition) -> Self {
        let steps = (1..).zip(definition.fields).map(|(number, field)| Step::new(number, field)).collect();
        Self { definition, steps }
    }

    pub fn definition(&self) -> &'static Definition {
        self.definition
    }

    /// Appends a frame of this message. `stamp` is what stood in place of the receive time, if that is irregular.
    /// Does not allocate once `out` has grown, except for text that is not UTF-8.
    pub fn encode(&self, frame: FrameRef<'_>, stamp: Option<&[u8]>, out: &mut Vec<u8>) {
        let payload = frame.payload();
        let mut wire = [0; ROOM];
        // a payload is at most 255 bytes long
        wire[..payload.len()].copy_from_slice(payload);
        let mut exact = self.is_canonical(frame);
        for step in &self.steps {
            exact &= step.encode(&wire, out);
        }
        if !exact {
            out.put_bytes(RAW_FRAME, frame.bytes());
        } else if frame.version() == MavlinkVersion::V1 {
            out.put_bytes(RAW_FRAME, &PLAIN_V1);
        }
        if let Some(stamp) = stamp {
            out.put_bytes(RAW_STAMP, stamp);
        }
    }

    /// Whether the payload's length is the one its values give, and nothing unusual stands in the header.
    fn is_canonical(&self, frame: FrameRef<'_>) -> bool {
        let payload = frame.payload();
        match frame.version() {
            MavlinkVersion::V1 => payload.len() == usize::from(self.definition.len_v1),
            MavlinkVersion::V2 => {
                let cut = payload.len() == 1 || payload.last().is_some_and(|&b| b != 0);
                // incompatibility and compatibility flags
                let flags = frame.bytes().get(2..4).is_some_and(|f| f == [0, 0]);
                cut && flags && payload.len() <= usize::from(self.definition.len)
            }
        }
    }

    /// The payload of a recorded message into `payload`, zeros where fields are absent, and what else it says.
    ///
    /// # Errors
    /// The bytes are no message of this type.
    pub fn decode<'a>(&self, data: &'a [u8], payload: &mut [u8; 255]) -> Result<Kept<'a>, PayloadError> {
        let mut wire = [0; ROOM];
        let (mut raw, mut stamp) = (None, None);
        let mut fields = ProtoFields::new(data);
        for (number, value) in &mut fields {
            match (number, value) {
                (RAW_FRAME, Value::Bytes(bytes)) => raw = Some(bytes),
                (RAW_STAMP, Value::Bytes(bytes)) => stamp = Some(bytes),
                _ => {
                    let step = (number as usize).checked_sub(1).and_then(|i| self.steps.get(i));
                    // a field that a later version of the dialect added is not ours to judge
                    let Some(step) = step else { continue };
                    let mismatch = PayloadError::Mismatch { message: self.definition.name, number };
                    step.decode(value, &mut wire).ok_or(mismatch)?;
                }
            }
        }
        if fields.is_damaged() {
            return Err(PayloadError::Damaged);
        }
        payload.copy_from_slice(&wire[..255]);
        let frame = match raw {
            None => {
                let used = payload.iter().rposition(|&b| b != 0).map_or(1, |last| last + 1);
                KeptFrame::Plain(MavlinkVersion::V2, used)
            }
            Some(mark) if mark == PLAIN_V1 => KeptFrame::Plain(MavlinkVersion::V1, self.definition.len_v1.into()),
            Some(bytes) => KeptFrame::Raw(bytes),
        };
        Ok(Kept { frame, stamp })
    }
}

impl Step {
    fn new(number: u32, field: &Field) -> Self {
        let list = field.array > 0;
        let as_enum = is_enum(field);
        let (action, wire_type) = match field.kind {
            Kind::Char => (Action::Text, WIRE_LENGTH),
            Kind::U8 if list && !as_enum => (Action::Block, WIRE_LENGTH),
            Kind::U8 | Kind::I8 | Kind::U16 | Kind::I16 if list => (Action::List(field.kind, as_enum), WIRE_LENGTH),
            Kind::U8 => (Action::U8, WIRE_VARINT),
            Kind::U16 => (Action::U16, WIRE_VARINT),
            Kind::I8 if as_enum => (Action::SignedEnum8, WIRE_VARINT),
            Kind::I16 if as_enum => (Action::SignedEnum16, WIRE_VARINT),
            Kind::I8 => (Action::I8, WIRE_VARINT),
            Kind::I16 => (Action::I16, WIRE_VARINT),
            _ if list => (Action::Block, WIRE_LENGTH),
            Kind::U32 | Kind::I32 | Kind::F32 => (Action::Copy, WIRE_FIXED32),
            Kind::U64 | Kind::I64 | Kind::F64 => (Action::Copy, WIRE_FIXED64),
        };
        let tag = tag(number, wire_type);
        // a payload has at most 255 fields, so a tag takes two bytes
        let (tag, tag_len) = if tag < 0x80 { ([tag as u8, 0], 1) } else { ([tag as u8 | 0x80, (tag >> 7) as u8], 2) };
        Self { tag, tag_len, action, offset: field.offset.into(), size: field.size() }
    }

    /// Appends the field, and says whether its bytes can be told from what was written.
    #[inline]
    fn encode(&self, wire: &[u8; ROOM], out: &mut Vec<u8>) -> bool {
        out.extend_from_slice(&self.tag[..usize::from(self.tag_len)]);
        // the tables hold only fields that lie within 255 bytes
        let bytes = &wire[self.offset..self.offset + self.size];
        match (self.action, bytes) {
            (Action::Copy, _) => out.extend_from_slice(bytes),
            (Action::U8, [b, ..]) => out.put_varint(u64::from(*b)),
            (Action::I8, [b, ..]) => out.put_varint(zigzag(i64::from(*b as i8))),
            (Action::SignedEnum8, [b, ..]) => out.put_varint(i64::from(*b as i8) as u64),
            (Action::U16, [a, b, ..]) => out.put_varint(u64::from(u16::from_le_bytes([*a, *b]))),
            (Action::I16, [a, b, ..]) => out.put_varint(zigzag(i64::from(i16::from_le_bytes([*a, *b])))),
            (Action::SignedEnum16, [a, b, ..]) => out.put_varint(i64::from(i16::from_le_bytes([*a, *b])) as u64),
            (Action::Block, _) => {
                out.put_varint(bytes.len() as u64);
                out.extend_from_slice(bytes);
            }
            (Action::List(kind, as_enum), _) => {
                let elements = || bytes.chunks_exact(kind.size()).map(|e| element(e, kind, as_enum));
                out.put_varint(elements().map(varint_len).sum());
                elements().for_each(|e| out.put_varint(e));
            }
            (Action::Text, _) => return text(bytes, out),
            // a field has at least one byte, two if it is 16 bits wide
            _ => {}
        }
        true
    }

    fn decode(&self, value: Value<'_>, wire: &mut [u8; ROOM]) -> Option<()> {
        let to = &mut wire[self.offset..self.offset + self.size];
        match (self.action, value) {
            (Action::Copy, Value::Fixed32(bytes)) if to.len() == 4 => to.copy_from_slice(&bytes),
            (Action::Copy, Value::Fixed64(bytes)) if to.len() == 8 => to.copy_from_slice(&bytes),
            (Action::U8 | Action::SignedEnum8 | Action::U16 | Action::SignedEnum16, Value::Varint(v)) => {
                put_low(to, v);
            }
            (Action::I8 | Action::I16, Value::Varint(v)) => put_low(to, unzigzag(v) as u64),
            (Action::Block, Value::Bytes(bytes)) if bytes.len() == to.len() => to.copy_from_slice(bytes),
            // replacement characters may make it longer than the field; the whole frame stands beside it then
            (Action::Text, Value::Bytes(bytes)) => to.iter_mut().zip(bytes).for_each(|(to, byte)| *to = *byte),
            (Action::List(kind, as_enum), Value::Bytes(mut bytes)) => {
                let zigzagged = matches!(kind, Kind::I8 | Kind::I16) && !as_enum;
                for to in to.chunks_exact_mut(kind.size()) {
                    let v = varint(&mut bytes)?;
                    put_low(to, if zigzagged { unzigzag(v) as u64 } else { v });
                }
            }
            _ => return None,
        }
        Some(())
    }
}

fn put_low(to: &mut [u8], value: u64) {
    to.iter_mut().zip(value.to_le_bytes()).for_each(|(to, byte)| *to = byte);
}

fn element(bytes: &[u8], kind: Kind, as_enum: bool) -> u64 {
    let signed = match (kind, bytes) {
        (Kind::U16, [a, b]) => return u64::from(u16::from_le_bytes([*a, *b])),
        (Kind::I16, [a, b]) => i64::from(i16::from_le_bytes([*a, *b])),
        (Kind::I8, [a]) => i64::from(*a as i8),
        (_, [a, ..]) => return u64::from(*a),
        (_, []) => 0,
    };
    if as_enum { signed as u64 } else { zigzag(signed) }
}

fn varint_len(value: u64) -> u64 {
    u64::from((64 - (value | 1).leading_zeros()).div_ceil(7))
}

/// A text up to its NUL. It is exact if nothing but zeros follows, and if it is UTF-8, which protobuf insists on.
fn text(field: &[u8], out: &mut Vec<u8>) -> bool {
    let end = field.iter().position(|&b| b == 0).unwrap_or(field.len());
    let (text, rest) = field.split_at(end);
    match std::str::from_utf8(text) {
        Ok(text) => {
            out.put_varint(text.len() as u64);
            out.extend_from_slice(text.as_bytes());
            rest.iter().all(|&b| b == 0)
        }
        Err(_) => {
            let text = String::from_utf8_lossy(text);
            out.put_varint(text.len() as u64);
            out.extend_from_slice(text.as_bytes());
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::definitions::{definition_by_name, definitions};
    use crate::wire::{FrameBuf, FrameHeader};
    use proptest::prelude::*;

    fn header(version: MavlinkVersion, id: u32) -> FrameHeader {
        FrameHeader { version, system: 1, component: 2, sequence: 3, message_id: id }
    }

    /// The frame that comes back from what was written.
    fn round_trip(frame: &FrameBuf, expect_raw: Option<bool>) -> Vec<u8> {
        let definition = crate::wire::definitions::definition(frame.as_ref().message_id()).unwrap();
        let plan = Plan::new(definition);
        let (mut out, mut payload) = (Vec::new(), [0; 255]);
        plan.encode(frame.as_ref(), Some(b"stamp"), &mut out);
        let kept = plan.decode(&out, &mut payload).unwrap();
        assert_eq!(kept.stamp, Some(&b"stamp"[..]));
        if let Some(expected) = expect_raw {
            assert_eq!(matches!(kept.frame, KeptFrame::Raw(_)), expected);
        }
        match kept.frame {
            KeptFrame::Plain(version, len) => {
                header(version, definition.id).frame(&payload[..len]).unwrap().bytes().to_vec()
            }
            KeptFrame::Raw(bytes) => bytes.to_vec(),
        }
    }

    proptest! {
        /// Whatever stands in a payload of whatever length, the frame comes back byte for byte.
        #[test]
        fn any_frame_comes_back(
            at in any::<prop::sample::Index>(),
            payload in prop::collection::vec(prop_oneof![3 => Just(0_u8), 5 => any::<u8>()], 0..=255),
            version in prop_oneof![Just(MavlinkVersion::V1), Just(MavlinkVersion::V2)],
            full in any::<bool>(),
        ) {
            let definition = &definitions()[at.index(definitions().len())];
            let len = if version == MavlinkVersion::V1 { definition.len_v1 } else { definition.len };
            let len = if full { payload.len().min(len.into()) } else { payload.len() };
            let Some(frame) = header(version, definition.id).frame(&payload[..len]) else { return Ok(()) };
            prop_assert_eq!(round_trip(&frame, None), frame.bytes());
        }

        #[test]
        fn any_bytes_are_decoded_or_refused(
            at in any::<prop::sample::Index>(),
            bytes in prop::collection::vec(any::<u8>(), 0..100),
        ) {
            let plan = Plan::new(&definitions()[at.index(definitions().len())]);
            let _ = plan.decode(&bytes, &mut [0; 255]);
        }
    }

    #[test]
    fn the_usual_frame_needs_no_copy_beside_its_fields() {
        let attitude = definition_by_name("ATTITUDE").unwrap();
        let payload: Vec<u8> = (1..=28).collect();
        let frame = header(MavlinkVersion::V2, attitude.id).frame(&payload).unwrap();
        assert_eq!(round_trip(&frame, Some(false)), frame.bytes());
        let frame = header(MavlinkVersion::V1, attitude.id).frame(&payload).unwrap();
        assert_eq!(round_trip(&frame, Some(false)), frame.bytes());
        // trailing zeros that nobody cut
        let frame = header(MavlinkVersion::V2, attitude.id).frame(&[0; 28]).unwrap();
        assert_eq!(round_trip(&frame, Some(true)), frame.bytes());
        let frame = header(MavlinkVersion::V2, attitude.id).frame(&[0; 1]).unwrap();
        assert_eq!(round_trip(&frame, Some(false)), frame.bytes());
    }

    #[test]
    fn bytes_behind_a_text_and_text_that_is_none_survive() {
        let text = definition_by_name("STATUSTEXT").unwrap();
        for content in [&b"\x06hi\0rest"[..], b"\x06\xFF\xFE", b"\x06plain"] {
            let frame = header(MavlinkVersion::V2, text.id).frame(content).unwrap();
            assert_eq!(round_trip(&frame, Some(content != b"\x06plain")), frame.bytes());
        }
    }
}
