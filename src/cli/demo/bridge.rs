use crate::cli::{Failure, run};
use crate::config::{Config, LinkUrl, Recording};
use crate::daemon::{Daemon, LinkId};
use crate::record::session::Policy;
use crate::vehicle::Vehicle;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tokio_util::sync::CancellationToken;

/// The daemon, on two free ports, in a thread of its own.
pub(super) struct Bridge {
    stop: CancellationToken,
    thread: std::thread::JoinHandle<Result<(), Failure>>,
    vehicle_side: SocketAddr,
    ground_side: SocketAddr,
    out: PathBuf,
    before: Vec<PathBuf>,
}

impl Bridge {
    pub fn start(model: Arc<Vehicle>, out: &Path) -> Result<Self, Failure> {
        let mut config = Config::default();
        config.vehicles.default = Some(Arc::clone(&model));
        config.record = Some(Recording { directory: out.to_owned(), policy: Policy::default() });
        for name in ["vehicle", "ground"] {
            config.add_link(LinkUrl::UdpIn { host: "127.0.0.1".to_owned(), port: 0 });
            if let Some(link) = config.links.last_mut() {
                link.name = name.to_owned();
            }
        }
        let settings = run::settings(&config)?;
        let fleet = config.fleet().ok_or_else(|| Failure::Failed("no vehicle model".to_owned()))?;
        let fleet = run::build_fleet(fleet)?;
        let before = logs(out);
        let runtime = run::async_runtime(1)?;
        let daemon = runtime.block_on(Daemon::bind(settings))?;
        let address =
            |link| daemon.local_addr(LinkId(link)).ok_or_else(|| Failure::Failed("a link has no address".to_owned()));
        let (vehicle_side, ground_side) = (address(0)?, address(1)?);
        let stop = CancellationToken::new();
        let token = stop.clone();
        let thread = std::thread::Builder::new()
            .name("daemon".to_owned())
            .spawn(move || {
                let outcome = runtime.block_on(daemon.run(Some(fleet), token)).map(|_| ()).map_err(Failure::from);
                runtime.shutdown_background();
                outcome
            })
            .map_err(|e| Failure::Failed(format!("cannot start the daemon's thread: {e}")))?;
        Ok(Self { stop, thread, vehicle_side, ground_side, out: out.to_owned(), before })
    }

    pub fn vehicle_side(&self) -> SocketAddr {
        self.vehicle_side
    }

    pub fn ground_side(&self) -> SocketAddr {
        self.ground_side
    }

    /// Stops the daemon; gives the recordings that it wrote.
    pub fn stop(self) -> Result<Vec<PathBuf>, Failure> {
        self.stop.cancel();
        match self.thread.join() {
            Ok(outcome) => outcome?,
            Err(_) => return Err(Failure::Failed("the daemon's thread panicked".to_owned())),
        }
        Ok(logs(&self.out).into_iter().filter(|log| !self.before.contains(log)).collect())
    }
}

/// The recordings in a directory, by name.
fn logs(directory: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(directory).into_iter().flatten().flatten().map(|e| e.path());
    let recording = |p: &PathBuf| p.extension().is_some_and(|e| e == "tlog" || e == "mcap");
    let mut found: Vec<_> = entries.filter(recording).collect();
    found.sort();
    found
}
