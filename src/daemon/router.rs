//! Hands frames to links, as [`crate::routing`] decides.

use super::clock::Steady;
use super::guard::{Guard, Withheld};
use super::links::Outlet;
pub use crate::routing::LinkId;
pub(super) use crate::routing::Origin;
use crate::routing::{Fate, Routes, Rules};
use crate::wire::FrameRef;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Hands frames to links. Any thread may call it.
#[derive(Debug)]
pub(super) struct Router {
    outlets: Vec<Outlet>,
    /// Of the links that are signed.
    guards: Vec<Option<Guard>>,
    routes: Mutex<Routes>,
    /// Not the time of the frames: a log's is another than that of a live link.
    steady: Steady,
}

impl Router {
    /// `outlets[i]`, `guards[i]` and `rules[i]` belong to `LinkId(i)`.
    pub(super) fn new(
        outlets: Vec<Outlet>,
        guards: Vec<Option<Guard>>,
        rules: Vec<Rules>,
        duplicates: Duration,
    ) -> Self {
        let routes = Routes::new(rules, micros(duplicates));
        Self { outlets, guards, routes: Mutex::new(routes), steady: Steady::start() }
    }

    /// Who signs and checks on a link; `None` where nobody does.
    pub(super) fn guard(&self, link: LinkId) -> Option<&Guard> {
        self.guards.get(link.0)?.as_ref()
    }

    /// Writes down the newest times of all signatures.
    pub(super) fn keep_times(&self) {
        self.guards.iter().flatten().for_each(Guard::keep);
    }

    /// Other rules from now on; links go on as they are.
    pub(super) fn set_rules(&self, rules: Vec<Rules>, duplicates: Duration) {
        let mut routes = self.routes();
        rules.into_iter().enumerate().for_each(|(link, rules)| routes.set_rules(LinkId(link), rules));
        routes.set_window(micros(duplicates));
    }

    /// An end that frames can go to.
    pub(super) fn open(&self, end: Origin) {
        self.routes().open(end);
    }

    /// An end has gone.
    pub(super) fn close(&self, end: Origin) {
        self.routes().close(end);
    }

    /// Frames that a link's filter and its rate limits held back on their way out.
    pub(super) fn held_back(&self, link: LinkId) -> (u64, u64) {
        self.routes().held_back(link)
    }

    /// Passes a received frame on, untouched. `ends` is room to work in.
    pub(super) fn forward(&self, frame: FrameRef<'_>, from: Origin, ends: &mut Vec<Origin>) -> Fate {
        let fate = self.routes().route(frame, from, self.steady.us(), ends);
        for end in ends.iter() {
            self.give(frame, *end);
        }
        fate
    }

    /// Sends one of our own frames to everyone on a link.
    pub(super) fn send(&self, frame: FrameRef<'_>, link: LinkId) {
        self.answer(frame, Origin { link, peer: None });
    }

    /// Sends one of our own frames to where another came from.
    pub(super) fn answer(&self, frame: FrameRef<'_>, to: Origin) {
        self.routes().sent(frame, self.steady.us());
        self.give(frame, to);
    }

    fn give(&self, frame: FrameRef<'_>, to: Origin) {
        let Some(outlet) = self.outlets.get(to.link.0) else { return };
        match self.guard(to.link).map_or(Ok(None), |guard| guard.seal(frame)) {
            Ok(Some(signed)) => outlet.send(signed.bytes(), to.peer),
            Ok(None) => outlet.send(frame.bytes(), to.peer),
            Err(Withheld) => {}
        }
    }

    /// A panic elsewhere leaves routes that are learnt anew from the next frames.
    fn routes(&self) -> MutexGuard<'_, Routes> {
        self.routes.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}
