//! Signatures on one link: what leaves is signed, what comes is checked.

use super::clock::unix_us;
use super::lock::lock;
use crate::config::Signing;
use crate::wire::signing::{Refusal, SignatureTime, Signer, Unsigned, Verifier};
use crate::wire::{FrameBuf, FrameRef};
use std::collections::BTreeSet;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use tracing::warn;

/// Signs and checks on one link. Any thread may call it.
#[derive(Debug)]
pub(super) struct Guard {
    link: String,
    verifier: Mutex<Verifier>,
    signer: Mutex<Signer>,
    unsigned: Unsigned,
    times: PathBuf,
    refused: AtomicU64,
    /// Frames that cannot be signed, and so were not sent.
    withheld: AtomicU64,
    told: Mutex<BTreeSet<Refusal>>,
}

/// A frame cannot be signed, on a link where unsigned ones are refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Withheld;

/// The file of times cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}; mend or delete it", path.display())]
pub struct TimesError {
    path: PathBuf,
    source: io::Error,
}

impl Guard {
    /// Takes up where the file of times says that signing ended.
    ///
    /// # Errors
    /// The file is there and cannot be read.
    pub(super) fn open(link: &str, signing: &Signing) -> Result<Self, TimesError> {
        let failed = |source| TimesError { path: signing.times.clone(), source };
        let newest = kept(&signing.times).map_err(failed)?;
        Ok(Self {
            link: link.to_owned(),
            verifier: Mutex::new(Verifier::new(signing.key.clone(), signing.unsigned, newest)),
            signer: Mutex::new(Signer::new(signing.key.clone(), signing.link_id, newest)),
            unsigned: signing.unsigned,
            times: signing.times.clone(),
            refused: AtomicU64::new(0),
            withheld: AtomicU64::new(0),
            told: Mutex::default(),
        })
    }

    /// May this frame be used? The first refusal for each reason is told.
    pub(super) fn admits(&self, frame: FrameRef<'_>, now_us: u64) -> bool {
        let Err(refusal) = lock(&self.verifier).check(frame, now_us) else { return true };
        self.refused.fetch_add(1, Ordering::Relaxed);
        if lock(&self.told).insert(refusal) {
            let (link, system, component) = (&self.link, frame.system_id(), frame.component_id());
            warn!(link, system, component, "refused: {refusal}; more of this kind are only counted");
        }
        false
    }

    /// What leaves in a frame's place; `None` where it may leave as it is.
    pub(super) fn seal(&self, frame: FrameRef<'_>) -> Result<Option<FrameBuf>, Withheld> {
        let signed = lock(&self.signer).sign(frame, unix_us());
        if signed.is_some() || frame.signature().is_some() || self.unsigned == Unsigned::Accept {
            return Ok(signed);
        }
        self.withheld.fetch_add(1, Ordering::Relaxed);
        Err(Withheld)
    }

    /// Frames refused, and frames that could not be signed.
    pub(super) fn counts(&self) -> (u64, u64) {
        (self.refused.load(Ordering::Relaxed), self.withheld.load(Ordering::Relaxed))
    }

    /// Writes the newest time down, so that a restart with a clock that was set back takes no old frame for new.
    pub(super) fn keep(&self) {
        let own = lock(&self.verifier).newest().max(lock(&self.signer).last());
        // links with one key share the file: an idle one must not set it back
        let newest = own.max(kept(&self.times).unwrap_or_default());
        let new = self.times.with_extension("new");
        let written = std::fs::write(&new, format!("{}\n", newest.ticks()));
        if let Err(e) = written.and_then(|()| std::fs::rename(&new, &self.times)) {
            warn!("cannot keep the time of signatures in {}: {e}", self.times.display());
        }
    }
}

/// The time that a file keeps; the least where there is none yet.
fn kept(times: &Path) -> io::Result<SignatureTime> {
    match std::fs::read_to_string(times) {
        Ok(text) => {
            let ticks = text.trim().parse().map_err(|_| io::Error::other("it holds no whole number"))?;
            Ok(SignatureTime::from_ticks(ticks))
        }
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(SignatureTime::default()),
        Err(e) => Err(e),
    }
}
