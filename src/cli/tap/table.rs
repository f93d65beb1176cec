use super::gaps::{Gap, gaps};
use crate::daemon::{Control, LinkStatus};
use crate::telemetry::requests::Autopilot;
use crate::wire::message_info;
use crate::wire::stats::{LinkStats, Losses, Source, SourceStats};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

/// The state of all links at one look, and what changed since the look before.
pub(super) struct Table {
    begin: Instant,
    looked: Instant,
    links: Vec<Row>,
    /// Frames and bytes of each sender at the look before.
    before: BTreeMap<(usize, Source), (u64, u64)>,
}

struct Row {
    status: LinkStatus,
    sources: Vec<Sender>,
    age_s: f64,
}

struct Sender {
    source: Source,
    kind: &'static str,
    frames: u64,
    /// Since the look before.
    rate_hz: f64,
    bytes_per_s: f64,
    losses: Losses,
    jitter_s: f64,
    longest_silence_s: f64,
    messages: Vec<Message>,
    gaps: Vec<Gap>,
}

struct Message {
    id: u32,
    count: u64,
    rate_hz: f64,
    jitter_s: f64,
    longest_silence_s: f64,
}

impl Table {
    pub fn new(begin: Instant) -> Self {
        Self { begin, looked: begin, links: Vec::new(), before: BTreeMap::new() }
    }

    /// Takes a look.
    pub fn look(&mut self, control: &Control) {
        let now = Instant::now();
        let span_s = now.duration_since(self.looked).as_secs_f64();
        let age_s = now.duration_since(self.begin).as_secs_f64();
        let stats = control.traffic();
        let rows = control.status().links.into_iter().zip(&stats).enumerate();
        // a second look at the same moment would tell rates of nothing
        if span_s < 1e-3 && !self.links.is_empty() {
            return;
        }
        let before = std::mem::take(&mut self.before);
        self.links = rows
            .map(|(link, (status, stats))| Row { status, sources: self.senders(link, stats, &before, span_s), age_s })
            .collect();
        self.looked = now;
    }

    fn senders(
        &mut self,
        link: usize,
        stats: &LinkStats,
        before: &BTreeMap<(usize, Source), (u64, u64)>,
        span_s: f64,
    ) -> Vec<Sender> {
        // a log's time is not ours: what is "now" is when the link last heard something, unless that is recent
        let last_us = stats.cadence().last_us().unwrap_or(0);
        let wall_us = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |t| t.as_micros() as u64);
        let live = wall_us.abs_diff(last_us) < 60_000_000;
        let now_us = if live { wall_us } else { last_us };
        stats
            .sources()
            .map(|(source, sender)| {
                let (frames, bytes) = (sender.totals().frames, sender.totals().bytes);
                let (frames_before, bytes_before) = before.get(&(link, source)).copied().unwrap_or_default();
                self.before.insert((link, source), (frames, bytes));
                let per_s = |now: u64, before: u64| now.saturating_sub(before) as f64 / span_s.max(1e-3);
                Sender {
                    source,
                    kind: kind(sender),
                    frames,
                    rate_hz: if live { per_s(frames, frames_before) } else { sender.cadence().mean_rate_hz() },
                    bytes_per_s: per_s(bytes, bytes_before),
                    losses: sender.losses(),
                    jitter_s: sender.cadence().jitter_s(),
                    longest_silence_s: sender.cadence().longest_silence_s(),
                    messages: messages(sender, now_us),
                    gaps: autopilot(sender).map(|a| gaps(a, sender, now_us)).unwrap_or_default(),
                }
            })
            .collect()
    }

    /// For people.
    pub fn text(&self) -> String {
        let mut out = String::new();
        // writing to a String cannot fail
        let _ = self.links.iter().try_for_each(|row| row.write(&mut out));
        out.trim_end().to_owned()
    }

    /// For machines.
    pub fn json(&self) -> Value {
        json!({ "links": self.links.iter().map(Row::json).collect::<Vec<_>>() })
    }
}

impl Row {
    fn write(&self, out: &mut String) -> std::fmt::Result {
        let Self { status, sources, age_s } = self;
        write!(out, "{}  {age_s:.0} s, {} frames, {} bad", status.name, status.frames_in, status.bad_in)?;
        if let Some(why) = &status.down {
            write!(out, ", down: {why}")?;
        }
        if status.reconnects > 0 {
            write!(out, ", came back {} times", status.reconnects)?;
        }
        writeln!(out)?;
        for s in sources {
            let Losses { lost, late, duplicates, restarts, .. } = s.losses;
            let share = 100.0 * lost as f64 / (s.frames + lost).max(1) as f64;
            write!(
                out,
                "  {:7} {:11} {:7.1} Hz {:8.1} kB/s",
                s.source.to_string(),
                s.kind,
                s.rate_hz,
                s.bytes_per_s / 1e3
            )?;
            write!(out, "  lost {lost} ({share:.1} %)  late {late}  twice {duplicates}  restarts {restarts}")?;
            writeln!(out, "  jitter {:.1} ms", s.jitter_s * 1e3)?;
            for m in &s.messages {
                let name = message_info(m.id).map_or_else(|| format!("message {}", m.id), |i| i.name.to_owned());
                let (jitter, silence) = (m.jitter_s * 1e3, m.longest_silence_s);
                write!(out, "    {name:28} {:8} {:7.1} Hz", m.count, m.rate_hz)?;
                writeln!(out, "  jitter {jitter:6.1} ms  longest silence {silence:.2} s")?;
            }
            for gap in &s.gaps {
                writeln!(out, "    observers need {}", gap.text())?;
            }
        }
        writeln!(out)
    }

    fn json(&self) -> Value {
        let sources = self.sources.iter().map(|s| {
            let messages = s.messages.iter().map(|m| {
                json!({
                    "id": m.id, "name": message_info(m.id).map(|info| info.name), "frames": m.count,
                    "rate_hz": m.rate_hz, "jitter_s": m.jitter_s, "longest_silence_s": m.longest_silence_s,
                })
            });
            json!({
                "system": s.source.system, "component": s.source.component, "kind": s.kind, "frames": s.frames,
                "rate_hz": s.rate_hz, "bytes_per_s": s.bytes_per_s, "lost": s.losses.lost, "late": s.losses.late,
                "duplicates": s.losses.duplicates, "restarts": s.losses.restarts, "jitter_s": s.jitter_s,
                "longest_silence_s": s.longest_silence_s, "messages": messages.collect::<Vec<_>>(),
                "gaps": s.gaps.iter().map(Gap::json).collect::<Vec<_>>(),
            })
        });
        json!({
            "name": self.status.name, "seconds": self.age_s, "down": self.status.down,
            "reconnects": self.status.reconnects, "frames": self.status.frames_in, "bytes": self.status.bytes_in,
            "bad": self.status.bad_in, "sources": sources.collect::<Vec<_>>(),
        })
    }
}

fn messages(sender: &SourceStats, now_us: u64) -> Vec<Message> {
    let message = |(id, cadence): (u32, &crate::wire::stats::Cadence)| Message {
        id,
        count: cadence.count(),
        rate_hz: cadence.rate_hz(now_us),
        jitter_s: cadence.jitter_s(),
        longest_silence_s: cadence.longest_silence_s(),
    };
    sender.messages().map(message).collect()
}

fn autopilot(sender: &SourceStats) -> Option<Autopilot> {
    Autopilot::from_mav(sender.heartbeat()?.autopilot)
}

fn kind(sender: &SourceStats) -> &'static str {
    /// MAV_TYPE_GCS.
    const STATION: u8 = 6;
    match (autopilot(sender), sender.heartbeat()) {
        (Some(Autopilot::ArduPilot), _) => "ArduPilot",
        (Some(Autopilot::Px4), _) => "PX4",
        (Some(Autopilot::Other), _) => "autopilot",
        (None, Some(heartbeat)) if heartbeat.mav_type == STATION => "station",
        (None, Some(_)) => "component",
        (None, None) => "",
    }
}
