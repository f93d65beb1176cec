//! What the framing must know about each message: its CRC seed, and where its target stands.

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
    /// Payload offset of `target_system`, if the message has one.
    pub target_system: Option<u8>,
    /// Payload offset of `target_component`, if the message has one.
    pub target_component: Option<u8>,
}

/// Looks a message up in ardupilotmega, then development, then our own dialect.
pub fn message_info(id: u32) -> Option<&'static MessageInfo> {
    CATALOG.get(id)
}

/// Every message that a dialect here defines, by id.
pub fn messages() -> impl Iterator<Item = (u32, &'static MessageInfo)> {
    (0..1 << ID_BITS).filter_map(|id| Some((id, message_info(id)?)))
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
    let serialize = |message: &M| {
        let mut payload = [0; consts::MAX_PAYLOAD_LEN];
        // MAVLink 2, for a target may stand in an extension field; that it cuts zeros does not matter here
        message.ser(MavlinkVersion::V2, &mut payload);
        payload
    };
    let plain = M::default_message_from_id(id)?;
    let unmarked = serialize(&plain);
    let offset = |field: fn(&mut M) -> Option<&mut u8>| {
        let mut message = M::default_message_from_id(id)?;
        *field(&mut message)? = MARK;
        // an offset within 255 bytes fits into a byte
        unmarked.iter().zip(serialize(&message)).position(|(&a, b)| a != b).map(|at| at as u8)
    };
    Some(MessageInfo {
        name: plain.message_name(),
        crc_extra: M::extra_crc(id),
        target_system: offset(M::target_system_id_mut),
        target_component: offset(M::target_component_id_mut),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knows_every_dialect() {
        let heartbeat = message_info(0).unwrap();
        assert_eq!((heartbeat.name, heartbeat.crc_extra), ("HEARTBEAT", 50));
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
        // COMMAND_ACK's target is an extension field.
        assert_eq!(message_info(77).unwrap().target_system, Some(8));
    }

    /// Where two dialects define the same id, it does not matter which one answers.
    #[test]
    fn the_dialects_agree() {
        for id in 0..1 << ID_BITS {
            let first = describe::<ardupilotmega::MavMessage>(id);
            let second = describe::<development::MavMessage>(id);
            if let (Some(first), Some(second)) = (first, second) {
                assert_eq!(first, second);
            }
            let ours = describe::<mavobserver::MavMessage>(id);
            assert!(ours.is_none() || (first.is_none() && second.is_none()), "{id} is taken");
        }
    }
}
