//! What the framing must know about each message: its CRC seed, its length, where its target stands.

use super::dialect::{ardupilotmega, development, mavobserver};
use mavlink_core::{MavlinkVersion, Message, consts};
use std::sync::LazyLock;

/// Message ids are 24 bits wide, but no dialect here goes beyond 16; the catalogue test holds the bundled XML to that.
const ID_BITS: u32 = 16;
const PAGE_BITS: u32 = 8;
const PAGE: usize = 1 << PAGE_BITS;

/// What the dialects say about one message id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageInfo {
    /// Name in the XML, such as `HEARTBEAT`.
    pub name: &'static str,
    /// Seed that makes the checksum depend on the message's definition.
    pub crc_extra: u8,
    /// Payload length in bytes, extension fields included.
    pub len: u8,
    /// Payload length in bytes in MAVLink 1, which carries no extension fields.
    pub v1_len: u8,
    /// Payload offset of `target_system`, if the message has one.
    pub target_system: Option<u8>,
    /// Payload offset of `target_component`, if the message has one.
    pub target_component: Option<u8>,
}

/// Looks a message up in ardupilotmega, then development, then our own dialect.
pub fn message_info(id: u32) -> Option<&'static MessageInfo> {
    CATALOG.get(id)
}

static CATALOG: LazyLock<Catalog> = LazyLock::new(Catalog::build);

/// Two-level table: ids come in clusters, so most pages are absent.
struct Catalog {
    pages: Vec<Option<Box<[Option<MessageInfo>; PAGE]>>>,
}

impl Catalog {
    fn build() -> Self {
        let pages = (0..1 << (ID_BITS - PAGE_BITS)).map(build_page).collect();
        Self { pages }
    }

    fn get(&self, id: u32) -> Option<&MessageInfo> {
        let page = self.pages.get((id >> PAGE_BITS) as usize)?.as_deref()?;
        page[id as usize % PAGE].as_ref()
    }
}

fn build_page(page: u32) -> Option<Box<[Option<MessageInfo>; PAGE]>> {
    let infos: [Option<MessageInfo>; PAGE] = std::array::from_fn(|i| {
        let id = (page << PAGE_BITS) + i as u32;
        describe::<ardupilotmega::MavMessage>(id)
            .or_else(|| describe::<development::MavMessage>(id))
            .or_else(|| describe::<mavobserver::MavMessage>(id))
    });
    infos.iter().any(Option::is_some).then(|| Box::new(infos))
}

/// The generated code holds no offsets, so they are found by writing a mark into the field of a default message and
/// looking where it comes out.
fn describe<M: Message>(id: u32) -> Option<MessageInfo> {
    const MARK: u8 = 0xA5;
    let mut message = M::default_message_from_id(id)?;
    let serialize = |message: &M| {
        let mut payload = [0; consts::MAX_PAYLOAD_LEN];
        // MAVLink 1 serialisation does not cut trailing zeros, so the length is that of the whole payload.
        let len = message.ser(MavlinkVersion::V1, &mut payload);
        (payload, len)
    };
    let (plain, len) = serialize(&message);
    let offset_of_mark = |message: &M| {
        let (marked, _) = serialize(message);
        // an offset within a payload of at most 255 bytes fits into a byte
        plain.iter().zip(&marked).position(|(a, b)| a != b).map(|offset| offset as u8)
    };
    let target_system =
        message.target_system_id_mut().map(|field| *field = MARK).and_then(|()| offset_of_mark(&message));
    let mut message = M::default_message_from_id(id)?;
    let target_component =
        message.target_component_id_mut().map(|field| *field = MARK).and_then(|()| offset_of_mark(&message));
    let len = len as u8; // at most MAX_PAYLOAD_LEN = 255
    Some(MessageInfo {
        name: message.message_name(),
        crc_extra: M::extra_crc(id),
        len,
        v1_len: base_len(id).unwrap_or(len),
        target_system,
        target_component,
    })
}

/// Payload length without extension fields, for the messages that have some and fit into MAVLink 1 (id below 256).
/// The generated code does not tell; the catalogue test holds this table against the bundled XML.
fn base_len(id: u32) -> Option<u8> {
    let i = BASE_LENGTHS.binary_search_by_key(&id, |&(id, _)| u32::from(id)).ok()?;
    BASE_LENGTHS.get(i).map(|&(_, len)| len)
}

#[rustfmt::skip]
const BASE_LENGTHS: [(u8, u8); 57] = [
    (1, 31), (24, 30), (26, 22), (27, 26), (29, 14), (31, 32), (36, 21), (37, 6), (38, 6), (39, 37), (40, 4), (42, 2),
    (43, 2), (44, 4), (45, 2), (47, 3), (48, 13), (49, 12), (51, 4), (69, 11), (70, 18), (73, 37), (77, 3), (82, 39),
    (100, 26), (101, 32), (102, 32), (103, 20), (104, 32), (105, 62), (107, 64), (108, 84), (111, 16), (113, 36),
    (116, 22), (124, 35), (126, 79), (129, 22), (132, 14), (137, 14), (138, 36), (143, 14), (147, 36), (148, 60),
    (149, 30), (152, 4), (158, 14), (162, 8), (180, 45), (192, 44), (193, 22), (194, 25), (225, 65), (232, 63),
    (242, 52), (243, 53), (253, 51),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knows_every_dialect() {
        let heartbeat = message_info(0).unwrap();
        assert_eq!((heartbeat.name, heartbeat.crc_extra, heartbeat.len), ("HEARTBEAT", 50, 9));
        assert_eq!(message_info(168).unwrap().name, "WIND");
        assert_eq!(message_info(44100).unwrap().name, "WRENCH_ESTIMATE");
        assert_eq!(message_info(65_535), None);
        assert_eq!(message_info(0xFF_FFFF), None);
    }

    #[test]
    fn finds_targets() {
        // COMMAND_LONG: seven floats and a u16, then the target.
        let command = message_info(76).unwrap();
        assert_eq!((command.target_system, command.target_component), (Some(30), Some(31)));
        // SET_MODE names a system only, HEARTBEAT nobody.
        let set_mode = message_info(11).unwrap();
        assert_eq!((set_mode.target_system, set_mode.target_component), (Some(4), None));
        assert_eq!(message_info(0).unwrap().target_system, None);
    }

    #[test]
    fn mavlink_1_has_no_extension_fields() {
        let status_text = message_info(253).unwrap();
        assert_eq!((status_text.v1_len, status_text.len), (51, 54));
    }
}
