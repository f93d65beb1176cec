use super::super::proto::{PutProto, SchemaBuilder};
use ardupilot_binlog::{Entry, FieldValue};
use prost_types::field_descriptor_proto::Type;
use px4_ulog::stream_parser::model::{DataMessage, FlattenedField, FlattenedFieldType};

/// Seconds from 1970 to the beginning of GPS time, its weeks' length, and how far it is ahead of UTC since 2017.
const GPS_EPOCH_S: u64 = 315_964_800;
const WEEK_S: u64 = 604_800;
const LEAP_S: u64 = 18;
/// No log is older than this, µs since 1970.
const PLAUSIBLE_UNIX_US: u64 = 1_000_000_000_000_000;

/// One message of an autopilot's own log.
#[derive(Clone, Copy)]
pub enum Row<'a> {
    Ulog(&'a DataMessage<'a>),
    Dataflash(&'a Entry),
}

impl Row<'_> {
    /// Name of the message.
    pub fn name(&self) -> &str {
        match self {
            Self::Ulog(m) => m.flattened_format.message_name(),
            Self::Dataflash(e) => &e.name,
        }
    }

    /// Which of several sensors or sources.
    pub fn instance(&self) -> u8 {
        match self {
            Self::Ulog(m) => m.multi_id.value(),
            Self::Dataflash(_) => ["I", "Inst", "C"].iter().find_map(|n| self.number(n)).unwrap_or(0.0) as u8,
        }
    }

    /// Time since boot, µs.
    pub fn boot_us(&self) -> Option<u64> {
        match self {
            Self::Ulog(m) => {
                let at = usize::from(m.flattened_format.timestamp_field.as_ref()?.offset);
                Some(u64::from_le_bytes(*m.data.get(at..)?.first_chunk()?))
            }
            Self::Dataflash(e) => e.timestamp_usec,
        }
    }

    /// A field's value; `None` if there is no such field, or if it is a text.
    pub fn number(&self, name: &str) -> Option<f64> {
        match self {
            Self::Ulog(m) => {
                let field = m.flattened_format.field_iter().find(|f| f.flattened_field_name == name)?;
                number(field, m.data)
            }
            Self::Dataflash(e) => e.get_f64(name),
        }
    }

    /// The fields `name[0]`, `name[1]`, … of a ULog message, or `None` if one is missing.
    pub fn array<const N: usize>(&self, name: &str) -> Option<[f64; N]> {
        let Self::Ulog(m) = self else { return None };
        let fields = || m.flattened_format.field_iter();
        let first = fields().position(|f| f.flattened_field_name.strip_suffix("[0]") == Some(name))?;
        let mut values = fields().skip(first).map(|f| number(f, m.data));
        let mut out = [0.0; N];
        for x in &mut out {
            *x = values.next()??;
        }
        Some(out)
    }

    /// UTC that a fix tells, µs since 1970.
    pub(super) fn unix_us(&self) -> Option<u64> {
        let unix = match (self.name(), self) {
            ("vehicle_gps_position" | "sensor_gps", _) => self.number("time_utc_usec")? as u64,
            ("GPS", Self::Dataflash(e)) => {
                let (week, ms) = (e.get_u64("GWk")?, e.get_u64("GMS")?);
                let seconds = (GPS_EPOCH_S - LEAP_S).checked_add(week.checked_mul(WEEK_S)?)?;
                // a receiver without time counts weeks from zero
                seconds.checked_mul(1_000_000)?.checked_add(ms.checked_mul(1_000)?)?
            }
            _ => return None,
        };
        (unix > PLAUSIBLE_UNIX_US).then_some(unix)
    }

    /// Where it stands in a recording.
    pub(in crate::record) fn topic(&self) -> String {
        match self {
            Self::Ulog(_) => format!("/ulog/{}/{}", self.name(), self.instance()),
            Self::Dataflash(_) => format!("/dataflash/{}/{}", self.name(), self.instance()),
        }
    }

    /// Name and package of its type.
    pub(in crate::record) fn type_name(&self) -> (String, &'static str) {
        let package = if matches!(self, Self::Ulog(_)) { "ulog" } else { "dataflash" };
        (identifier(self.name()), package)
    }

    pub(in crate::record) fn schema(&self) -> Vec<u8> {
        let (name, package) = self.type_name();
        let mut schema = SchemaBuilder::new(&name);
        match self {
            Self::Ulog(m) => {
                for (number, field) in (1..).zip(m.flattened_format.field_iter()) {
                    let kind = match field.field_type {
                        FlattenedFieldType::Float => Type::Float,
                        FlattenedFieldType::Double => Type::Double,
                        FlattenedFieldType::Bool => Type::Bool,
                        FlattenedFieldType::Int8
                        | FlattenedFieldType::Int16
                        | FlattenedFieldType::Int32
                        | FlattenedFieldType::Int64 => Type::Sint64,
                        _ => Type::Uint64,
                    };
                    schema = schema.field(number, &identifier(&field.flattened_field_name), kind);
                }
            }
            Self::Dataflash(e) => {
                for (number, (label, value)) in (1..).zip(e.fields()) {
                    let label = identifier(label);
                    schema = match value {
                        FieldValue::Int(_) => schema.field(number, &label, Type::Sint64),
                        FieldValue::Uint(_) => schema.field(number, &label, Type::Uint64),
                        FieldValue::Float(_) => schema.field(number, &label, Type::Double),
                        FieldValue::String(_) => schema.field(number, &label, Type::String),
                        FieldValue::Array(_) => schema.repeated(number, &label, Type::Sint64),
                    };
                }
            }
        }
        schema.encode(package)
    }

    pub(in crate::record) fn encode(&self, out: &mut Vec<u8>) {
        match self {
            Self::Ulog(m) => {
                for (number, field) in (1..).zip(m.flattened_format.field_iter()) {
                    put_ulog(out, number, field, m.data);
                }
            }
            Self::Dataflash(e) => {
                for (number, value) in (1..).zip(e.values()) {
                    match value {
                        FieldValue::Int(x) => out.put_i64(number, *x),
                        FieldValue::Uint(x) => out.put_u64(number, *x),
                        FieldValue::Float(x) => out.put_f64(number, *x),
                        FieldValue::String(x) => out.put_bytes(number, x.as_bytes()),
                        FieldValue::Array(list) => list.iter().for_each(|x| out.put_i64(number, (*x).into())),
                    }
                }
            }
        }
    }
}

/// The little-endian bytes of a field, as far as the message reaches.
fn raw<const N: usize>(field: &FlattenedField, data: &[u8]) -> Option<[u8; N]> {
    data.get(usize::from(field.offset)..)?.first_chunk().copied()
}

fn number(field: &FlattenedField, data: &[u8]) -> Option<f64> {
    Some(match field.field_type {
        FlattenedFieldType::Int8 => i8::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::UInt8 | FlattenedFieldType::Bool => u8::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::Int16 => i16::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::UInt16 => u16::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::Int32 => i32::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::UInt32 => u32::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::Int64 => i64::from_le_bytes(raw(field, data)?) as f64,
        FlattenedFieldType::UInt64 => u64::from_le_bytes(raw(field, data)?) as f64,
        FlattenedFieldType::Float => f32::from_le_bytes(raw(field, data)?).into(),
        FlattenedFieldType::Double => f64::from_le_bytes(raw(field, data)?),
        FlattenedFieldType::Char => return None,
    })
}

fn put_ulog(out: &mut Vec<u8>, number: u32, field: &FlattenedField, data: &[u8]) {
    let unsigned = |bytes: Option<u64>| bytes.unwrap_or(0);
    match field.field_type {
        FlattenedFieldType::Float => out.put_f32(number, f32::from_le_bytes(raw(field, data).unwrap_or_default())),
        FlattenedFieldType::Double => out.put_f64(number, f64::from_le_bytes(raw(field, data).unwrap_or_default())),
        FlattenedFieldType::Int8 => out.put_i64(number, i8::from_le_bytes(raw(field, data).unwrap_or_default()).into()),
        FlattenedFieldType::Int16 => {
            out.put_i64(number, i16::from_le_bytes(raw(field, data).unwrap_or_default()).into())
        }
        FlattenedFieldType::Int32 => {
            out.put_i64(number, i32::from_le_bytes(raw(field, data).unwrap_or_default()).into())
        }
        FlattenedFieldType::Int64 => out.put_i64(number, i64::from_le_bytes(raw(field, data).unwrap_or_default())),
        FlattenedFieldType::UInt16 => {
            out.put_u64(number, u16::from_le_bytes(raw(field, data).unwrap_or_default()).into())
        }
        FlattenedFieldType::UInt32 => {
            out.put_u64(number, u32::from_le_bytes(raw(field, data).unwrap_or_default()).into())
        }
        FlattenedFieldType::UInt64 => out.put_u64(number, unsigned(raw(field, data).map(u64::from_le_bytes))),
        FlattenedFieldType::UInt8 | FlattenedFieldType::Bool | FlattenedFieldType::Char => {
            out.put_u64(number, unsigned(raw::<1>(field, data).map(|[b]| b.into())));
        }
    }
}

/// `gyro_rad[0]` as protobuf names a field: `gyro_rad_0`.
fn identifier(name: &str) -> String {
    let mut out: String =
        name.chars().filter(|&c| c != ']').map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    if out.starts_with(|c: char| c.is_ascii_digit()) {
        out.insert(0, '_');
    }
    out
}
