//! One function for each message streamed, by what it is about.

pub(super) mod motion;
pub(super) mod power;
pub(super) mod raw;
pub(super) mod status;
pub(super) mod truth;
