use super::flight::Sent;
use super::ground::{Ground, Track};
use crate::sim::scenario::Scenario;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// What the ground station found.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    pub scenario: String,
    pub description: String,
    pub flown_s: f64,
    pub frames_from_vehicle: u64,
    /// Those of them that only the daemon gets: answers to what it asked.
    pub answers_to_daemon: u64,
    pub frames_at_ground: u64,
    pub estimates: BTreeMap<&'static str, Score>,
    /// Share of the wrench estimates that said that their assumptions are broken.
    pub violated: f64,
    /// Messages of ours at the ground station, Hz.
    pub rates_hz: BTreeMap<&'static str, f64>,
    pub files: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
pub(super) struct Score {
    pub unit: &'static str,
    pub samples: u64,
    /// Root mean square of the vector error.
    pub rmse: f64,
    /// Share of instants at which all three components lay within their bounds.
    pub coverage: Option<f64>,
    /// The same, but only while the observer called its assumptions sound.
    pub coverage_sound: Option<f64>,
    /// By axis: north, east, down for force and wind; forward, right, down for torque.
    pub mean_half_width: [Option<f64>; 3],
}

impl Summary {
    pub fn new(scenario: &Scenario, ground: &Ground, sent: Sent, files: Vec<PathBuf>) -> Self {
        let tracks = [("force", "N", &ground.force), ("torque", "N m", &ground.torque), ("wind", "m/s", &ground.wind)];
        let flown_s = ground.span_s.map_or(0.0, |(first, last)| last - first);
        let rate = |n: &u64| (*n as f64 / scenario.duration_s * 10.0).round() / 10.0;
        Self {
            scenario: scenario.name.clone(),
            description: scenario.description.clone(),
            flown_s,
            frames_from_vehicle: sent.frames,
            answers_to_daemon: sent.answers,
            frames_at_ground: ground.vehicles,
            estimates: tracks.into_iter().filter_map(|(name, unit, t)| Some((name, score(unit, t)?))).collect(),
            violated: ground.violated(),
            rates_hz: ground.ours.iter().map(|(name, n)| (*name, rate(n))).collect(),
            files,
        }
    }

    pub fn has_estimates(&self) -> bool {
        self.estimates.contains_key("force")
    }

    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_else(|e| format!("{{\"error\": \"{e}\"}}"))
    }

    pub fn text(&self) -> String {
        let mut lines = vec![
            format!(
                "{:.1} s in the air; {} frames sent by the vehicle: {} answers to the daemon, {} at the ground station",
                self.flown_s, self.frames_from_vehicle, self.answers_to_daemon, self.frames_at_ground
            ),
            String::new(),
            format!("{:8}{:>14}{:>16}{:>14}{:>24}", "", "RMSE", "within bound", "while sound", "bound ±"),
        ];
        for (name, s) in &self.estimates {
            let widths = s.mean_half_width.map(|w| w.map_or_else(|| "–".to_owned(), |w| format!("{w:.2}"))).join(" ");
            let [coverage, sound] = [s.coverage, s.coverage_sound].map(percent);
            lines.push(format!("{name:8}{:>10.3} {:3}{coverage:>16}{sound:>14}{widths:>24}", s.rmse, s.unit));
        }
        lines.push(format!(
            "\nassumptions broken, as the observer itself says, in {} of the estimates",
            percent(Some(self.violated))
        ));
        lines.push(String::new());
        let rates: Vec<_> = self.rates_hz.iter().map(|(name, hz)| format!("{name} {hz}")).collect();
        lines.push(format!("received, Hz: {}", rates.join(", ")));
        let files: Vec<_> = self.files.iter().map(|f| f.display().to_string()).collect();
        lines.push(format!("written: {}", files.join(", ")));
        lines.join("\n")
    }
}

fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "–".to_owned(), |s| format!("{:.1} %", s * 100.0))
}

fn score(unit: &'static str, track: &Track) -> Option<Score> {
    let [x, y, z] = &track.errors;
    let stats = [x.stats()?, y.stats()?, z.stats()?];
    Some(Score {
        unit,
        samples: stats[0].samples,
        rmse: stats.iter().map(|s| s.rmse * s.rmse).sum::<f64>().sqrt(),
        coverage: track.all.share(),
        coverage_sound: track.sound.share(),
        mean_half_width: stats.map(|s| s.mean_half_width),
    })
}
