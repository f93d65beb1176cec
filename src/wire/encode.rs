//! Messages to frames.

use super::catalog::message_info;
use super::checksum::checksum;
use super::frame::{CHECKSUM, FrameBuf, HEADER_V1, HEADER_V2, MAGIC_V1, MAGIC_V2};
use mavlink_core::{MavlinkVersion, MessageData, consts};

/// Why a message cannot be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    #[error("{name} has id {id}, and MAVLink 1 ends at 255")]
    NotInVersion1 { name: &'static str, id: u32 },
}

/// Makes frames in the name of one system and component, numbering them.
#[derive(Debug, Clone)]
pub struct Encoder {
    pub system: u8,
    pub component: u8,
    /// Sequence number of the next frame.
    pub sequence: u8,
}

impl Encoder {
    pub fn new(system: u8, component: u8) -> Self {
        Self { system, component, sequence: 0 }
    }

    /// A MAVLink 2 frame, unsigned, trailing zeros of the payload cut. Does not allocate.
    pub fn encode<M: MessageData>(&mut self, message: &M) -> FrameBuf {
        let [a, b, c, _] = M::ID.to_le_bytes();
        let sequence = self.next_sequence();
        FrameBuf::build(MavlinkVersion::V2, |bytes| {
            let mut payload = [0; consts::MAX_PAYLOAD_LEN];
            let len = message.ser(MavlinkVersion::V2, &mut payload);
            // the payload buffer is 255 bytes long, so its used length fits into a byte
            let header = [MAGIC_V2, len as u8, 0, 0, sequence, self.system, self.component, a, b, c];
            assemble(bytes, &header, &payload[..len], M::EXTRA_CRC)
        })
    }

    /// A MAVLink 1 frame, without extension fields. Does not allocate.
    ///
    /// # Errors
    /// The message's id does not fit into MAVLink 1.
    pub fn encode_v1<M: MessageData>(&mut self, message: &M) -> Result<FrameBuf, EncodeError> {
        let id = u8::try_from(M::ID).map_err(|_| EncodeError::NotInVersion1 { name: M::NAME, id: M::ID })?;
        let sequence = self.next_sequence();
        Ok(FrameBuf::build(MavlinkVersion::V1, |bytes| {
            let mut payload = [0; consts::MAX_PAYLOAD_LEN];
            let len = message.ser(MavlinkVersion::V1, &mut payload);
            let header = [MAGIC_V1, len as u8, sequence, self.system, self.component, id];
            assemble(bytes, &header, &payload[..len], M::EXTRA_CRC)
        }))
    }

    fn next_sequence(&mut self) -> u8 {
        let sequence = self.sequence;
        self.sequence = sequence.wrapping_add(1);
        sequence
    }
}

/// The header of a frame that is made of its parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameHeader {
    pub version: MavlinkVersion,
    pub system: u8,
    pub component: u8,
    pub sequence: u8,
    pub message_id: u32,
}

impl FrameHeader {
    /// The unsigned frame with this payload, taken as it is. `None` if no dialect here defines the message, if MAVLink 1
    /// cannot number it, or if the payload is too long. Does not allocate.
    pub fn frame(&self, payload: &[u8]) -> Option<FrameBuf> {
        let crc_extra = message_info(self.message_id)?.crc_extra;
        let len = u8::try_from(payload.len()).ok()?;
        let Self { version, system, component, sequence, .. } = *self;
        let [a, b, c, _] = self.message_id.to_le_bytes();
        match version {
            MavlinkVersion::V1 if self.message_id > 255 => None,
            MavlinkVersion::V1 => Some(FrameBuf::build(version, |bytes| {
                assemble(bytes, &[MAGIC_V1, len, sequence, system, component, a], payload, crc_extra)
            })),
            MavlinkVersion::V2 => Some(FrameBuf::build(version, |bytes| {
                let header = [MAGIC_V2, len, 0, 0, sequence, system, component, a, b, c];
                assemble(bytes, &header, payload, crc_extra)
            })),
        }
    }
}

/// Writes header, payload and checksum; returns the frame's length. The buffer holds the longest frame, signed, and
/// this one is unsigned.
fn assemble(bytes: &mut [u8], header: &[u8], payload: &[u8], crc_extra: u8) -> usize {
    debug_assert!(header.len() == HEADER_V1 || header.len() == HEADER_V2);
    let end = header.len() + payload.len();
    bytes[..header.len()].copy_from_slice(header);
    bytes[header.len()..end].copy_from_slice(payload);
    let crc = checksum(&bytes[1..end], crc_extra);
    bytes[end..end + CHECKSUM].copy_from_slice(&crc.to_le_bytes());
    end + CHECKSUM
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::dialect::{ardupilotmega, mavobserver};
    use crate::wire::{Check, Event, Parser, decode};

    fn only_frame(bytes: &[u8]) -> FrameBuf {
        let mut parser = Parser::new();
        parser.push(bytes);
        match parser.next() {
            Some(Event::Frame(frame)) => frame.into(),
            other => panic!("expected a frame, found {other:?}"),
        }
    }

    #[test]
    fn frames_decode_to_what_was_encoded() {
        let mut encoder = Encoder::new(7, 191);
        let wind = mavobserver::WIND_ESTIMATE_DATA {
            time_boot_us: 12_345_678,
            wind_ned: [1.0, -2.0, 0.5],
            half_width: [0.1, 0.2, f32::INFINITY],
            level: 0.99,
            guarantee: mavobserver::MavobserverGuarantee::MAVOBSERVER_GUARANTEE_STATISTICAL,
            verdict: mavobserver::MavobserverVerdict::MAVOBSERVER_VERDICT_SETTLING,
        };
        let sent = encoder.encode(&wind);
        let received = only_frame(sent.bytes());
        assert_eq!(received, sent);
        let frame = received.as_ref();
        assert_eq!((frame.system_id(), frame.component_id(), frame.sequence()), (7, 191, 0));
        assert_eq!(frame.check(), Check::Verified);
        assert_eq!(decode::<mavobserver::WIND_ESTIMATE_DATA>(frame), Some(wind));
        assert_eq!(decode::<mavobserver::WRENCH_ESTIMATE_DATA>(frame), None);
        assert_eq!(encoder.sequence, 1);
    }

    #[test]
    fn version_1_leaves_extension_fields_out() {
        let mut encoder = Encoder::new(1, 1);
        encoder.sequence = 255;
        let text = ardupilotmega::STATUSTEXT_DATA { text: "hello".into(), id: 9, ..Default::default() };
        let frame = encoder.encode_v1(&text).unwrap();
        assert_eq!(frame.as_ref().payload().len(), 51);
        assert_eq!(encoder.sequence, 0);
        let decoded: ardupilotmega::STATUSTEXT_DATA = decode(only_frame(frame.bytes()).as_ref()).unwrap();
        assert_eq!((decoded.text, decoded.id), (text.text, 0));
    }

    #[test]
    fn version_1_cannot_carry_high_ids() {
        let error = Encoder::new(1, 1).encode_v1(&mavobserver::WIND_ESTIMATE_DATA::default()).unwrap_err();
        assert_eq!(error.to_string(), "WIND_ESTIMATE has id 44101, and MAVLink 1 ends at 255");
    }
}
