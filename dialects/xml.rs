//! Part of the build script: reads MAVLink's XML into the tables of `src/wire/definitions`.
//!
//! The generated message types know neither units nor the numbers of enum entries, and refuse a message with an enum
//! value they do not know. Records need all of that, so the definitions are kept as data beside the types.

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::fmt::Write;
use std::fs;
use std::path::Path;

type Fallible<T> = Result<T, Box<dyn Error>>;

/// Several dialects as one. The first definition of a message wins; an enum gathers the entries of all files.
#[derive(Default)]
pub struct Definitions {
    messages: BTreeMap<u32, Message>,
    enums: BTreeMap<String, Enumeration>,
    read: BTreeSet<String>,
}

struct Message {
    name: String,
    /// The file that defines it.
    dialect: String,
    fields: Vec<Field>,
}

struct Field {
    name: String,
    kind: &'static str,
    size: usize,
    /// Length of an array; zero for a scalar.
    array: usize,
    extension: bool,
    unit: String,
    values: Option<String>,
    bitmask: bool,
}

#[derive(Default)]
struct Enumeration {
    bitmask: bool,
    entries: BTreeMap<u64, String>,
}

impl Definitions {
    /// Reads one file and those it includes, which stand beside it.
    pub fn read(&mut self, directory: &Path, file: &str) -> Fallible<()> {
        if !self.read.insert(file.to_owned()) {
            return Ok(());
        }
        let path = directory.join(file);
        let failed = |e: &dyn Error| format!("{}: {e}", path.display());
        let text = fs::read_to_string(&path).map_err(|e| failed(&e))?;
        let document = roxmltree::Document::parse(&text).map_err(|e| failed(&e))?;
        for node in document.descendants() {
            match node.tag_name().name() {
                "include" => self.read(directory, node.text().unwrap_or_default().trim())?,
                "enum" => self.enumeration(node).map_err(|e| failed(e.as_ref()))?,
                "message" => self.message(node, file).map_err(|e| failed(e.as_ref()))?,
                _ => {}
            }
        }
        Ok(())
    }

    fn enumeration(&mut self, node: roxmltree::Node<'_, '_>) -> Fallible<()> {
        let into = self.enums.entry(attribute(node, "name")?.to_owned()).or_default();
        into.bitmask |= node.attribute("bitmask") == Some("true");
        for entry in node.children().filter(|n| n.has_tag_name("entry")) {
            let value = number(attribute(entry, "value")?)?;
            into.entries.entry(value).or_insert(attribute(entry, "name")?.to_owned());
        }
        Ok(())
    }

    fn message(&mut self, node: roxmltree::Node<'_, '_>, file: &str) -> Fallible<()> {
        let id = attribute(node, "id")?.parse()?;
        let (mut fields, mut extension) = (Vec::new(), false);
        for child in node.children() {
            match child.tag_name().name() {
                "extensions" => extension = true,
                "field" => fields.push(field(child, extension)?),
                _ => {}
            }
        }
        let name = attribute(node, "name")?.to_owned();
        self.messages.entry(id).or_insert(Message { name, dialect: file.trim_end_matches(".xml").to_owned(), fields });
        Ok(())
    }

    /// The tables as Rust source; `src/wire/definitions/mod.rs` declares the types.
    pub fn source(&self) -> Fallible<String> {
        let mut out = String::new();
        let mut index = BTreeMap::new();
        let named = || self.messages.values().flat_map(|m| &m.fields).filter_map(|f| f.values.as_ref());
        let used: BTreeSet<_> = named().collect();
        for (i, (name, enumeration)) in self.enums.iter().filter(|(name, _)| used.contains(name)).enumerate() {
            index.insert(name.as_str(), i);
            let entries: Vec<_> = enumeration.entries.iter().map(|(v, n)| format!("({v}, {n:?})")).collect();
            let bitmask = enumeration.bitmask;
            writeln!(
                out,
                "static ENUM_{i}: Enumeration = Enumeration {{ name: {name:?}, bitmask: {bitmask}, entries: &[{}] }};",
                entries.join(", ")
            )?;
        }
        writeln!(out, "static MESSAGES: &[Definition] = &[")?;
        for (id, message) in &self.messages {
            let (offsets, len_v1, len) = message.layout();
            writeln!(
                out,
                "Definition {{ id: {id}, name: {:?}, dialect: {:?}, len_v1: {len_v1}, len: {len}, fields: &[",
                message.name, message.dialect
            )?;
            for (field, offset) in message.fields.iter().zip(offsets) {
                let values = field.values.as_deref().and_then(|v| index.get(v));
                let bitmask = field.bitmask
                    || field.values.as_ref().is_some_and(|v| self.enums.get(v).is_some_and(|e| e.bitmask));
                writeln!(
                    out,
                    "Field {{ name: {:?}, kind: Kind::{}, array: {}, offset: {offset}, extension: {}, unit: {:?}, \
                     values: {}, bitmask: {bitmask} }},",
                    field.name,
                    field.kind,
                    field.array,
                    field.extension,
                    field.unit,
                    values.map_or("None".to_owned(), |i| format!("Some(&ENUM_{i})")),
                )?;
            }
            writeln!(out, "] }},")?;
        }
        writeln!(out, "];")?;
        Ok(out)
    }
}

impl Message {
    /// Payload offset of each field, and the payload's length without and with extensions: fields go by falling size,
    /// equal ones in the order of the XML, extension fields last and as written.
    fn layout(&self) -> (Vec<usize>, usize, usize) {
        let mut order: Vec<_> = (0..self.fields.len()).filter(|&i| !self.fields[i].extension).collect();
        order.sort_by_key(|&i| std::cmp::Reverse(self.fields[i].size));
        let base = order.len();
        order.extend((0..self.fields.len()).filter(|&i| self.fields[i].extension));
        let mut offsets = vec![0; self.fields.len()];
        let (mut at, mut len_v1) = (0, 0);
        for (n, &i) in order.iter().enumerate() {
            offsets[i] = at;
            at += self.fields[i].size * self.fields[i].array.max(1);
            if n + 1 == base {
                len_v1 = at;
            }
        }
        (offsets, len_v1, at)
    }
}

fn field(node: roxmltree::Node<'_, '_>, extension: bool) -> Fallible<Field> {
    let text = attribute(node, "type")?;
    let (base, array) = match text.strip_suffix(']').and_then(|t| t.split_once('[')) {
        Some((base, len)) => (base, len.parse()?),
        None => (text, 0),
    };
    let (kind, size) = match base {
        "char" => ("Char", 1),
        "uint8_t" | "uint8_t_mavlink_version" => ("U8", 1),
        "int8_t" => ("I8", 1),
        "uint16_t" => ("U16", 2),
        "int16_t" => ("I16", 2),
        "uint32_t" => ("U32", 4),
        "int32_t" => ("I32", 4),
        "uint64_t" => ("U64", 8),
        "int64_t" => ("I64", 8),
        "float" => ("F32", 4),
        "double" => ("F64", 8),
        other => return Err(format!("unknown type {other}").into()),
    };
    Ok(Field {
        name: attribute(node, "name")?.to_owned(),
        kind,
        size,
        array,
        extension,
        unit: node.attribute("units").unwrap_or_default().to_owned(),
        values: node.attribute("enum").map(str::to_owned),
        bitmask: node.attribute("display") == Some("bitmask"),
    })
}

fn attribute<'a>(node: roxmltree::Node<'a, '_>, name: &str) -> Fallible<&'a str> {
    node.attribute(name).ok_or_else(|| format!("<{}> without {name}", node.tag_name().name()).into())
}

/// Decimal, hexadecimal, or a power as in `2**3`.
fn number(text: &str) -> Fallible<u64> {
    if let Some(hex) = text.strip_prefix("0x") {
        return Ok(u64::from_str_radix(hex, 16)?);
    }
    if let Some((base, exponent)) = text.split_once("**") {
        return Ok(base.trim().parse::<u64>()?.pow(exponent.trim().parse()?));
    }
    Ok(text.parse()?)
}
