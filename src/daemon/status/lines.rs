use super::{LinkStatus, SourceStatus, Status, VehicleStatus};
use crate::signal::Verdict;
use std::fmt::{self, Write};
use std::time::Instant;
use tracing::{debug, info};

/// Writes a line for each link and vehicle: what happened since the lines before.
#[derive(Debug)]
pub(in crate::daemon) struct StatusLines {
    last: Status,
    at: Instant,
}

impl StatusLines {
    pub(in crate::daemon) fn new(status: Status) -> Self {
        Self { last: status, at: Instant::now() }
    }

    pub(in crate::daemon) fn log(&mut self, now: Status) {
        for (link, source) in now.links.iter().flat_map(|l| l.sources.iter().map(move |s| (l, s))) {
            debug!("link {}: {source}", link.name);
        }
        for line in self.lines(now, Instant::now()) {
            info!("{line}");
        }
    }

    fn lines(&mut self, now: Status, at: Instant) -> Vec<String> {
        let seconds = at.duration_since(self.at).as_secs_f64().max(1e-3);
        let mut lines = Vec::new();
        for (link, last) in now.links.iter().zip(&self.last.links) {
            lines.push(link.line(last, seconds));
        }
        for (id, vehicle) in &now.vehicles {
            let before = self.last.vehicles.get(id).map_or(0, |v| v.snapshots);
            let hz = vehicle.snapshots.saturating_sub(before) as f64 / seconds;
            lines.push(format!("vehicle {id}: {vehicle}, {hz:.0} estimates/s"));
        }
        let missed = now.estimator_missed - self.last.estimator_missed;
        if missed > 0 {
            lines.push(format!("the estimator was too slow for {missed} frames"));
        }
        if let Some(recording) = now.recording {
            let end = if recording.stopped { ", stopped by an error" } else { "" };
            lines.push(format!("recording: {} frames, {} missed{end}", recording.frames, recording.missed));
        }
        (self.last, self.at) = (now, at);
        lines
    }
}

impl LinkStatus {
    fn line(&self, last: &Self, seconds: f64) -> String {
        let per_second = |now: u64, before: u64| now.saturating_sub(before) as f64 / seconds;
        let mut line = format!("link {}: ", self.name);
        // writing into a String cannot fail
        if let Some(why) = &self.down {
            let _ = write!(line, "down ({why}), ");
        }
        let _ = write!(line, "in {:.0} frames/s", per_second(self.frames_in, last.frames_in));
        if self.bad_in > last.bad_in {
            let _ = write!(line, " and {} bad", self.bad_in - last.bad_in);
        }
        if self.lost_in > last.lost_in {
            let _ = write!(line, ", {} lost", self.lost_in - last.lost_in);
        }
        if self.refused_in > last.refused_in {
            let _ = write!(line, ", {} refused by their signatures", self.refused_in - last.refused_in);
        }
        if self.overrun_in > last.overrun_in {
            let _ = write!(line, ", {} not taken in time", self.overrun_in - last.overrun_in);
        }
        let _ = write!(line, ", out {:.0} frames/s", per_second(self.frames_out, last.frames_out));
        let _ = write!(line, " to {} peer{}", self.peers, if self.peers == 1 { "" } else { "s" });
        if self.dropped_out > last.dropped_out {
            let _ = write!(line, ", {} dropped", self.dropped_out - last.dropped_out);
        }
        if self.strangers > last.strangers {
            let _ = write!(line, ", {} datagrams of strangers", self.strangers - last.strangers);
        }
        line
    }
}

impl fmt::Display for SourceStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { source, frames, bytes, lost, rate_hz, jitter_s } = self;
        let jitter_ms = jitter_s * 1e3;
        write!(f, "{source} sent {frames} frames, {bytes} bytes, {lost} lost, {rate_hz:.1} Hz \u{b1} {jitter_ms:.1} ms")
    }
}

impl fmt::Display for VehicleStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(verdict_name(self.verdict))?;
        if let Some(wind) = &self.wind {
            let velocity = wind.velocity_ned_mps;
            let from = (-velocity.y).atan2(-velocity.x).to_degrees().rem_euclid(360.0);
            let width = wind.half_width_mps.xy().max();
            write!(f, ", wind {:.1} \u{b1} {width:.1} m/s from {from:.0}\u{b0}", velocity.xy().norm())?;
        }
        if let Some(wrench) = &self.wrench {
            let width = wrench.force_half_width_n.max();
            write!(f, ", force {:.1} \u{b1} {width:.1} N", wrench.force_ned_n.norm())?;
        }
        Ok(())
    }
}

/// A verdict as a person reads it.
pub(in crate::daemon) fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Consistent => "consistent",
        Verdict::Settling => "settling",
        Verdict::AssumptionViolated => "assumption violated",
        Verdict::Starved => "starved",
        Verdict::Grounded => "on the ground",
    }
}
