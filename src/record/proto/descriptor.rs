//! Schemas: what a protobuf reader must know about a topic, complete in itself.

use crate::wire::definitions::{Definition, Enumeration, Field, Kind};
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::source_code_info::Location;
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto, FileDescriptorProto,
    FileDescriptorSet, SourceCodeInfo,
};

/// Field of every MAVLink message that holds the frame as received, where the other fields do not determine it.
pub(super) const RAW_FRAME: u32 = 1000;
/// Field that holds what stood in place of the receive time, where that is not the log time.
pub(super) const RAW_STAMP: u32 = 1001;

/// Builds the schema of one message type.
pub(in crate::record) struct SchemaBuilder {
    message: DescriptorProto,
    comments: Vec<Location>,
}

impl SchemaBuilder {
    pub fn new(name: &str) -> Self {
        Self { message: DescriptorProto { name: Some(name.to_owned()), ..Default::default() }, comments: Vec::new() }
    }

    pub fn field(self, number: u32, name: &str, kind: Type) -> Self {
        self.add(number, name, kind, Label::Optional, None)
    }

    pub fn repeated(self, number: u32, name: &str, kind: Type) -> Self {
        self.add(number, name, kind, Label::Repeated, None)
    }

    /// A field whose type is `type_name`, with its package and a leading dot.
    pub fn typed(self, number: u32, name: &str, kind: Type, type_name: &str) -> Self {
        self.add(number, name, kind, Label::Optional, Some(type_name))
    }

    pub fn repeated_typed(self, number: u32, name: &str, kind: Type, type_name: &str) -> Self {
        self.add(number, name, kind, Label::Repeated, Some(type_name))
    }

    /// Explains the last field.
    pub fn comment(mut self, text: &str) -> Self {
        const FIELD_IN_MESSAGE: [i32; 3] = [4, 0, 2];
        if !text.is_empty() {
            let last = self.message.field.len().saturating_sub(1) as i32;
            self.comments.push(Location {
                path: FIELD_IN_MESSAGE.into_iter().chain([last]).collect(),
                span: vec![0, 0, 0],
                trailing_comments: Some(format!(" {text}\n")),
                ..Default::default()
            });
        }
        self
    }

    /// Adds an enum inside the message, once. An open enum begins with zero, so that value gets a name even where the
    /// dialect has none; values beyond 32 bits have no place in protobuf.
    pub fn enumeration(mut self, name: &str, entries: impl Iterator<Item = (u64, String)>) -> Self {
        if self.message.enum_type.iter().any(|e| e.name() == name) {
            return self;
        }
        let value = |number, name: String| EnumValueDescriptorProto {
            name: Some(name),
            number: Some(number),
            ..Default::default()
        };
        let mut values: Vec<_> =
            entries.filter_map(|(number, name)| Some(value(i32::try_from(number).ok()?, name))).collect();
        if values.first().is_none_or(|first| first.number() != 0) {
            values.insert(0, value(0, format!("{name}_UNNAMED_0")));
        }
        self.message.enum_type.push(EnumDescriptorProto {
            name: Some(name.to_owned()),
            value: values,
            ..Default::default()
        });
        self
    }

    fn add(mut self, number: u32, name: &str, kind: Type, label: Label, type_name: Option<&str>) -> Self {
        self.message.field.push(FieldDescriptorProto {
            name: Some(name.to_owned()),
            number: Some(number as i32),
            label: Some(label.into()),
            r#type: Some(kind.into()),
            type_name: type_name.map(str::to_owned),
            ..Default::default()
        });
        self
    }

    /// The file that defines the message.
    pub fn file(self, package: &str, dependencies: &[&str]) -> FileDescriptorProto {
        let name = self.message.name().to_owned();
        FileDescriptorProto {
            name: Some(format!("{package}/{name}.proto")),
            package: Some(package.to_owned()),
            dependency: dependencies.iter().map(|&d| d.to_owned()).collect(),
            message_type: vec![self.message],
            source_code_info: (!self.comments.is_empty()).then_some(SourceCodeInfo { location: self.comments }),
            syntax: Some("proto3".to_owned()),
            ..Default::default()
        }
    }

    /// The schema as MCAP wants it: every file it needs, dependencies first.
    pub fn encode(self, package: &str) -> Vec<u8> {
        FileDescriptorSet { file: vec![self.file(package, &[])] }.encode_to_vec()
    }
}

/// The schema of a MAVLink message: its fields in the order of the XML, numbered from one, under their names.
///
/// Fields of an enum have that enum's type, so readers show names; enums are open, so values without a name survive.
/// Sums of flags stay integers, with their enum defined beside them. Units stand in the comments.
pub fn message_schema(definition: &Definition) -> Vec<u8> {
    let mut schema = SchemaBuilder::new(definition.name);
    for (number, field) in (1..).zip(definition.fields) {
        if let Some(values) = field.values {
            let entries = values.entries.iter().map(|&(value, name)| (value, name.to_owned()));
            schema = schema.enumeration(values.name, entries);
        }
        let (kind, repeated) = proto_type(field);
        let type_name = (kind == Type::Enum)
            .then_some(field.values)
            .flatten()
            .map(|v: &Enumeration| format!(".mavlink.{}.{}", definition.name, v.name));
        let label = if repeated { Label::Repeated } else { Label::Optional };
        schema = schema.add(number, field.name, kind, label, type_name.as_deref()).comment(field.unit);
    }
    schema
        .field(RAW_FRAME, "raw_frame", Type::Bytes)
        .comment("the frame as received, if the fields above do not determine it; 0xFE alone for plain MAVLink 1")
        .field(RAW_STAMP, "raw_stamp", Type::Bytes)
        .comment("what stood in place of the receive time, if that is not the log time")
        .encode("mavlink")
}

/// Protobuf type of a field, and whether it is a list. Four and eight bytes keep their fixed width.
fn proto_type(field: &Field) -> (Type, bool) {
    let list = field.array > 0;
    if is_enum(field) {
        return (Type::Enum, list);
    }
    match field.kind {
        Kind::Char => (Type::String, false),
        Kind::U8 if list => (Type::Bytes, false),
        Kind::U8 | Kind::U16 => (Type::Uint32, list),
        Kind::I8 | Kind::I16 => (Type::Sint32, list),
        Kind::U32 => (Type::Fixed32, list),
        Kind::I32 => (Type::Sfixed32, list),
        Kind::U64 => (Type::Fixed64, list),
        Kind::I64 => (Type::Sfixed64, list),
        Kind::F32 => (Type::Float, list),
        Kind::F64 => (Type::Double, list),
    }
}

/// Whether the field becomes a protobuf enum: its values must fit 32 bits, and be one of the names rather than a sum.
pub(super) fn is_enum(field: &Field) -> bool {
    let fits = matches!(field.kind, Kind::U8 | Kind::I8 | Kind::U16 | Kind::I16);
    field.values.is_some() && fits && !field.bitmask
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::definitions::{definition_by_name, definitions};
    use std::collections::BTreeSet;

    fn descriptor(definition: &Definition) -> DescriptorProto {
        let set = FileDescriptorSet::decode(message_schema(definition).as_slice()).unwrap();
        assert_eq!(set.file.len(), 1, "complete in itself");
        set.file[0].message_type[0].clone()
    }

    #[test]
    fn every_message_has_a_schema_that_readers_accept() {
        for definition in definitions() {
            let message = descriptor(definition);
            assert_eq!(message.field.len(), definition.fields.len() + 2);
            // all names inside one message share one space
            let mut names = BTreeSet::new();
            for name in message.field.iter().map(|f| f.name().to_owned()) {
                assert!(names.insert(name.clone()), "{}: {name} twice", definition.name);
            }
            for values in &message.enum_type {
                assert_eq!(values.value[0].number(), 0);
                for name in values.value.iter().map(|v| v.name()).chain([values.name()]) {
                    assert!(names.insert(name.to_owned()), "{}: {name} twice", definition.name);
                }
            }
        }
    }

    #[test]
    fn enums_and_units_are_in_the_schema() {
        let set =
            FileDescriptorSet::decode(message_schema(definition_by_name("GPS_RAW_INT").unwrap()).as_slice()).unwrap();
        let file = &set.file[0];
        let fix = &file.message_type[0].field[1];
        assert_eq!(
            (fix.name(), fix.r#type(), fix.type_name()),
            ("fix_type", Type::Enum, ".mavlink.GPS_RAW_INT.GPS_FIX_TYPE")
        );
        let units: Vec<_> = file.source_code_info.iter().flat_map(|s| &s.location).collect();
        assert!(units.iter().any(|l| l.path == [4, 0, 2, 2] && l.trailing_comments() == " degE7\n"), "{units:?}");
    }
}
