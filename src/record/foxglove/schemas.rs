//! Foxglove's published message types, as far as they are used here, with their field numbers.

use super::super::proto::SchemaBuilder;
use prost::Message;
use prost_types::field_descriptor_proto::Type;
use prost_types::{FileDescriptorProto, FileDescriptorSet};

pub(super) const PACKAGE: &str = "foxglove";
const TIMESTAMP: &str = ".google.protobuf.Timestamp";
const TIME_FILE: &str = "google/protobuf/timestamp.proto";
const DURATION_FILE: &str = "google/protobuf/duration.proto";

fn set(files: Vec<FileDescriptorProto>) -> Vec<u8> {
    FileDescriptorSet { file: files }.encode_to_vec()
}

/// Seconds and nanoseconds: the shape of both Timestamp and Duration.
fn well_known(name: &str, file: &str) -> FileDescriptorProto {
    let schema = SchemaBuilder::new(name).field(1, "seconds", Type::Int64).field(2, "nanos", Type::Int32);
    FileDescriptorProto { name: Some(file.to_owned()), ..schema.file("google.protobuf", &[]) }
}

fn numbers(name: &str, fields: &[&str]) -> FileDescriptorProto {
    let start = SchemaBuilder::new(name);
    let all = (1..).zip(fields).fold(start, |s, (number, field)| s.field(number, field, Type::Double));
    all.file(PACKAGE, &[])
}

fn vector3() -> FileDescriptorProto {
    numbers("Vector3", &["x", "y", "z"])
}

fn quaternion() -> FileDescriptorProto {
    numbers("Quaternion", &["x", "y", "z", "w"])
}

fn named(number: u64, names: &[&str]) -> impl Iterator<Item = (u64, String)> {
    (number..).zip(names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>())
}

pub(super) fn location_fix() -> Vec<u8> {
    let schema = SchemaBuilder::new("LocationFix")
        .field(1, "latitude", Type::Double)
        .field(2, "longitude", Type::Double)
        .field(3, "altitude", Type::Double)
        .repeated(4, "position_covariance", Type::Double)
        .enumeration("PositionCovarianceType", named(0, &["UNKNOWN", "APPROXIMATED", "DIAGONAL_KNOWN", "KNOWN"]))
        .typed(5, "position_covariance_type", Type::Enum, ".foxglove.LocationFix.PositionCovarianceType")
        .typed(6, "timestamp", Type::Message, TIMESTAMP)
        .field(7, "frame_id", Type::String);
    set(vec![well_known("Timestamp", TIME_FILE), schema.file(PACKAGE, &[TIME_FILE])])
}

pub(super) fn frame_transform() -> Vec<u8> {
    let schema = SchemaBuilder::new("FrameTransform")
        .typed(1, "timestamp", Type::Message, TIMESTAMP)
        .field(2, "parent_frame_id", Type::String)
        .field(3, "child_frame_id", Type::String)
        .typed(4, "translation", Type::Message, ".foxglove.Vector3")
        .typed(5, "rotation", Type::Message, ".foxglove.Quaternion");
    let file = schema.file(PACKAGE, &[TIME_FILE, "foxglove/Vector3.proto", "foxglove/Quaternion.proto"]);
    set(vec![well_known("Timestamp", TIME_FILE), vector3(), quaternion(), file])
}

pub(super) fn log() -> Vec<u8> {
    let schema = SchemaBuilder::new("Log")
        .typed(1, "timestamp", Type::Message, TIMESTAMP)
        .enumeration("Level", named(0, &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"]))
        .typed(2, "level", Type::Enum, ".foxglove.Log.Level")
        .field(3, "message", Type::String)
        .field(4, "name", Type::String)
        .field(5, "file", Type::String)
        .field(6, "line", Type::Fixed32);
    set(vec![well_known("Timestamp", TIME_FILE), schema.file(PACKAGE, &[TIME_FILE])])
}

/// Of the scene's entities only arrows: readers skip the fields that are left out.
pub(super) fn scene_update() -> Vec<u8> {
    let color = numbers("Color", &["r", "g", "b", "a"]);
    let pose = SchemaBuilder::new("Pose")
        .typed(1, "position", Type::Message, ".foxglove.Vector3")
        .typed(2, "orientation", Type::Message, ".foxglove.Quaternion")
        .file(PACKAGE, &["foxglove/Vector3.proto", "foxglove/Quaternion.proto"]);
    let arrow = SchemaBuilder::new("ArrowPrimitive")
        .typed(1, "pose", Type::Message, ".foxglove.Pose")
        .field(2, "shaft_length", Type::Double)
        .field(3, "shaft_diameter", Type::Double)
        .field(4, "head_length", Type::Double)
        .field(5, "head_diameter", Type::Double)
        .typed(6, "color", Type::Message, ".foxglove.Color")
        .file(PACKAGE, &["foxglove/Color.proto", "foxglove/Pose.proto"]);
    let entity = SchemaBuilder::new("SceneEntity")
        .typed(1, "timestamp", Type::Message, TIMESTAMP)
        .field(2, "frame_id", Type::String)
        .field(3, "id", Type::String)
        .typed(4, "lifetime", Type::Message, ".google.protobuf.Duration")
        .field(5, "frame_locked", Type::Bool)
        .repeated_typed(7, "arrows", Type::Message, ".foxglove.ArrowPrimitive")
        .file(PACKAGE, &[TIME_FILE, DURATION_FILE, "foxglove/ArrowPrimitive.proto"]);
    let update = SchemaBuilder::new("SceneUpdate")
        .repeated_typed(2, "entities", Type::Message, ".foxglove.SceneEntity")
        .file(PACKAGE, &["foxglove/SceneEntity.proto"]);
    let (time, duration) = (well_known("Timestamp", TIME_FILE), well_known("Duration", DURATION_FILE));
    set(vec![time, duration, color, vector3(), quaternion(), pose, arrow, entity, update])
}
