//! What a stream of bytes turns into.

use super::FrameRef;

/// The next thing found in the input. All events together cover every byte of it, in order, exactly once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event<'a> {
    Frame(FrameRef<'a>),
    Bad(BadFrame<'a>),
}

impl<'a> Event<'a> {
    /// The bytes it covers.
    pub fn bytes(&self) -> &'a [u8] {
        match self {
            Self::Frame(frame) => frame.bytes(),
            Self::Bad(bad) => bad.bytes,
        }
    }
}

/// Bytes that are no frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BadFrame<'a> {
    pub bytes: &'a [u8],
    pub reason: BadReason,
}

/// Why bytes were given up. A bad frame that hides others in its damaged length gives the reason of the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum BadReason {
    /// The frame was damaged, or the sender's dialect defines this message differently.
    #[error("message {message_id}: checksum is {received:#06x}, computed {computed:#06x}")]
    Checksum { message_id: u32, received: u16, computed: u16 },
    /// MAVLink 2 asks to drop frames with incompatibility flags that the receiver does not understand.
    #[error("incompatibility flags {flags:#04x} are not supported")]
    UnsupportedFlags { flags: u8 },
    /// The input ended within the frame.
    #[error("frame of {expected} bytes is cut off")]
    Truncated { expected: usize },
    /// An undefined message whose bounds nothing confirms; see [`Parser`](super::Parser).
    #[error("unknown message {message_id} in a damaged stretch")]
    UnconfirmedUnknown { message_id: u32 },
    /// No frame begins here.
    #[error("no frame begins here")]
    Garbage,
}
