//! A live recording: telemetry logs and an MCAP file beside each other, in parts, within a budget.
//!
//! Every part has the time of its beginning in its name: `TIME.tlog` holds the received frames and nothing else,
//! `TIME.sent.tlog` what was sent to the vehicles, `TIME.mcap` both, with estimates and gaps. What was flushed can be read
//! even if nothing follows, so a killed process or a lost supply costs what came after the last flush. Any error of the
//! disk ends the recording, and nothing else.

mod disk;
mod part;
mod policy;

pub use disk::{Disk, Folder};
pub use policy::Policy;

use super::error::RecordError;
use super::publisher::OwnedChannel;
use crate::wire::FrameRef;
use mcap::records::MessageHeader;
use part::Part;

/// Which way a frame went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Track {
    Received,
    Sent,
}

/// HEARTBEAT: wire offsets of autopilot and mode, the flag for "armed", and the autopilot of what is no vehicle.
const HEARTBEAT: u32 = 0;
const AUTOPILOT: usize = 5;
const BASE_MODE: usize = 6;
const ARMED: u8 = 128;
const NO_AUTOPILOT: u8 = 8;

/// A recording with its policy. Knows no clock: every call says what time it is.
pub struct Session<D: Disk> {
    disk: D,
    policy: Policy,
    part: Option<Part<D>>,
    /// Systems that are armed.
    armed: Vec<u8>,
    /// When the last of them was heard to be.
    armed_until_us: u64,
    next_flush_us: u64,
    written: u64,
}

impl<D: Disk> Session<D> {
    /// Begins the first part at once if the policy lets it, so that a place that cannot be written to shows early.
    ///
    /// # Errors
    /// The place cannot be written to.
    pub fn begin(disk: D, policy: Policy, now_us: u64) -> Result<Self, RecordError> {
        let mut session = Self {
            disk,
            policy,
            part: None,
            armed: Vec::new(),
            armed_until_us: 0,
            next_flush_us: now_us.saturating_add(policy.flush_every_us),
            written: 0,
        };
        if !policy.only_armed {
            session.open(now_us)?;
        }
        Ok(session)
    }

    /// Frames and estimates written so far.
    pub fn written(&self) -> u64 {
        self.written
    }

    /// Records a frame of the link with this name.
    ///
    /// # Errors
    /// Those of the disk. The recording is over then.
    pub fn frame(&mut self, track: Track, link: &str, now_us: u64, frame: FrameRef<'_>) -> Result<(), RecordError> {
        self.watch(track, now_us, frame);
        if !self.ready(now_us)? {
            return Ok(());
        }
        if let Some(part) = &mut self.part {
            part.frame(&mut self.disk, track, link, now_us, frame)?;
            self.written += 1;
        }
        Ok(())
    }

    /// Records a message of this channel; the `channel_id` in its header says nothing here.
    ///
    /// # Errors
    /// Those of the disk. The recording is over then.
    pub fn message(
        &mut self,
        now_us: u64,
        channel: &OwnedChannel,
        header: &MessageHeader,
        data: &[u8],
    ) -> Result<(), RecordError> {
        if !self.ready(now_us)? {
            return Ok(());
        }
        match &mut self.part {
            Some(part) => part.message(channel, header, data),
            None => Ok(()),
        }
    }

    /// Notes that so many frames could not be taken in time.
    ///
    /// # Errors
    /// Those of the disk. The recording is over then.
    pub fn gap(&mut self, now_us: u64, missed: u64) -> Result<(), RecordError> {
        match &mut self.part {
            Some(part) => part.gap(now_us, missed),
            None => Ok(()),
        }
    }

    /// To be called now and then: flushes what is due, closes a part whose vehicles have disarmed, keeps the budget.
    ///
    /// # Errors
    /// Those of the disk. The recording is over then.
    pub fn tick(&mut self, now_us: u64) -> Result<(), RecordError> {
        if now_us < self.next_flush_us {
            return Ok(());
        }
        self.next_flush_us = now_us.saturating_add(self.policy.flush_every_us);
        if let Some(part) = &mut self.part {
            part.flush(&mut self.disk, self.policy.sync)?;
        }
        if self.policy.only_armed && !self.is_armed(now_us) {
            self.close()?;
        }
        self.keep_budget()
    }

    /// Writes index and footer. A session that is only dropped leaves a readable file without them.
    ///
    /// # Errors
    /// Those of the disk.
    pub fn finish(mut self) -> Result<u64, RecordError> {
        self.close()?;
        Ok(self.written)
    }

    fn watch(&mut self, track: Track, now_us: u64, frame: FrameRef<'_>) {
        let fields = frame.fields();
        if track == Track::Received && frame.message_id() == HEARTBEAT && fields.u8(AUTOPILOT) != NO_AUTOPILOT {
            let system = frame.system_id();
            self.armed.retain(|&s| s != system);
            if fields.u8(BASE_MODE) & ARMED != 0 {
                self.armed.push(system);
                self.armed_until_us = now_us;
            }
        }
    }

    /// A vehicle that fell silent while armed counts as armed for the time that the policy gives.
    fn is_armed(&self, now_us: u64) -> bool {
        let silent_us = now_us.saturating_sub(self.armed_until_us);
        !self.armed.is_empty() && silent_us < self.policy.armed_silence_us
    }

    /// Sees to it that there is a part to write to; `false` if nothing is to be written now.
    fn ready(&mut self, now_us: u64) -> Result<bool, RecordError> {
        if self.part.as_ref().is_some_and(|part| part.is_full(&self.policy, now_us)) {
            self.close()?;
        }
        if self.part.is_none() && (!self.policy.only_armed || self.is_armed(now_us)) {
            self.open(now_us)?;
            self.keep_budget()?;
        }
        Ok(self.part.is_some())
    }

    fn open(&mut self, now_us: u64) -> Result<(), RecordError> {
        self.part = Some(Part::create(&mut self.disk, &self.policy, now_us)?);
        Ok(())
    }

    fn close(&mut self) -> Result<(), RecordError> {
        match self.part.take() {
            Some(part) => part.finish(&mut self.disk, self.policy.sync),
            None => Ok(()),
        }
    }

    /// Removes the oldest recordings until all together fit into the budget; the part that is being written stays.
    fn keep_budget(&mut self) -> Result<(), RecordError> {
        let Some(budget) = self.policy.budget_bytes else { return Ok(()) };
        let mut files = self.disk.list().map_err(RecordError::Write)?;
        // names begin with a time, so their order is that of age
        files.sort();
        let mut total: u64 = files.iter().map(|(_, bytes)| bytes).sum();
        let current = self.part.as_ref().map(|p| p.stem().to_owned());
        for (name, bytes) in files {
            let is_current = current.as_ref().is_some_and(|stem| disk::stem(&name) == stem);
            if total <= budget || is_current {
                break;
            }
            self.disk.remove(&name).map_err(RecordError::Write)?;
            total -= bytes;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
