use super::Air;
use crate::cli::Failure;
use crate::sim::{Received, Run};
use std::time::{Duration, Instant};

/// Holds simulated time until the ground station has received everything up to it.
///
/// After every slice of simulated time the first vehicle sends a TIMESYNC request addressed to the station, behind all
/// frames of the slice. Datagrams keep their order on one machine, so an answer tells that these have arrived.
pub(super) struct Lockstep {
    slice_s: f64,
    until_s: f64,
    slices: u64,
    waited: Duration,
}

/// An answer that does not come is asked for again...
const ASK_AGAIN: Duration = Duration::from_millis(200);
/// ...and given up after this long.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time between two looks at the sockets.
const LOOK: Duration = Duration::from_micros(50);

impl Lockstep {
    pub fn new(slice_s: f64) -> Self {
        Self { slice_s, until_s: 0.0, slices: 0, waited: Duration::ZERO }
    }

    /// Slices that were waited for, and the time that took.
    pub fn waited(&self) -> (u64, Duration) {
        (self.slices, self.waited)
    }

    /// Waits when a slice is full. False while no station has spoken yet: then there is nobody to wait for.
    pub fn hold(&mut self, run: &mut Run, air: &mut Air, sent: &mut dyn FnMut(Received<'_>)) -> Result<bool, Failure> {
        let Some(station) = air.station() else { return Ok(false) };
        if run.now_s() + 1e-9 < self.until_s {
            return Ok(true);
        }
        self.until_s = run.now_s() + self.slice_s;
        let began = Instant::now();
        let mut asked: Option<(i64, Instant)> = None;
        loop {
            if asked.is_none_or(|(_, at)| at.elapsed() >= ASK_AGAIN) {
                let probe = run.probe(station, &mut |received| {
                    air.send(received.bytes);
                    sent(received);
                });
                asked = probe.map(|probe| (probe, Instant::now()));
            }
            air.listen(|frame| run.receive(frame));
            if asked.is_some_and(|(probe, _)| run.answered(probe)) {
                break;
            }
            if began.elapsed() > PATIENCE {
                let (system, component) = station;
                return Err(Failure::Failed(format!(
                    "station {system}/{component} has not answered TIMESYNC for {} s; lock-step needs a station that does",
                    PATIENCE.as_secs()
                )));
            }
            std::thread::sleep(LOOK);
        }
        self.slices += 1;
        self.waited += began.elapsed();
        Ok(true)
    }
}
