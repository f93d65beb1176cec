use super::MavlinkGeneration;
use crate::wire::{Encoder, FrameBuf};
use mavlink_core::MessageData;

/// Encodes in the generation of MAVLink the link speaks. In MAVLink 1 messages with high ids do not exist: `None`.
#[derive(Debug)]
pub(super) struct Writer {
    encoder: Encoder,
    generation: MavlinkGeneration,
}

impl Writer {
    pub fn new(system: u8, generation: MavlinkGeneration) -> Self {
        // 1 is the autopilot's component id
        Self { encoder: Encoder::new(system, 1), generation }
    }

    pub fn put<M: MessageData>(&mut self, message: &M) -> Option<FrameBuf> {
        match self.generation {
            MavlinkGeneration::V2 => Some(self.encoder.encode(message)),
            MavlinkGeneration::V1 => self.encoder.encode_v1(message).ok(),
        }
    }
}
