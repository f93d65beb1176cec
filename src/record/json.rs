//! JSON messages, for readers that know no protobuf. Larger, slower, and without infinities: a recording in JSON cannot
//! be turned back into a telemetry log.

use crate::wire::definitions::{Definition, Field, Kind};
use crate::wire::{Fields, FrameRef};
use std::fmt::Write as _;
use std::io::Write as _;

/// How one message type is written.
#[derive(Debug)]
pub(super) struct JsonPlan {
    definition: &'static Definition,
}

impl JsonPlan {
    pub fn new(definition: &'static Definition) -> Self {
        Self { definition }
    }

    /// A JSON schema with units and the names of values in the descriptions.
    pub fn schema(&self) -> String {
        let properties: serde_json::Map<_, _> =
            self.definition.fields.iter().map(|f| (f.name.to_owned(), property(f))).collect();
        serde_json::json!({
            "title": format!("mavlink.{}", self.definition.name),
            "type": "object",
            "properties": properties,
        })
        .to_string()
    }

    /// Appends a frame of this message.
    pub fn encode(&self, frame: FrameRef<'_>, _stamp: Option<&[u8]>, out: &mut Vec<u8>) {
        let fields = frame.fields();
        for (i, field) in self.definition.fields.iter().enumerate() {
            // writing into memory does not fail
            let _ = write!(out, "{}\"{}\":", if i == 0 { '{' } else { ',' }, field.name);
            put(field, fields, out);
        }
        out.push(b'}');
    }
}

fn property(field: &Field) -> serde_json::Value {
    let mut description = field.unit.to_owned();
    if let Some(values) = field.values {
        let _ = write!(description, " {}:", values.name);
        for (value, name) in values.entries {
            let _ = write!(description, " {value}={name}");
        }
    }
    let kind = match field.kind {
        Kind::Char => "string",
        Kind::F32 | Kind::F64 => "number",
        _ => "integer",
    };
    let one = serde_json::json!({ "type": kind, "description": description.trim() });
    if field.array == 0 || field.kind == Kind::Char {
        return one;
    }
    serde_json::json!({ "type": "array", "items": one })
}

fn put(field: &Field, fields: Fields<'_>, out: &mut Vec<u8>) {
    let at = usize::from(field.offset);
    if field.kind == Kind::Char {
        let bytes: Vec<u8> = (at..at + field.size()).map(|i| fields.u8(i)).take_while(|&b| b != 0).collect();
        let text = String::from_utf8_lossy(&bytes);
        // a string always has a JSON form, and memory takes it
        let _ = serde_json::to_writer(out, text.as_ref());
        return;
    }
    if field.array == 0 {
        return number(field.kind, fields, at, out);
    }
    for i in 0..usize::from(field.array) {
        out.push(if i == 0 { b'[' } else { b',' });
        number(field.kind, fields, at + i * field.kind.size(), out);
    }
    out.push(b']');
}

/// Shortest form that reads back as the same number; what is no number is null.
fn number(kind: Kind, fields: Fields<'_>, at: usize, out: &mut Vec<u8>) {
    let _ = match kind {
        Kind::Char | Kind::U8 => write!(out, "{}", fields.u8(at)),
        Kind::I8 => write!(out, "{}", fields.i8(at)),
        Kind::U16 => write!(out, "{}", fields.u16(at)),
        Kind::I16 => write!(out, "{}", fields.i16(at)),
        Kind::U32 => write!(out, "{}", fields.u32(at)),
        Kind::I32 => write!(out, "{}", fields.i32(at)),
        Kind::U64 => write!(out, "{}", fields.u64(at)),
        Kind::I64 => write!(out, "{}", fields.i64(at)),
        Kind::F32 if fields.f32(at).is_finite() => write!(out, "{:?}", fields.f32(at)),
        Kind::F64 if fields.f64(at).is_finite() => write!(out, "{:?}", fields.f64(at)),
        Kind::F32 | Kind::F64 => write!(out, "null"),
    };
}
