//! Who speaks in a recording, and the parameters that were seen.

use crate::wire::FrameRef;
use crate::wire::definitions::{Enumeration, definition_by_name};
use std::collections::BTreeMap;

const HEARTBEAT: u32 = 0;
const PARAM_VALUE: u32 = 22;
/// MAV_AUTOPILOT_INVALID: no vehicle, but a ground station or a peripheral.
const NO_AUTOPILOT: u8 = 8;
/// MAV_AUTOPILOT_PX4, which sends integer parameters bytewise.
const PX4: u8 = 12;
/// MAV_PARAM_TYPE_REAL32 and those behind it are no integers.
const REAL32: u8 = 9;

/// Gathered while a recording is written.
#[derive(Debug, Clone, Default)]
pub struct Inventory {
    components: BTreeMap<(u8, u8), Component>,
}

#[derive(Debug, Clone, Default)]
struct Component {
    /// Type and autopilot of its last heartbeat.
    kind: Option<(u8, u8)>,
    /// Value as sent, and its type.
    parameters: BTreeMap<String, ([u8; 4], u8)>,
}

impl Inventory {
    pub(super) fn frame(&mut self, frame: FrameRef<'_>) {
        let id = frame.message_id();
        if id != HEARTBEAT && id != PARAM_VALUE {
            return;
        }
        let component = self.components.entry((frame.system_id(), frame.component_id())).or_default();
        let fields = frame.fields();
        if id == HEARTBEAT {
            component.kind = Some((fields.u8(4), fields.u8(5)));
        } else if let Some(name) = fields.text(8, 16).filter(|n| !n.is_empty()) {
            let value = (fields.array(0), fields.u8(24));
            match component.parameters.get_mut(name) {
                Some(known) => *known = value,
                None => {
                    component.parameters.insert(name.to_owned(), value);
                }
            }
        }
    }

    /// Vehicles: system, component, type and autopilot.
    pub fn vehicles(&self) -> impl Iterator<Item = ((u8, u8), u8, u8)> {
        self.components.iter().filter_map(|(&id, c)| {
            let (kind, autopilot) = c.kind?;
            (autopilot != NO_AUTOPILOT).then_some((id, kind, autopilot))
        })
    }

    /// Number of parameters seen, of all components.
    pub fn parameters(&self) -> usize {
        self.components.values().map(|c| c.parameters.len()).sum()
    }

    pub(super) fn describe(&self, into: &mut BTreeMap<String, String>) {
        for ((system, component), kind, autopilot) in self.vehicles() {
            let text = format!("{} {}", entry("type", kind), entry("autopilot", autopilot));
            into.insert(format!("vehicle.{system}.{component}"), text);
        }
        for (&(system, component), c) in self.components.iter().filter(|(_, c)| !c.parameters.is_empty()) {
            into.insert(format!("parameters.{system}.{component}"), c.parameters.len().to_string());
        }
    }

    /// A file for each component that told parameters, `NAME,VALUE` a line, as ground stations read them.
    pub(super) fn parameter_files(&self) -> Vec<(String, String)> {
        let told = self.components.iter().filter(|(_, c)| !c.parameters.is_empty());
        let files = told.map(|(&(system, component), c)| {
            let bytewise = c.kind.is_some_and(|(_, autopilot)| autopilot == PX4);
            let lines = c.parameters.iter().map(|(name, &(value, kind))| {
                if bytewise && kind < REAL32 {
                    format!("{name},{}\n", i32::from_le_bytes(value))
                } else {
                    format!("{name},{}\n", f32::from_le_bytes(value))
                }
            });
            (format!("parameters-{system}-{component}.param"), lines.collect())
        });
        files.collect()
    }
}

/// The name of a HEARTBEAT field's value, without its prefix.
fn entry(field: &str, value: u8) -> String {
    let field = definition_by_name("HEARTBEAT").and_then(|d| d.fields.iter().find(|f| f.name == field));
    let named = field.and_then(|f| f.values).and_then(|values: &Enumeration| {
        let (_, name) = values.entries.iter().find(|(v, _)| *v == u64::from(value))?;
        name.strip_prefix(values.name).map(|n| n.trim_start_matches('_').to_lowercase())
    });
    named.unwrap_or_else(|| value.to_string())
}
