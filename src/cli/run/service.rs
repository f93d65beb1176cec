//! What a service manager and an operator tell a running daemon, and what they are told.

use crate::cli::Failure;
use crate::config::Config;
use crate::daemon::{Control, DaemonError, Summary};
use crate::routing::Rules;
use std::time::Duration;
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

/// How the rules of the links are read again.
pub(super) struct Reload<R> {
    pub(super) control: Control,
    /// The links that run, in their order.
    pub(super) names: Vec<String>,
    pub(super) read: R,
}

impl<R: Fn() -> Result<Config, Failure>> Reload<R> {
    /// Reads the config again and applies what may change while links run. A config with mistakes changes nothing. Gives
    /// what became of it, in a few words.
    fn apply(&self) -> &'static str {
        let config = match (self.read)() {
            Ok(config) => config,
            Err(error) => {
                error!("the config is not taken over: {error}");
                return "running by the config of before: the new one has mistakes";
            }
        };
        let mut rules = Vec::with_capacity(self.names.len());
        for name in &self.names {
            let found = config.links.iter().find(|link| link.name == *name);
            if found.is_none() {
                warn!(link = name, "the config no longer has this link; it runs on, without rules, until a restart");
            }
            rules.push(found.map_or_else(Rules::default, |link| link.rules.clone()));
        }
        for link in config.links.iter().filter(|link| !self.names.contains(&link.name)) {
            warn!(link = link.name, "a new link starts with the next restart");
        }
        self.control.set_rules(rules, config.duplicates);
        info!("filters, rate limits and groups are as the config says now");
        "reloaded"
    }
}

/// Runs the daemon to its end: SIGINT (Ctrl-C) or SIGTERM set `stop`, SIGHUP reloads. A service manager is told when it
/// runs, that it still does, and when it stops.
pub(super) async fn until_stopped<R: Fn() -> Result<Config, Failure>>(
    running: impl Future<Output = Result<Summary, DaemonError>>,
    stop: CancellationToken,
    reload: Reload<R>,
) -> Result<Summary, Failure> {
    let mut signals = Signals::listen().map_err(|e| Failure::Failed(format!("cannot listen for signals: {e}")))?;
    let mut running = std::pin::pin!(running);
    let mut alive = tokio::time::interval(manager::alive_every());
    manager::tell_ready(&format!("{} links", reload.names.len()));
    loop {
        tokio::select! {
            ended = &mut running => return Ok(ended?),
            _ = alive.tick() => manager::tell_alive(),
            signal = signals.next() => match signal {
                Signal::Stop(name) => {
                    info!("{name}: stopping");
                    manager::tell_stopping();
                    stop.cancel();
                }
                Signal::Reload => {
                    manager::tell_reloading();
                    manager::tell_ready(reload.apply());
                }
            },
        }
    }
}

enum Signal {
    Stop(&'static str),
    Reload,
}

impl Signals {
    /// Waits until somebody wants an end.
    pub(super) async fn stop(&mut self) {
        while let Signal::Reload = self.next().await {}
    }
}

#[cfg(unix)]
pub(super) struct Signals {
    terminate: tokio::signal::unix::Signal,
    interrupt: tokio::signal::unix::Signal,
    hangup: tokio::signal::unix::Signal,
}

#[cfg(unix)]
impl Signals {
    pub(super) fn listen() -> std::io::Result<Self> {
        use tokio::signal::unix::{SignalKind, signal};
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
            hangup: signal(SignalKind::hangup())?,
        })
    }

    async fn next(&mut self) -> Signal {
        tokio::select! {
            _ = self.terminate.recv() => Signal::Stop("SIGTERM"),
            _ = self.interrupt.recv() => Signal::Stop("interrupted"),
            _ = self.hangup.recv() => Signal::Reload,
        }
    }
}

#[cfg(not(unix))]
pub(super) struct Signals;

#[cfg(not(unix))]
impl Signals {
    pub(super) fn listen() -> std::io::Result<Self> {
        Ok(Self)
    }

    async fn next(&mut self) -> Signal {
        match tokio::signal::ctrl_c().await {
            Ok(()) => Signal::Stop("interrupted"),
            Err(_) => std::future::pending().await,
        }
    }
}

/// The systemd notification protocol. Nothing happens where no manager listens.
#[cfg(unix)]
mod manager {
    use super::Duration;
    use sd_notify::NotifyState;
    use tracing::debug;

    fn tell(states: &[NotifyState<'_>]) {
        if let Err(error) = sd_notify::notify(states) {
            debug!("the service manager cannot be told: {error}");
        }
    }

    pub(super) fn tell_ready(status: &str) {
        tell(&[NotifyState::Ready, NotifyState::Status(status)]);
    }

    pub(super) fn tell_reloading() {
        match NotifyState::monotonic_usec_now() {
            Ok(now) => tell(&[NotifyState::Reloading, now]),
            Err(error) => debug!("no clock for the service manager: {error}"),
        }
    }

    pub(super) fn tell_stopping() {
        tell(&[NotifyState::Stopping]);
    }

    pub(super) fn tell_alive() {
        if sd_notify::watchdog_enabled().is_some() {
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// Twice within the time that the manager allows.
    pub(super) fn alive_every() -> Duration {
        sd_notify::watchdog_enabled()
            .map_or(Duration::from_secs(60), |within| within / 2)
            .max(Duration::from_millis(10))
    }
}

#[cfg(not(unix))]
mod manager {
    use super::Duration;

    pub(super) fn tell_ready(_: &str) {}

    pub(super) fn tell_reloading() {}

    pub(super) fn tell_stopping() {}

    pub(super) fn tell_alive() {}

    pub(super) fn alive_every() -> Duration {
        Duration::from_secs(60)
    }
}
