use super::estimator::Work;
use super::recorder::RecorderHandle;
use super::router::{LinkId, Origin, Router};
use super::status::Board;
use crate::record::session::Track;
use crate::wire::{Event, FrameRef};
use std::sync::Arc;
use tokio::sync::mpsc;
use tokio::sync::mpsc::error::TrySendError;

/// Where a link puts what it received: counted, forwarded, recorded, estimated.
#[derive(Debug, Clone)]
pub(super) struct Inlet {
    pub(super) link: LinkId,
    pub(super) router: Arc<Router>,
    pub(super) recorder: Option<RecorderHandle>,
    pub(super) estimator: mpsc::Sender<Work>,
    pub(super) board: Arc<Board>,
}

impl Inlet {
    pub(super) fn link(&self) -> LinkId {
        self.link
    }

    /// Takes what arrived on a live link. Never waits.
    pub(super) fn take(&mut self, event: Event<'_>, origin: Origin, now_us: u64) {
        let Some(frame) = self.pass(event, origin, now_us) else { return };
        match self.estimator.try_send(Work { frame: frame.into(), origin, received_us: now_us, live: true }) {
            Ok(()) => {}
            Err(TrySendError::Full(_) | TrySendError::Closed(_)) => self.board.estimator_missed(),
        }
    }

    /// Takes what a log played. Waits for the estimator, so that a fast log is estimated whole.
    pub(super) async fn take_played(&mut self, event: Event<'_>, origin: Origin, received_us: u64) {
        let Some(frame) = self.pass(event, origin, received_us) else { return };
        let work = Work { frame: frame.into(), origin, received_us, live: false };
        if self.estimator.send(work).await.is_err() {
            self.board.estimator_missed();
        }
    }

    fn pass<'a>(&mut self, event: Event<'a>, origin: Origin, now_us: u64) -> Option<FrameRef<'a>> {
        self.board.received(self.link, &event, now_us);
        let Event::Frame(frame) = event else { return None };
        self.router.forward(frame, origin);
        if let Some(recorder) = &self.recorder {
            recorder.record(Track::Received, self.link.0, now_us, frame);
        }
        Some(frame)
    }
}
