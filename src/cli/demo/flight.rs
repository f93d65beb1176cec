use crate::cli::Failure;
use crate::cli::sim::Air;
use crate::config::LinkUrl;
use crate::daemon::lock;
use crate::evaluate::TruthTrack;
use crate::outputs::OutputSettings;
use crate::signal::Stamp;
use crate::sim::control;
use crate::sim::dynamics::Truth;
use crate::sim::scenario::Scenario;
use crate::sim::{Run, RunOptions};
use crate::wire::{Event, datagram};
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The simulated vehicle, flying at its own pace in a thread of its own, and the truth about it.
pub(super) struct Flight {
    shared: Arc<Shared>,
    thread: std::thread::JoinHandle<()>,
    pub duration_s: f64,
}

/// What a flight sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sent {
    pub frames: u64,
    /// Those of them that only the daemon gets: answers to what it asked.
    pub answers: u64,
}

#[derive(Default)]
struct Shared {
    track: Mutex<TruthTrack>,
    now: Mutex<Option<(Stamp, Truth)>>,
    /// When it had left the ground, on the boot clock.
    airborne_since: Mutex<Option<Stamp>>,
    frames: AtomicU64,
    answers: AtomicU64,
    done: AtomicBool,
}

impl Flight {
    pub fn start(scenario: &Scenario, daemon: SocketAddr) -> Result<Self, Failure> {
        let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let options = RunOptions { unix_start_us: unix.as_micros() as u64, ..RunOptions::default() };
        let run = Run::new(scenario, &options).map_err(|e| Failure::Usage(e.to_string()))?;
        let air = Air::open(&[LinkUrl::UdpOut { host: daemon.ip().to_string(), port: daemon.port() }])?;
        let shared = Arc::new(Shared::default());
        let theirs = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("simulator".to_owned())
            .spawn(move || fly(run, air, &theirs))
            .map_err(|e| Failure::Failed(format!("cannot start the simulator's thread: {e}")))?;
        Ok(Self { shared, thread, duration_s: scenario.duration_s })
    }

    pub fn done(&self) -> bool {
        self.shared.done.load(Ordering::Acquire)
    }

    /// The truth at a boot time, when the vehicle was in the air.
    pub fn truth(&self, stamp: Stamp) -> Option<Truth> {
        let airborne = (*lock(&self.shared.airborne_since)).is_some_and(|since| stamp >= since);
        if airborne { lock(&self.shared.track).at(stamp).copied().filter(|t| !t.on_ground) } else { None }
    }

    /// The newest truth, and its boot time.
    pub fn now(&self) -> Option<(Stamp, Truth)> {
        *lock(&self.shared.now)
    }

    /// Waits for the end; gives the number of frames sent.
    pub fn finish(self) -> Result<Sent, Failure> {
        self.thread.join().map_err(|_| Failure::Failed("the simulator's thread panicked".to_owned()))?;
        let count = |counter: &AtomicU64| counter.load(Ordering::Acquire);
        Ok(Sent { frames: count(&self.shared.frames), answers: count(&self.shared.answers) })
    }
}

fn fly(mut run: Run, mut air: Air, shared: &Shared) {
    let started = Instant::now();
    while !run.done() {
        air.listen(|frame| run.receive(frame));
        run.advance(&mut |received| {
            air.send(received.bytes);
            shared.frames.fetch_add(1, Ordering::Relaxed);
            if datagram(received.bytes).any(|event| answers_the_daemon(&event)) {
                shared.answers.fetch_add(1, Ordering::Relaxed);
            }
        });
        let boot = Stamp::from_secs(run.boot_s(0));
        if let Some(moment) = run.moment(0) {
            lock(&shared.track).push(boot, moment.truth);
            *lock(&shared.now) = Some((boot, moment.truth));
            if moment.flight == control::Flight::Flying {
                lock(&shared.airborne_since).get_or_insert(boot);
            }
        }
        std::thread::sleep(Duration::from_secs_f64(run.now_s()).saturating_sub(started.elapsed()));
    }
    shared.done.store(true, Ordering::Release);
}

fn answers_the_daemon(event: &Event<'_>) -> bool {
    let Event::Frame(frame) = event else { return false };
    frame.target().is_some_and(|(_, component)| component == OutputSettings::COMPONENT)
}
