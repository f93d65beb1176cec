//! Starting and stopping everything.

use super::batches::{self, Sender, Wake};
use super::estimator::{Estimator, Requests, Voice, Work, Worker};
use super::farewell::Farewell;
use super::guard::Guard;
use super::inlet::Inlet;
use super::keeper::Keeper;
use super::links::{Bound, Outlet};
use super::metrics;
use super::recorder::{Recorder, RecorderHandle};
use super::router::{LinkId, Router};
use super::settings::Settings;
use super::status::{Board, Status, StatusLines};
use super::{DaemonError, ESTIMATOR_QUEUE};
use crate::config::{Link, LinkUrl};
use crate::record::session::Folder;
use crate::routing::Rules;
use crate::wire::stats::LinkStats;
use std::collections::HashMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::task::{Id, JoinError, JoinSet};
use tokio::time::{Instant, MissedTickBehavior, interval_at, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

/// A daemon whose ports are bound and whose files are open, as far as they are there: what waiting would not mend has
/// been told.
#[derive(Debug)]
pub struct Daemon {
    settings: Settings,
    links: Vec<Bound>,
    router: Arc<Router>,
    board: Arc<Board>,
    recorder: Option<(RecorderHandle, Recorder<Folder>)>,
    metrics: Option<TcpListener>,
    keeper: Keeper,
}

/// Looks into a daemon that runs, and changes what may change meanwhile.
#[derive(Debug, Clone)]
pub struct Control {
    router: Arc<Router>,
    board: Arc<Board>,
}

impl Control {
    /// Everything as it is now.
    pub fn status(&self) -> Status {
        self.board.status()
    }

    /// What each link received so far, in their order.
    pub fn traffic(&self) -> Vec<LinkStats> {
        self.board.traffic()
    }

    /// Other filters, limits and groups for the links, in their order, and another window for duplicates, from now on.
    /// No link is touched.
    pub fn set_rules(&self, rules: Vec<Rules>, duplicates: Duration) {
        self.router.set_rules(rules, duplicates);
    }
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
    /// Binds every port and opens every file that is there. What is not there yet is waited for once the daemon runs.
    ///
    /// # Errors
    /// The first port that another program holds, log that cannot be read, or directory that cannot be written.
    pub async fn bind(mut settings: Settings) -> Result<Self, DaemonError> {
        let parameters = settings.parameters.clone();
        let outputs = settings.links.iter_mut().map(|link| &mut link.output);
        let keeper = Keeper::open(parameters.as_deref(), outputs)
            .map_err(|source| DaemonError::Parameters { path: parameters.unwrap_or_default(), source })?;
        let mut links = Vec::with_capacity(settings.links.len());
        for link in &settings.links {
            links.push(Bound::bind(link).await?);
        }
        let link_names = || settings.links.iter().map(|l| l.name.clone()).collect();
        let recorder =
            settings.record.as_ref().map(|r| Recorder::create(&r.directory, r.policy, link_names())).transpose()?;
        let metrics = match settings.metrics {
            Some(address) => {
                let failed = |source| DaemonError::Metrics { address, source };
                let listener = TcpListener::bind(address).await.map_err(failed)?;
                info!("metrics at http://{}/metrics", listener.local_addr().unwrap_or(address));
                Some(listener)
            }
            None => None,
        };
        let outlets: Vec<Outlet> = links.iter().map(Bound::outlet).collect();
        let rules = settings.links.iter().map(|l| l.rules.clone()).collect();
        let guard = |link: &Link| {
            let open = |signing| Guard::open(&link.name, signing);
            let failed = |source| DaemonError::Times { link: link.name.clone(), source };
            link.signing.as_ref().map(open).transpose().map_err(failed)
        };
        let guards = settings.links.iter().map(guard).collect::<Result<_, _>>()?;
        let router = Arc::new(Router::new(outlets.clone(), guards, rules, settings.duplicates));
        let names = settings.links.iter().map(|l| l.name.clone()).collect();
        let board = Arc::new(Board::new(names, outlets, Arc::clone(&router)));
        Ok(Self { settings, links, router, board, recorder, metrics, keeper })
    }

    /// The address that a UDP or TCP port is bound to.
    pub fn local_addr(&self, link: LinkId) -> Option<SocketAddr> {
        self.links.get(link.0)?.local_addr()
    }

    /// A handle that stays valid while the daemon runs.
    pub fn control(&self) -> Control {
        Control { router: Arc::clone(&self.router), board: Arc::clone(&self.board) }
    }

    /// Runs until `stop`, or until every link has ended, which only logs do. Without an estimator it is a bridge.
    ///
    /// # Errors
    /// A thread cannot be started.
    pub async fn run<E: Estimator>(
        self,
        estimator: Option<E>,
        stop: CancellationToken,
    ) -> Result<Summary, DaemonError> {
        let control = self.control();
        let times = Arc::clone(&self.router);
        let Self { settings, links, router, board, recorder, metrics, keeper } = self;
        let farewell = Arc::new(Farewell::default());
        let (handle, recording) = match recorder {
            Some((handle, recorder)) => {
                board.recording(handle.state());
                (Some(handle), Some(Stage::start("recorder", move || recorder.run())?))
            }
            None => (None, None),
        };
        let (sender, estimating) = match estimator {
            Some(estimator) => {
                let (sender, stage) = {
                    let voice = voice(&settings, &router, handle.clone(), keeper);
                    estimate(estimator, voice, &settings, &board, &farewell)?
                };
                (Some(sender), Some(stage))
            }
            None => (None, None),
        };

        let serving = CancellationToken::new();
        let _stop_serving = serving.clone().drop_guard();
        if let Some(listener) = metrics {
            tokio::spawn(metrics::serve(listener, control, serving));
        }

        // the links own every handle from here on, so the stages behind them end when the links have
        let inlet = Inlet::new(router, handle, sender, Arc::clone(&board));
        let closing = stop.child_token();
        let names = settings.links.iter().map(|l| l.name.clone()).collect();
        let mut running = Links::start(links, names, &inlet, &closing);
        drop(inlet);

        let mut lines = StatusLines::new(board.status());
        let mut tick = interval_at(Instant::now() + settings.status_every, settings.status_every);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        loop {
            tokio::select! {
                () = stop.cancelled() => break,
                open = running.next_ended() => if !open { break },
                _ = tick.tick() => {
                    lines.log(board.status());
                    times.keep_times();
                }
            }
        }

        farewell.leave().await;
        let deadline = Instant::now() + settings.stop_within;
        closing.cancel();
        let mut stragglers = running.close(deadline).await;
        for stage in [estimating, recording].into_iter().flatten() {
            stragglers.extend(stage.finish(deadline).await);
        }
        times.keep_times();
        for straggler in &stragglers {
            warn!("{straggler} did not stop within {:?}", settings.stop_within);
        }
        Ok(Summary { status: board.status(), stragglers })
    }
}

/// Our messages to every live link.
fn voice(settings: &Settings, router: &Arc<Router>, recorder: Option<RecorderHandle>, keeper: Keeper) -> Voice {
    let talking = settings.links.iter().enumerate().filter(|(_, l)| !matches!(l.url, LinkUrl::Tlog { .. }));
    let talking = talking.map(|(i, l)| (LinkId(i), l.output)).collect();
    Voice::new(Arc::clone(router), talking, recorder, keeper)
}

/// Starts the thread of the observers.
fn estimate<E: Estimator>(
    estimator: E,
    voice: Voice,
    settings: &Settings,
    board: &Arc<Board>,
    farewell: &Arc<Farewell>,
) -> Result<(Sender<Work>, Stage), DaemonError> {
    let (sender, queue) = batches::channel::<Work>(ESTIMATOR_QUEUE, Wake::AtOnce);
    let requests = settings.requests.clone().map(|needs| Requests { needs, models: settings.models.clone() });
    let worker = Worker::new(estimator, voice, requests, Arc::clone(board), Arc::clone(farewell));
    Ok((sender, Stage::start("estimator", move || worker.run(queue))?))
}

/// The tasks of the links, by name.
struct Links {
    tasks: JoinSet<Result<(), String>>,
    names: HashMap<Id, String>,
}

impl Links {
    fn start(links: Vec<Bound>, names: Vec<String>, inlet: &Inlet, stop: &CancellationToken) -> Self {
        let mut this = Self { tasks: JoinSet::new(), names: HashMap::new() };
        // before any link runs: the first frame of a log must not come too early for another
        for (index, _) in links.iter().enumerate().filter(|(_, link)| link.is_open()) {
            inlet.of(LinkId(index)).open(None);
        }
        for (index, (link, name)) in links.into_iter().zip(names).enumerate() {
            let task = this.tasks.spawn(link.run(inlet.of(LinkId(index)), stop.clone()));
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
