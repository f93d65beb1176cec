use super::Recording;
use crate::document::{Limit, Table};
use crate::record::session::Policy;
use std::path::Path;

const MEGABYTE: f64 = 1e6;
const SECOND_US: f64 = 1e6;

/// Reads where recordings go; `None` if nowhere.
pub(super) fn record(t: &mut Table<'_>, base: &Path) -> Option<Recording> {
    let usual = Policy::default();
    let positive = |t: &mut Table<'_>, key| t.get(key).and_then(|v| v.number(Limit::Positive));
    let bytes = |mb: f64| (mb * MEGABYTE) as u64;
    let micros = |s: f64| (s * SECOND_US) as u64;
    let directory = t.get("dir").and_then(|v| v.text()).map(|dir| base.join(dir));
    let flag = |t: &mut Table<'_>, key, usual| t.get(key).and_then(|v| v.flag()).unwrap_or(usual);
    let policy = Policy {
        mcap: flag(t, "mcap", usual.mcap),
        tlog: flag(t, "tlog", usual.tlog),
        only_armed: flag(t, "only_armed", usual.only_armed),
        sync: flag(t, "sync", usual.sync),
        rotate_bytes: positive(t, "rotate_mb").map(bytes).or(usual.rotate_bytes),
        rotate_us: positive(t, "rotate_s").map(micros).or(usual.rotate_us),
        armed_silence_us: positive(t, "armed_silence_s").map_or(usual.armed_silence_us, micros),
        budget_bytes: positive(t, "budget_mb").map(bytes).or(usual.budget_bytes),
        flush_every_us: positive(t, "flush_s").map_or(usual.flush_every_us, micros),
    };
    if !policy.mcap && !policy.tlog {
        t.problem("records neither MCAP nor telemetry logs".to_owned(), "leave one of `mcap` and `tlog` on");
    }
    Some(Recording { directory: directory?, policy })
}
