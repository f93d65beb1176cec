//! What the dialects say about every message, as data: fields, types, offsets, units, enums.
//!
//! The build script makes these tables from `dialects/`. They serve where the generated types cannot: schemas of
//! recordings, and payloads with enum values that this version of the dialect does not know.

use std::collections::HashMap;
use std::sync::LazyLock;

include!(concat!(env!("OUT_DIR"), "/definitions.rs"));

/// One message.
#[derive(Debug, PartialEq)]
pub struct Definition {
    pub id: u32,
    pub name: &'static str,
    /// The XML file that defines it, such as `common`.
    pub dialect: &'static str,
    /// Payload length in MAVLink 1, which has no extension fields.
    pub len_v1: u8,
    /// Payload length with extension fields, before MAVLink 2 cuts trailing zeros.
    pub len: u8,
    /// In the order of the XML, which is not that of the wire.
    pub fields: &'static [Field],
}

/// One field of a message.
#[derive(Debug, PartialEq)]
pub struct Field {
    pub name: &'static str,
    pub kind: Kind,
    /// Number of elements; zero if it is no array.
    pub array: u8,
    /// Where it begins in the payload.
    pub offset: u8,
    pub extension: bool,
    /// As in the XML, such as `cm/s` or `degE7`; may be empty.
    pub unit: &'static str,
    /// The names of its values.
    pub values: Option<&'static Enumeration>,
    /// The value is a sum of entries of [`Self::values`].
    pub bitmask: bool,
}

/// Type of a field or of its elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Char,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

/// Names for values.
#[derive(Debug, PartialEq)]
pub struct Enumeration {
    pub name: &'static str,
    pub bitmask: bool,
    /// By rising value.
    pub entries: &'static [(u64, &'static str)],
}

impl Kind {
    /// Bytes on the wire.
    pub fn size(self) -> usize {
        match self {
            Self::Char | Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl Field {
    /// Bytes on the wire, of all elements.
    pub fn size(&self) -> usize {
        self.kind.size() * usize::from(self.array.max(1))
    }
}

/// Every message of the bundled dialects and ours, by rising id.
pub fn definitions() -> &'static [Definition] {
    MESSAGES
}

/// The definition of a message, if a dialect here has it.
pub fn definition(id: u32) -> Option<&'static Definition> {
    let at = MESSAGES.binary_search_by_key(&id, |d| d.id).ok()?;
    MESSAGES.get(at)
}

/// The definition of the message with this name.
pub fn definition_by_name(name: &str) -> Option<&'static Definition> {
    static BY_NAME: LazyLock<HashMap<&str, &Definition>> =
        LazyLock::new(|| MESSAGES.iter().map(|d| (d.name, d)).collect());
    BY_NAME.get(name).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::message_info;

    /// The checksum seed by MAVLink's rule: names and types in wire order, extension fields left out.
    fn seed(definition: &Definition) -> u8 {
        let mut fields: Vec<_> = definition.fields.iter().filter(|f| !f.extension).collect();
        fields.sort_by_key(|f| f.offset);
        let mut text = format!("{} ", definition.name).into_bytes();
        for field in fields {
            let kind = match field.kind {
                Kind::Char => "char",
                Kind::U8 => "uint8_t",
                Kind::I8 => "int8_t",
                Kind::U16 => "uint16_t",
                Kind::I16 => "int16_t",
                Kind::U32 => "uint32_t",
                Kind::I32 => "int32_t",
                Kind::U64 => "uint64_t",
                Kind::I64 => "int64_t",
                Kind::F32 => "float",
                Kind::F64 => "double",
            };
            text.extend(format!("{kind} {} ", field.name).bytes());
            text.extend((field.array > 0).then_some(field.array));
        }
        let (last, rest) = text.split_last().unwrap();
        let crc = mavlink_core::calculate_crc(rest, *last);
        (crc & 0xFF) as u8 ^ (crc >> 8) as u8
    }

    #[test]
    fn tables_and_generated_types_agree_on_every_message() {
        for definition in definitions() {
            let info = message_info(definition.id).unwrap_or_else(|| panic!("{} has no type", definition.name));
            assert_eq!(info.name, definition.name);
            assert_eq!(info.crc_extra, seed(definition), "{}", definition.name);
            // the one message whose target goes by another name
            let target = if definition.name == "MANUAL_CONTROL" { "target" } else { "target_system" };
            let offset = definition.fields.iter().find(|f| f.name == target).map(|f| f.offset);
            assert_eq!(info.target_system, offset, "{}", definition.name);
        }
        let known = (0..1 << 16).filter(|&id| message_info(id).is_some()).count();
        assert_eq!(known, definitions().len(), "a generated type has no definition");
    }

    #[test]
    fn layout_is_that_of_the_wire() {
        let heartbeat = definition_by_name("HEARTBEAT").unwrap();
        assert_eq!((heartbeat.id, heartbeat.len_v1, heartbeat.len), (0, 9, 9));
        let offsets: Vec<_> = heartbeat.fields.iter().map(|f| (f.name, f.offset)).collect();
        assert_eq!(offsets[0], ("type", 4));
        assert_eq!(offsets[3], ("custom_mode", 0));
        let kind = heartbeat.fields[0].values.unwrap();
        assert_eq!((kind.name, kind.entries[2]), ("MAV_TYPE", (2, "MAV_TYPE_QUADROTOR")));
        assert!(heartbeat.fields[2].bitmask);
        let gps = definition(24).unwrap();
        assert_eq!((gps.len_v1, gps.len), (30, 52));
        assert_eq!(gps.fields[2].unit, "degE7");
        assert!(definitions().iter().all(|d| d.fields.iter().all(|f| f.offset as usize + f.size() <= d.len as usize)));
    }
}
