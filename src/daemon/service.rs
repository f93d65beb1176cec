//! Starting and stopping everything.

use super::estimator::{Estimator, Voice, Work, Worker};
use super::inlet::Inlet;
use super::recorder::{Recorder, RecorderHandle};
use super::router::{LinkId, Outlet, Router};
use super::settings::Settings;
use super::status::{Board, Status, StatusLines};
use super::tlog::LogLink;
use super::udp::UdpLink;
use super::{DaemonError, ESTIMATOR_QUEUE};
use crate::config::LinkUrl;
use crate::record::session::Folder;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;
use tokio::sync::{mpsc, oneshot};
use tokio::task::{Id, JoinError, JoinSet};
use tokio::time::{Instant, MissedTickBehavior, interval_at, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

/// A daemon whose sockets are bound and whose files are open: nothing that can be wrong with its settings is left.
#[derive(Debug)]
pub struct Daemon {
    settings: Settings,
    links: Vec<Bound>,
    recorder: Option<(RecorderHandle, Recorder<Folder>)>,
}

#[derive(Debug)]
enum Bound {
    Udp(Arc<UdpLink>),
    Log(LogLink),
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The last state of everything.
    pub status: Status,
    /// Parts that had not stopped by the deadline.
    pub stragglers: Vec<String>,
}

impl Daemon {
    /// Binds every socket and opens every file.
    ///
    /// # Errors
    /// The first link or directory that cannot be opened, and why.
    pub async fn bind(settings: Settings) -> Result<Self, DaemonError> {
        let mut links = Vec::with_capacity(settings.links.len());
        for link in &settings.links {
            let name = link.name.clone();
            links.push(match &link.url {
                LinkUrl::UdpIn { host, port } => Bound::Udp(Arc::new(UdpLink::listen(name, host, *port).await?)),
                LinkUrl::UdpOut { host, port } => Bound::Udp(Arc::new(UdpLink::speak_to(name, host, *port).await?)),
                LinkUrl::Tlog { path, pace } => Bound::Log(LogLink::open(name, path, *pace)?),
            });
        }
        let names = || settings.links.iter().map(|l| l.name.clone()).collect();
        let recorder =
            settings.record.as_ref().map(|r| Recorder::create(&r.directory, r.policy, names())).transpose()?;
        Ok(Self { settings, links, recorder })
    }

    /// The address that a UDP link is bound to.
    pub fn local_addr(&self, link: LinkId) -> Option<SocketAddr> {
        match self.links.get(link.0)? {
            Bound::Udp(udp) => udp.local_addr(),
            Bound::Log(_) => None,
        }
    }

    /// Runs until `stop`, or until every link has ended, which only logs do.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub async fn run<E: Estimator>(self, estimator: E, stop: CancellationToken) -> Result<Summary, DaemonError> {
        let Self { settings, links, recorder } = self;
        let outlets: Vec<_> = links
            .iter()
            .map(|link| match link {
                Bound::Udp(udp) => Outlet::Udp(Arc::clone(udp)),
                Bound::Log(_) => Outlet::Log,
            })
            .collect();
        let names: Vec<_> = settings.links.iter().map(|l| l.name.clone()).collect();
        let router = Arc::new(Router::new(outlets.clone()));
        let board = Arc::new(Board::new(names, outlets));

        let (handle, recording) = match recorder {
            Some((handle, recorder)) => {
                board.recording(handle.state());
                (Some(handle), Some(Stage::start("recorder", move || recorder.run())?))
            }
            None => (None, None),
        };
        let (sender, queue) = mpsc::channel::<Work>(ESTIMATOR_QUEUE);
        let talking = settings.links.iter().enumerate().filter(|(_, l)| !matches!(l.url, LinkUrl::Tlog { .. }));
        let talking = talking.map(|(i, l)| (LinkId(i), l.output)).collect();
        let voice = Voice::new(Arc::clone(&router), talking, handle.clone());
        let worker = Worker::new(estimator, voice, settings.requests.clone(), Arc::clone(&board));
        let estimating = Stage::start("estimator", move || worker.run(queue))?;

        // the links own every handle from here on, so the stages behind them end when the links have
        let inlet = Inlet { link: LinkId(0), router, recorder: handle, estimator: sender, board: Arc::clone(&board) };
        let closing = stop.child_token();
        let mut running = Links::start(links, &inlet, &closing);
        drop(inlet);

        let mut lines = StatusLines::new(board.status());
        let mut tick = interval_at(Instant::now() + settings.status_every, settings.status_every);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => break,
                open = running.next_ended() => if !open { break },
                _ = tick.tick() => lines.log(board.status()),
            }
        }

        let deadline = Instant::now() + settings.stop_within;
        closing.cancel();
        let mut stragglers = running.close(deadline).await;
        for stage in [Some(estimating), recording].into_iter().flatten() {
            stragglers.extend(stage.finish(deadline).await);
        }
        for straggler in &stragglers {
            warn!("{straggler} did not stop within {:?}", settings.stop_within);
        }
        Ok(Summary { status: board.status(), stragglers })
    }
}

/// The tasks of the links, by name.
struct Links {
    tasks: JoinSet<Result<(), String>>,
    names: HashMap<Id, String>,
}

impl Links {
    fn start(links: Vec<Bound>, inlet: &Inlet, stop: &CancellationToken) -> Self {
        let mut this = Self { tasks: JoinSet::new(), names: HashMap::new() };
        for (index, link) in links.into_iter().enumerate() {
            let inlet = Inlet { link: LinkId(index), ..inlet.clone() };
            let stop = stop.clone();
            let (name, task) = match link {
                Bound::Udp(udp) => (udp.name().to_owned(), {
                    this.tasks.spawn(async move { udp.receive(inlet, stop).await.map_err(|e| e.to_string()) })
                }),
                Bound::Log(log) => (log.name().to_owned(), {
                    this.tasks.spawn(async move { log.play(inlet, stop).await.map_err(|e| e.to_string()) })
                }),
            };
            this.names.insert(task.id(), name);
        }
        this
    }

    /// Waits for a link to end, and tells how; false if there are none left.
    async fn next_ended(&mut self) -> bool {
        let Some(ended) = self.tasks.join_next_with_id().await else { return false };
        let name = self.names.remove(&ended.as_ref().map_or_else(JoinError::id, |(id, _)| *id)).unwrap_or_default();
        match ended {
            Ok((_, Ok(()))) => info!(link = name, "ended"),
            Ok((_, Err(error))) => error!(link = name, "failed: {error}; the other links go on"),
            Err(error) => error!(link = name, "stopped by a defect: {error}; the other links go on"),
        }
        true
    }

    /// Waits for all links; those that still run at the deadline are aborted and named.
    async fn close(mut self, deadline: Instant) -> Vec<String> {
        while let Ok(true) = timeout_at(deadline, self.next_ended()).await {}
        self.tasks.abort_all();
        self.names.into_values().map(|name| format!("link {name}")).collect()
    }
}

/// A thread that ends by itself when its input does.
struct Stage {
    name: &'static str,
    done: oneshot::Receiver<()>,
}

impl Stage {
    fn start(name: &'static str, body: impl FnOnce() + Send + 'static) -> Result<Self, DaemonError> {
        let (sender, done) = oneshot::channel();
        let run = move || {
            body();
            // nobody listens after the deadline
            let _ = sender.send(());
        };
        thread::Builder::new().name(name.into()).spawn(run).map_err(|source| DaemonError::Thread { name, source })?;
        Ok(Self { name, done })
    }

    /// Waits for the end; the name of a stage that is late.
    async fn finish(self, deadline: Instant) -> Option<String> {
        match timeout_at(deadline, self.done).await {
            Ok(Ok(())) => None,
            Ok(Err(_)) => {
                error!("the {} was stopped by a defect", self.name);
                None
            }
            Err(_) => Some(format!("the {}", self.name)),
        }
    }
}
