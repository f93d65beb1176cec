//! Recorded messages back to what came over the link.

use super::error::RecordError;
use super::proto::{KeptFrame, PayloadError, Plan, ProtoFields, Value};
use super::{own, topics};
use crate::wire::definitions::definition_by_name;
use crate::wire::tlog::Record;
use crate::wire::{BadFrame, BadReason, Event, FrameBuf, FrameHeader, datagram};
use mcap::records::{Channel, MessageHeader};
use std::collections::HashMap;

/// Holds the last thing that was restored.
pub(super) struct Restore {
    topics: HashMap<u16, Topic>,
    /// Whether the log that the recording was made from held receive times.
    pub stamped: bool,
    received_unix_us: u64,
    stamp: [u8; 8],
    stamp_len: usize,
    kind: Kind,
    /// A whole frame or a bad stretch.
    bytes: Vec<u8>,
    payload: [u8; 255],
}

/// What one channel holds.
enum Topic {
    Message { system: u8, component: u8, plan: Box<Plan> },
    Unknown,
    Bad,
}

enum Kind {
    /// A frame made of its fields.
    Frame(Box<FrameBuf>),
    /// A frame in `bytes`.
    Raw,
    Bad,
}

impl Restore {
    pub fn new() -> Self {
        Self {
            topics: HashMap::new(),
            stamped: true,
            received_unix_us: 0,
            stamp: [0; 8],
            stamp_len: 0,
            kind: Kind::Bad,
            bytes: Vec::new(),
            payload: [0; 255],
        }
    }

    /// Learns what a channel holds.
    ///
    /// # Errors
    /// The channel holds MAVLink in a form that does not give frames back.
    pub fn channel(&mut self, channel: &Channel) -> Result<(), RecordError> {
        if let Some(topic) = Topic::of(channel)? {
            self.topics.insert(channel.id, topic);
        }
        Ok(())
    }

    /// Whether anything here came over a link.
    pub fn has_link_topics(&self) -> bool {
        !self.topics.is_empty()
    }

    /// Takes a message in; `false` if it did not come over a link.
    ///
    /// # Errors
    /// The message is not what its topic says.
    pub fn message(&mut self, header: &MessageHeader, data: &[u8]) -> Result<bool, RecordError> {
        let Some(topic) = self.topics.get(&header.channel_id) else { return Ok(false) };
        let damaged = |e: PayloadError| RecordError::Damaged(e.to_string());
        self.received_unix_us = header.log_time / 1_000;
        let raw_stamp = match topic {
            Topic::Message { system, component, plan } => {
                let kept = plan.decode(data, &mut self.payload).map_err(damaged)?;
                match kept.frame {
                    KeptFrame::Plain(version, len) => {
                        let header = FrameHeader {
                            version,
                            system: *system,
                            component: *component,
                            // a MAVLink sequence number is one byte
                            sequence: header.sequence as u8,
                            message_id: plan.definition().id,
                        };
                        let payload = self.payload.get(..len).unwrap_or_default();
                        let frame = header.frame(payload).ok_or_else(|| damaged(PayloadError::Damaged))?;
                        match &mut self.kind {
                            Kind::Frame(last) => **last = frame,
                            kind => *kind = Kind::Frame(Box::new(frame)),
                        }
                    }
                    KeptFrame::Raw(bytes) => {
                        self.kind = Kind::Raw;
                        keep(&mut self.bytes, bytes);
                    }
                }
                kept.stamp
            }
            Topic::Unknown | Topic::Bad => {
                self.kind = if matches!(topic, Topic::Bad) { Kind::Bad } else { Kind::Raw };
                let mut stamp = None;
                let mut fields = ProtoFields::new(data);
                for field in &mut fields {
                    match field {
                        (own::BYTES, Value::Bytes(bytes)) => keep(&mut self.bytes, bytes),
                        (own::STAMP, Value::Bytes(bytes)) => stamp = Some(bytes),
                        _ => {}
                    }
                }
                if fields.is_damaged() {
                    return Err(damaged(PayloadError::Damaged));
                }
                stamp
            }
        };
        match raw_stamp {
            _ if !self.stamped => self.stamp_len = 0,
            None => {
                self.stamp = self.received_unix_us.to_be_bytes();
                self.stamp_len = self.stamp.len();
            }
            Some(stamp) => {
                self.stamp_len = stamp.len().min(self.stamp.len());
                self.stamp.iter_mut().zip(stamp).for_each(|(to, from)| *to = *from);
            }
        }
        Ok(true)
    }

    /// The last message that was taken in.
    pub fn record(&self) -> Record<'_> {
        let bad = |reason| Event::Bad(BadFrame { bytes: &self.bytes, reason });
        let event = match &self.kind {
            Kind::Frame(frame) => Event::Frame(FrameBuf::as_ref(frame)),
            // under another dialect a frame of that time may be none; its bytes are still those of the log
            Kind::Raw => match datagram(&self.bytes).next() {
                Some(event) if event.bytes().len() == self.bytes.len() => event,
                _ => bad(BadReason::Garbage),
            },
            Kind::Bad => match datagram(&self.bytes).next() {
                Some(Event::Bad(first)) => bad(first.reason),
                _ => bad(BadReason::Garbage),
            },
        };
        Record {
            received_unix_us: self.stamped.then_some(self.received_unix_us),
            stamp: &self.stamp[..self.stamp_len],
            event,
        }
    }
}

impl Topic {
    fn of(channel: &Channel) -> Result<Option<Self>, RecordError> {
        if channel.topic == topics::BAD {
            return Ok(Some(Self::Bad));
        }
        let Some(path) = channel.topic.strip_prefix(topics::MAVLINK) else { return Ok(None) };
        if channel.message_encoding != "protobuf" {
            let text =
                format!("{} is in {}, which does not hold whole frames", channel.topic, channel.message_encoding);
            return Err(RecordError::Unsupported(text));
        }
        let mut parts = path.split('/');
        let mut next = || parts.next().unwrap_or_default();
        let (system, component, name) = (next().parse(), next().parse(), next());
        let (Ok(system), Ok(component)) = (system, component) else { return Ok(None) };
        Ok(match definition_by_name(name) {
            Some(definition) => Some(Self::Message { system, component, plan: Box::new(Plan::new(definition)) }),
            None if name.starts_with("UNKNOWN_") => Some(Self::Unknown),
            None => {
                let text = format!("{}: no dialect here defines this message", channel.topic);
                return Err(RecordError::Unsupported(text));
            }
        })
    }
}

fn keep(to: &mut Vec<u8>, bytes: &[u8]) {
    to.clear();
    to.extend_from_slice(bytes);
}
