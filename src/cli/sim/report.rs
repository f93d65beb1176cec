use crate::sim::control::Flight;
use crate::sim::scenario::Scenario;
use crate::sim::{Received, Run};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;
use std::time::Duration;

/// What a run came to.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    scenario: String,
    description: String,
    seed: u64,
    simulated_s: f64,
    wall_s: f64,
    times_real_time: f64,
    frames: u64,
    bytes: u64,
    dropped_datagrams: u64,
    /// Slices that lock-step waited for, and the mean wait.
    lockstep_slices: Option<u64>,
    lockstep_wait_ms: Option<f64>,
    vehicles: Vec<VehicleReport>,
}

#[derive(Debug, Clone, Serialize)]
struct VehicleReport {
    system: u8,
    airborne_s: f64,
    highest_m: f64,
    strongest_wind_mps: f64,
    frames: u64,
    /// `flying`, `landed` or `crashed`.
    end: &'static str,
    #[serde(skip)]
    was_landing: bool,
}

impl Report {
    pub fn new(scenario: &Scenario) -> Self {
        let vehicle = |system| VehicleReport {
            system,
            airborne_s: 0.0,
            highest_m: 0.0,
            strongest_wind_mps: 0.0,
            frames: 0,
            end: "on the ground",
            was_landing: false,
        };
        Self {
            scenario: scenario.name.clone(),
            description: scenario.description.clone(),
            seed: scenario.seed(),
            simulated_s: 0.0,
            wall_s: 0.0,
            times_real_time: 0.0,
            frames: 0,
            bytes: 0,
            dropped_datagrams: 0,
            lockstep_slices: None,
            lockstep_wait_ms: None,
            vehicles: (1..=scenario.vehicles).map(vehicle).collect(),
        }
    }

    pub fn received(&mut self, received: &Received<'_>) {
        self.frames += 1;
        self.bytes += received.bytes.len() as u64;
        if let Some(v) = self.vehicles.get_mut(usize::from(received.vehicle)) {
            v.frames += 1;
        }
    }

    pub fn observe(&mut self, run: &Run) {
        for (index, v) in self.vehicles.iter_mut().enumerate() {
            let Some(moment) = run.moment(index as u8) else { continue };
            v.highest_m = v.highest_m.max(-moment.truth.position_ned_m.z);
            v.strongest_wind_mps = v.strongest_wind_mps.max(moment.truth.wind_ned_mps.norm());
            if !moment.truth.on_ground {
                v.airborne_s += run.loop_s();
            }
            v.end = match moment.flight {
                Flight::Disarmed if v.was_landing => "landed",
                // motors off without a landing, after having flown
                Flight::Disarmed if v.airborne_s > 0.5 => "crashed",
                Flight::Disarmed => "on the ground",
                Flight::TakingOff | Flight::Flying | Flight::Landing => "flying",
            };
            v.was_landing |= moment.flight == Flight::Landing;
        }
    }

    pub fn finish(
        mut self,
        run: &Run,
        wall: Duration,
        json: bool,
        dropped_datagrams: u64,
        waited: Option<(u64, Duration)>,
    ) -> String {
        self.lockstep_slices = waited.map(|(slices, _)| slices);
        self.lockstep_wait_ms = waited.map(|(slices, wait)| wait.as_secs_f64() * 1e3 / slices.max(1) as f64);
        self.simulated_s = run.now_s();
        self.wall_s = wall.as_secs_f64();
        self.times_real_time = self.simulated_s / self.wall_s.max(1e-9);
        self.dropped_datagrams = dropped_datagrams;
        if json {
            return serde_json::to_string_pretty(&self).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"));
        }
        self.text()
    }

    fn text(&self) -> String {
        let mut lines = vec![
            format!("{}: {}", self.scenario, self.description),
            format!(
                "{:.1} s simulated in {:.2} s ({:.0} times real time), seed {}; {} frames, {:.1} kB",
                self.simulated_s,
                self.wall_s,
                self.times_real_time,
                self.seed,
                self.frames,
                self.bytes as f64 * 1e-3
            ),
        ];
        if self.dropped_datagrams > 0 {
            lines.push(format!("{} datagrams did not fit into the socket and were dropped", self.dropped_datagrams));
        }
        if let Some((slices, wait_ms)) = self.lockstep_slices.zip(self.lockstep_wait_ms) {
            lines.push(format!("lock-step: {slices} slices, each waited for {wait_ms:.2} ms"));
        }
        for v in &self.vehicles {
            lines.push(format!(
                "system {}: {:.1} s in the air, up to {:.1} m, wind up to {:.1} m/s, {} frames, {}",
                v.system, v.airborne_s, v.highest_m, v.strongest_wind_mps, v.frames, v.end
            ));
        }
        lines.join("\n")
    }
}

/// A bar of simulated seconds on a terminal; nothing elsewhere.
pub(super) fn progress(run: &Run, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(run.duration_s() as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} s  {per_sec}");
    bar.with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
