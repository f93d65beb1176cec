//! Numbers for Prometheus: made of the [`Status`](super::Status) at the moment they are asked for, so that they cost
//! nothing in between.

use super::service::Control;
use super::status::{LinkStatus, Status, verdict_name};
use axum::extract::State;
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use prometheus_client::collector::Collector;
use prometheus_client::encoding::{DescriptorEncoder, text};
use prometheus_client::metrics::MetricType;
use prometheus_client::registry::Registry;
use std::fmt;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;
use tracing::warn;

const CONTENT_TYPE: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";

/// Answers `GET /metrics` until `stop`.
pub(super) async fn serve(listener: TcpListener, control: Control, stop: CancellationToken) {
    let app = axum::Router::new().route("/metrics", get(answer)).with_state(control);
    let served = axum::serve(listener, app).with_graceful_shutdown(stop.cancelled_owned()).await;
    if let Err(error) = served {
        warn!("metrics are served no longer: {error}");
    }
}

async fn answer(State(control): State<Control>) -> Response {
    match page(control.status()) {
        Ok(page) => ([(header::CONTENT_TYPE, CONTENT_TYPE)], page).into_response(),
        Err(error) => (StatusCode::INTERNAL_SERVER_ERROR, error.to_string()).into_response(),
    }
}

/// The page that Prometheus reads.
fn page(status: Status) -> Result<String, fmt::Error> {
    let mut registry = Registry::with_prefix("mavobserver");
    registry.register_collector(Box::new(Numbers(status)));
    let mut page = String::new();
    text::encode(&mut page, &registry)?;
    Ok(page)
}

#[derive(Debug)]
struct Numbers(Status);

impl Collector for Numbers {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let Self(status) = self;
        links(status, &mut encoder)?;
        sources(status, &mut encoder)?;
        vehicles(status, &mut encoder)?;
        observers(status, &mut encoder)?;
        let none: [(&str, &str); 0] = [];
        counter(
            &mut encoder,
            "estimator_missed",
            "Frames that the estimator was too slow for",
            [(none, status.estimator_missed)],
        )?;
        if let Some(recording) = status.recording {
            counter(&mut encoder, "recorded_frames", "Frames recorded", [(none, recording.frames)])?;
            counter(&mut encoder, "recording_missed", "Frames that the recorder missed", [(none, recording.missed)])?;
        }
        Ok(())
    }
}

/// Name, help and value of a counter of each link.
type LinkCounter = (&'static str, &'static str, fn(&LinkStatus) -> u64);

const LINK_COUNTERS: [LinkCounter; 17] = [
    ("link_reconnects", "Times that the link came up again", |l| l.reconnects),
    ("link_received_frames", "Whole frames received", |l| l.frames_in),
    ("link_received_bytes", "Bytes of those frames", |l| l.bytes_in),
    ("link_received_bad", "Stretches of bytes that were no frame", |l| l.bad_in),
    ("link_received_lost", "Frames that never came, by their senders' numbers", |l| l.lost_in),
    ("link_received_overrun", "Datagrams that the kernel dropped because we were too slow", |l| l.overrun_in),
    ("link_received_blocked", "Frames that the link's filter did not take", |l| l.blocked_in),
    ("link_received_duplicates", "Frames that had come before by another link", |l| l.duplicates_in),
    ("link_received_twins", "Frames of a second sender with the same ids", |l| l.twins_in),
    ("link_received_refused", "Frames whose signature is missing or wrong", |l| l.refused_in),
    ("link_sent_frames", "Frames sent", |l| l.frames_out),
    ("link_sent_bytes", "Bytes of those frames", |l| l.bytes_out),
    ("link_dropped_frames", "Frames that the link could not take", |l| l.dropped_out),
    ("link_filtered_frames", "Frames that the link's filter held back", |l| l.filtered_out),
    ("link_limited_frames", "Frames that the link's rate limits held back", |l| l.limited_out),
    ("link_withheld_frames", "Frames that cannot be signed on a link where all are", |l| l.withheld_out),
    ("link_strangers", "Datagrams and connections that are not served", |l| l.strangers),
];

fn links(status: &Status, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
    let label = |link: &LinkStatus| [("link", link.name.clone())];
    let up = status.links.iter().map(|l| (label(l), if l.down.is_none() { 1.0 } else { 0.0 }));
    gauge(encoder, "link_up", "Whether the link works", up)?;
    let peers = status.links.iter().map(|l| (label(l), l.peers as f64));
    gauge(encoder, "link_peers", "Peers that a frame for everyone goes to", peers)?;
    for (name, help, value) in LINK_COUNTERS {
        counter(encoder, name, help, status.links.iter().map(|l| (label(l), value(l))))?;
    }
    Ok(())
}

fn sources(status: &Status, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
    let all = || {
        status.links.iter().flat_map(|link| {
            link.sources.iter().map(|s| {
                let (system, component) = (s.source.system.to_string(), s.source.component.to_string());
                ([("link", link.name.clone()), ("system", system), ("component", component)], s)
            })
        })
    };
    counter(encoder, "source_frames", "Frames of one sender", all().map(|(l, s)| (l, s.frames)))?;
    counter(encoder, "source_bytes", "Bytes of one sender", all().map(|(l, s)| (l, s.bytes)))?;
    counter(encoder, "source_lost", "Frames of one sender that never came", all().map(|(l, s)| (l, s.lost)))?;
    let jitter = all().map(|(l, s)| (l, s.jitter_s));
    gauge(encoder, "source_jitter_seconds", "Deviation of the time between frames lately", jitter)
}

fn vehicles(status: &Status, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
    let all = || {
        status.vehicles.iter().map(|(id, vehicle)| {
            ([("system", id.system.to_string()), ("component", id.component.to_string())], vehicle)
        })
    };
    counter(encoder, "vehicle_estimates", "Estimates made", all().map(|(l, v)| (l, v.snapshots)))?;
    let verdicts = all()
        .map(|([system, component], v)| ([system, component, ("verdict", verdict_name(v.verdict).to_owned())], 1.0));
    gauge(encoder, "vehicle_verdict", "The verdict that holds now, as a label", verdicts)?;
    let winds = || all().filter_map(|(l, v)| Some((l, v.wind?)));
    for (axis, name) in ["vehicle_wind_north_mps", "vehicle_wind_east_mps", "vehicle_wind_down_mps"].iter().enumerate()
    {
        gauge(encoder, name, "Velocity of the air", winds().map(|(l, w)| (l, w.velocity_ned_mps[axis])))?;
    }
    let width = winds().map(|(l, w)| (l, w.half_width_mps.max()));
    gauge(encoder, "vehicle_wind_half_width_mps", "Largest half-width of the wind's bound", width)?;
    let wrenches = || all().filter_map(|(l, v)| Some((l, v.wrench?)));
    let force = wrenches().map(|(l, w)| (l, w.force_ned_n.norm()));
    gauge(encoder, "vehicle_force_newtons", "Size of the residual force", force)?;
    let width = wrenches().map(|(l, w)| (l, w.force_half_width_n.max()));
    gauge(encoder, "vehicle_force_half_width_newtons", "Largest half-width of the force's bound", width)
}

fn observers(status: &Status, encoder: &mut DescriptorEncoder<'_>) -> fmt::Result {
    let all = || {
        status.observers.iter().map(|((id, name), observer)| {
            let (system, component) = (id.system.to_string(), id.component.to_string());
            ([("system", system), ("component", component), ("observer", (*name).to_owned())], observer)
        })
    };
    counter(encoder, "observer_steps", "Steps of one observer", all().map(|(l, o)| (l, o.steps)))?;
    let consistent = all().map(|(l, o)| (l, o.consistent));
    counter(encoder, "observer_consistent_steps", "Steps whose data agreed with its assumptions", consistent)
}

/// One counter with a value for each set of labels.
fn counter<const N: usize, L: AsRef<str> + fmt::Debug>(
    encoder: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    values: impl IntoIterator<Item = ([(&'static str, L); N], u64)>,
) -> fmt::Result {
    let mut family = encoder.encode_descriptor(name, help, None, MetricType::Counter)?;
    for (labels, value) in values {
        let labels = labels.each_ref().map(|(key, value)| (*key, value.as_ref()));
        family.encode_family(&labels)?.encode_counter::<[(&str, &str); 0], u64, f64>(&value, None)?;
    }
    Ok(())
}

/// One gauge with a value for each set of labels.
fn gauge<const N: usize, L: AsRef<str> + fmt::Debug>(
    encoder: &mut DescriptorEncoder<'_>,
    name: &str,
    help: &str,
    values: impl IntoIterator<Item = ([(&'static str, L); N], f64)>,
) -> fmt::Result {
    let mut family = encoder.encode_descriptor(name, help, None, MetricType::Gauge)?;
    for (labels, value) in values {
        let labels = labels.each_ref().map(|(key, value)| (*key, value.as_ref()));
        family.encode_family(&labels)?.encode_gauge(&value)?;
    }
    Ok(())
}
