use super::batches::Sender;
use super::estimator::Work;
use super::recorder::RecorderHandle;
use super::router::Router;
use super::status::Board;
use crate::record::session::Track;
use crate::routing::{Fate, LinkId, Origin, PeerId};
use crate::wire::{Event, FrameRef};
use std::sync::Arc;

/// Where a link puts what it received: counted, forwarded, recorded, estimated.
#[derive(Debug, Clone)]
pub(super) struct Inlet {
    link: LinkId,
    router: Arc<Router>,
    recorder: Option<RecorderHandle>,
    /// `None` if nothing is estimated.
    estimator: Option<Sender<Work>>,
    board: Arc<Board>,
    /// Room for the ends that a frame goes to.
    ends: Vec<Origin>,
}

impl Inlet {
    pub(super) fn new(
        router: Arc<Router>,
        recorder: Option<RecorderHandle>,
        estimator: Option<Sender<Work>>,
        board: Arc<Board>,
    ) -> Self {
        Self { link: LinkId(0), router, recorder, estimator, board, ends: Vec::new() }
    }

    /// The same for another link.
    pub(super) fn of(&self, link: LinkId) -> Self {
        Self { link, ..self.clone() }
    }

    /// Frames can go to this peer, or to the link if it has no several.
    pub(super) fn open(&mut self, peer: Option<PeerId>) {
        self.router.open(Origin { link: self.link, peer });
    }

    /// A peer, or the whole link, has gone.
    pub(super) fn close(&mut self, peer: Option<PeerId>) {
        self.router.close(Origin { link: self.link, peer });
    }

    /// Takes what arrived on a live link. Never waits.
    pub(super) fn take(&mut self, event: Event<'_>, peer: Option<PeerId>, now_us: u64) {
        let origin = Origin { link: self.link, peer };
        let Some(frame) = self.pass(event, origin, now_us) else { return };
        let Some(estimator) = &self.estimator else { return };
        if estimator.push(Work { frame: frame.into(), origin, received_us: now_us, live: true }).is_err() {
            self.board.estimator_missed();
        }
    }

    /// Takes what a log played. Waits for the estimator, so that a fast log is estimated whole.
    pub(super) async fn take_played(&mut self, event: Event<'_>, received_us: u64) {
        let origin = Origin { link: self.link, peer: None };
        let Some(frame) = self.pass(event, origin, received_us) else { return };
        let work = Work { frame: frame.into(), origin, received_us, live: false };
        let Some(estimator) = &self.estimator else { return };
        if !estimator.push_when_room(work).await {
            self.board.estimator_missed();
        }
    }

    /// Counts, forwards and records; gives the frame if it is to be estimated.
    fn pass<'a>(&mut self, event: Event<'a>, origin: Origin, now_us: u64) -> Option<FrameRef<'a>> {
        self.board.received(self.link, &event, now_us);
        let Event::Frame(frame) = event else { return None };
        if self.router.guard(self.link).is_some_and(|guard| !guard.admits(frame, now_us)) {
            return None;
        }
        let fate = self.router.forward(frame, origin, &mut self.ends);
        match fate {
            Fate::Passed | Fate::SecondWay | Fate::Twin => {}
            Fate::Blocked => {
                self.board.blocked(self.link);
                return None;
            }
            Fate::Duplicate => {
                self.board.duplicate(self.link);
                return None;
            }
        }
        if let Some(recorder) = &self.recorder {
            recorder.record(Track::Received, self.link.0, now_us, frame);
        }
        match fate {
            // its streams run on the other port; both together would be estimated as twice as much
            Fate::SecondWay => return None,
            // two vehicles mixed into one would be estimated as neither
            Fate::Twin => {
                self.board.twin(self.link, frame);
                return None;
            }
            _ => {}
        }
        Some(frame)
    }
}
