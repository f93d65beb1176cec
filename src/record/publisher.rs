use super::error::RecordError;
use super::foxglove::{self, Scene};
use super::inventory::Inventory;
use super::json::JsonPlan;
use super::proto::{Plan, message_schema};
use super::time::{ComponentTime, OwnTime};
use super::{own, topics};
use crate::signal::Stamp;
use crate::wire::definitions::definition;
use crate::wire::tlog::Record;
use crate::wire::{BadFrame, Check, FrameRef};
use mcap::records::MessageHeader;
use std::collections::{BTreeMap, HashMap};

/// How messages are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    #[default]
    Protobuf,
    Json,
}

/// When a frame or a bad stretch was received, and what a log says about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrival<'a> {
    /// ns since 1970; `None` in a log without receive times.
    pub unix_ns: Option<u64>,
    /// What stood in the log in place of the receive time, if that is not `unix_ns`.
    pub raw_stamp: Option<&'a [u8]>,
}

impl<'a> Arrival<'a> {
    /// How a record's time is kept: receive times are whole microseconds, so nearly all are the log time exactly.
    /// `stamped` says whether the log holds receive times.
    pub fn of(record: &Record<'a>, stamped: bool) -> Self {
        let unix_ns = record.received_unix_us.and_then(|us| us.checked_mul(1_000));
        let regular = record.received_unix_us.filter(|_| unix_ns.is_some()).map(u64::to_be_bytes);
        let irregular = stamped && regular.is_none_or(|bytes| bytes != record.stamp);
        Self { unix_ns, raw_stamp: irregular.then_some(record.stamp) }
    }

    /// Just received.
    pub fn at_us(unix_us: u64) -> Self {
        Self { unix_ns: Some(unix_us.saturating_mul(1_000)), raw_stamp: None }
    }
}

/// Where channels and their messages go: a file, or readers that are connected now.
pub trait ChannelSink {
    /// Opens a channel; its messages come with the id that this returns.
    ///
    /// # Errors
    /// Those of the sink.
    fn channel(&mut self, new: &NewChannel<'_>) -> Result<u16, RecordError>;

    /// # Errors
    /// Those of the sink.
    fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<(), RecordError>;
}

/// What a reader must know about a channel.
#[derive(Debug, Clone, Copy)]
pub struct NewChannel<'a> {
    pub topic: &'a str,
    /// Name of the message type, with its package.
    pub schema_name: &'a str,
    /// `protobuf` or `jsonschema`.
    pub schema_encoding: &'a str,
    pub schema: &'a [u8],
    /// `protobuf` or `json`.
    pub encoding: &'a str,
    pub metadata: &'a BTreeMap<String, String>,
}

/// What a reader must know about a channel, kept.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnedChannel {
    pub topic: String,
    pub schema_name: String,
    pub schema_encoding: String,
    pub schema: Vec<u8>,
    pub encoding: String,
    pub metadata: BTreeMap<String, String>,
}

impl OwnedChannel {
    pub fn borrowed(&self) -> NewChannel<'_> {
        NewChannel {
            topic: &self.topic,
            schema_name: &self.schema_name,
            schema_encoding: &self.schema_encoding,
            schema: &self.schema,
            encoding: &self.encoding,
            metadata: &self.metadata,
        }
    }
}

impl From<&NewChannel<'_>> for OwnedChannel {
    fn from(new: &NewChannel<'_>) -> Self {
        Self {
            topic: new.topic.to_owned(),
            schema_name: new.schema_name.to_owned(),
            schema_encoding: new.schema_encoding.to_owned(),
            schema: new.schema.to_vec(),
            encoding: new.encoding.to_owned(),
            metadata: new.metadata.clone(),
        }
    }
}

/// Makes topics of frames, bad bytes, gaps and estimates.
pub struct Publisher<S> {
    pub(super) sink: S,
    encoding: Encoding,
    /// Names of links, in the metadata of their channels.
    links: Vec<String>,
    channels: HashMap<Key, Channel>,
    others: HashMap<String, u16>,
    times: HashMap<(u8, u8), ComponentTime>,
    inventory: Inventory,
    pub(super) scene: Scene,
    buffer: Vec<u8>,
    /// Log time of the last message.
    pub(super) last_ns: u64,
    counts: Counts,
}

/// How much was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    pub frames: u64,
    pub unknown: u64,
    pub bad: u64,
    pub bad_bytes: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct Key {
    link: u16,
    system: u8,
    component: u8,
    message: u32,
}

struct Channel {
    id: u16,
    own_time: OwnTime,
    /// `None` if no dialect here defines the message.
    plan: Option<Writing>,
}

enum Writing {
    Protobuf(Plan),
    Json(JsonPlan),
}

impl<S: ChannelSink> Publisher<S> {
    pub fn new(sink: S, encoding: Encoding) -> Self {
        Self {
            sink,
            encoding,
            links: vec![String::new()],
            channels: HashMap::new(),
            others: HashMap::new(),
            times: HashMap::new(),
            inventory: Inventory::default(),
            scene: Scene::default(),
            buffer: Vec::with_capacity(1024),
            last_ns: 0,
            counts: Counts::default(),
        }
    }

    pub fn counts(&self) -> Counts {
        self.counts
    }

    pub fn inventory(&self) -> &Inventory {
        &self.inventory
    }

    /// Sets the log time of what comes before the first receive time.
    pub fn begin_at_ns(&mut self, unix_ns: u64) {
        self.last_ns = unix_ns;
    }

    /// Names a link; frames given with the result have it in their channel's metadata.
    pub fn link(&mut self, name: &str) -> u16 {
        let at = self.links.iter().position(|l| l == name).unwrap_or_else(|| {
            self.links.push(name.to_owned());
            self.links.len() - 1
        });
        at as u16
    }

    /// Records a frame.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn frame(&mut self, link: u16, arrival: Arrival<'_>, frame: FrameRef<'_>) -> Result<(), RecordError> {
        let key = Key { link, system: frame.system_id(), component: frame.component_id(), message: frame.message_id() };
        if !self.channels.contains_key(&key) {
            let channel = self.open_channel(key, frame)?;
            self.channels.insert(key, channel);
        }
        // it was inserted above
        let Some(channel) = self.channels.get(&key) else { return Ok(()) };
        let time = self.times.entry((key.system, key.component)).or_default();
        let fields = frame.fields();
        let (log_time, publish_time) = match arrival.unix_ns {
            Some(ns) => (ns, time.publish_time_ns(channel.own_time, fields, ns)),
            None => {
                let ns = time.boot_time_ns(channel.own_time, fields).unwrap_or(self.last_ns);
                (ns, ns)
            }
        };
        self.last_ns = log_time;
        self.buffer.clear();
        match &channel.plan {
            Some(Writing::Protobuf(plan)) => plan.encode(frame, arrival.raw_stamp, &mut self.buffer),
            Some(Writing::Json(plan)) => plan.encode(frame, arrival.raw_stamp, &mut self.buffer),
            None => own::put_unknown(frame, arrival.raw_stamp, &mut self.buffer),
        }
        self.counts.frames += 1;
        let is_known = channel.plan.is_some();
        self.counts.unknown += u64::from(!is_known);
        self.inventory.frame(frame);
        let header =
            MessageHeader { channel_id: channel.id, sequence: frame.sequence().into(), log_time, publish_time };
        self.sink.message(&header, &self.buffer)?;
        if is_known && foxglove::is_wanted(key.message) {
            self.panels(log_time, publish_time, frame)?;
        }
        Ok(())
    }

    /// When a vehicle made something that it stamped so, on the receiver's clock, ns since 1970.
    pub(super) fn made_at_ns(&mut self, system: u8, component: u8, stamp: Stamp, received_ns: u64) -> u64 {
        let time = self.times.entry((system, component)).or_default();
        time.learn(stamp, received_ns);
        time.unix_ns(stamp, received_ns)
    }

    fn open_channel(&mut self, key: Key, frame: FrameRef<'_>) -> Result<Channel, RecordError> {
        let Key { system, component, message, .. } = key;
        let known = definition(message).filter(|_| frame.check() == Check::Verified);
        let mut metadata: BTreeMap<String, String> = [
            ("message_id", message.to_string()),
            ("system_id", system.to_string()),
            ("component_id", component.to_string()),
        ]
        .map(|(k, v)| (k.to_owned(), v))
        .into();
        if let Some(link) = self.links.get(usize::from(key.link)).filter(|l| !l.is_empty()) {
            metadata.insert("link".to_owned(), link.clone());
        }
        let name = match known {
            Some(definition) => {
                metadata.insert("dialect".to_owned(), definition.dialect.to_owned());
                for field in definition.fields.iter().filter(|f| !f.unit.is_empty()) {
                    metadata.insert(format!("unit.{}", field.name), field.unit.to_owned());
                }
                definition.name.to_owned()
            }
            None => format!("UNKNOWN_{message}"),
        };
        let (schema, encoding, plan) = match (known, self.encoding) {
            (Some(definition), Encoding::Protobuf) => {
                (message_schema(definition), "protobuf", Some(Writing::Protobuf(Plan::new(definition))))
            }
            (Some(definition), Encoding::Json) => {
                let plan = JsonPlan::new(definition);
                (plan.schema().into_bytes(), "json", Some(Writing::Json(plan)))
            }
            (None, _) => (own::unknown_schema(), "protobuf", None),
        };
        let schema_name = match known {
            Some(_) => format!("mavlink.{name}"),
            None => format!("{}.{}", own::PACKAGE, own::UNKNOWN),
        };
        let id = self.sink.channel(&NewChannel {
            topic: &format!("{}{system}/{component}/{name}", topics::MAVLINK),
            schema_name: &schema_name,
            schema_encoding: if encoding == "json" { "jsonschema" } else { encoding },
            schema: &schema,
            encoding,
            metadata: &metadata,
        })?;
        Ok(Channel { id, own_time: known.map_or(OwnTime::None, OwnTime::of), plan })
    }

    /// Records bytes that were no frame.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn bad(&mut self, arrival: Arrival<'_>, bad: &BadFrame<'_>) -> Result<(), RecordError> {
        self.counts.bad += 1;
        self.counts.bad_bytes += bad.bytes.len() as u64;
        let at = arrival.unix_ns.unwrap_or(self.last_ns);
        self.last_ns = at;
        self.derived(topics::BAD, (at, at), own::BAD, own::PACKAGE, own::bad_schema, |out| {
            own::put_bad(bad, arrival.raw_stamp, out);
        })
    }

    /// Notes that frames are missing here, and why.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn gap(&mut self, unix_us: u64, missed: u64, reason: &str) -> Result<(), RecordError> {
        let at = unix_us.saturating_mul(1_000);
        self.derived(topics::GAP, (at, at), own::GAP, own::PACKAGE, own::gap_schema, |out| {
            own::put_gap(missed, reason, out);
        })
    }

    /// Records a protobuf message on a topic of its own. The schema is asked for once.
    pub(super) fn derived(
        &mut self,
        topic: &str,
        (log_time, publish_time): (u64, u64),
        name: &str,
        package: &str,
        schema: impl FnOnce() -> Vec<u8>,
        put: impl FnOnce(&mut Vec<u8>),
    ) -> Result<(), RecordError> {
        let channel_id = match self.others.get(topic) {
            Some(&id) => id,
            None => {
                let id = self.sink.channel(&NewChannel {
                    topic,
                    schema_name: &format!("{package}.{name}"),
                    schema_encoding: "protobuf",
                    schema: &schema(),
                    encoding: "protobuf",
                    metadata: &BTreeMap::new(),
                })?;
                self.others.insert(topic.to_owned(), id);
                id
            }
        };
        self.buffer.clear();
        put(&mut self.buffer);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        self.sink.message(&header, &self.buffer)
    }
}
