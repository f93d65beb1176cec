use crate::daemon::Status;
use nalgebra::Vector3;
use serde_json::{Value, json};

/// Everything that passed, and the last estimates, as one JSON object.
pub(super) fn report(status: &Status) -> Value {
    // JSON knows no infinity: a half-width that claims nothing is null there
    let vector = |v: &Vector3<f64>| json!([v.x, v.y, v.z]);
    let links = status.links.iter().map(|l| {
        let sources = l.sources.iter().map(|s| {
            json!({
                "system": s.source.system, "component": s.source.component, "frames": s.frames, "bytes": s.bytes,
                "lost": s.lost, "rate_hz": s.rate_hz, "jitter_s": s.jitter_s,
            })
        });
        json!({
            "name": l.name, "down": l.down, "reconnects": l.reconnects, "peers": l.peers, "frames_in": l.frames_in, "bytes_in": l.bytes_in, "bad_in": l.bad_in,
            "lost_in": l.lost_in, "overrun_in": l.overrun_in, "blocked_in": l.blocked_in, "duplicates_in": l.duplicates_in, "twins_in": l.twins_in, "refused_in": l.refused_in, "frames_out": l.frames_out, "bytes_out": l.bytes_out,
            "dropped_out": l.dropped_out, "filtered_out": l.filtered_out, "limited_out": l.limited_out, "withheld_out": l.withheld_out,
            "strangers": l.strangers, "sources": sources.collect::<Vec<_>>(),
        })
    });
    let vehicles = status.vehicles.iter().map(|(id, v)| {
        json!({
            "system": id.system, "component": id.component, "snapshots": v.snapshots,
            "verdict": format!("{:?}", v.verdict),
            "wrench": v.wrench.map(|w| json!({
                "force_ned_n": vector(&w.force_ned_n), "force_half_width_n": vector(&w.force_half_width_n),
                "torque_frd_nm": vector(&w.torque_frd_nm), "torque_half_width_nm": vector(&w.torque_half_width_nm),
            })),
            "wind": v.wind.map(|w| json!({
                "velocity_ned_mps": vector(&w.velocity_ned_mps), "half_width_mps": vector(&w.half_width_mps),
            })),
            "clock_ours_minus_theirs_ns": v.clock.map(|c| c.ours_minus_theirs_ns),
        })
    });
    let observers = status.observers.iter().map(|((id, name), o)| {
        json!({
            "system": id.system, "component": id.component, "name": name, "steps": o.steps,
            "consistent": o.consistent,
        })
    });
    json!({
        "links": links.collect::<Vec<_>>(),
        "vehicles": vehicles.collect::<Vec<_>>(),
        "observers": observers.collect::<Vec<_>>(),
        "pairings": status.pairings.iter().map(super::pairing::json).collect::<Vec<_>>(),
        "estimator_missed": status.estimator_missed,
        "recording": status.recording.map(|r| json!({
            "frames": r.frames, "missed": r.missed, "stopped": r.stopped,
        })),
    })
}
