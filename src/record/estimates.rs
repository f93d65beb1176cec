//! Estimates as topics: one for each observer, and those of the vehicle as a whole.

use super::error::RecordError;
use super::own::PACKAGE;
use super::proto::{PutProto, SchemaBuilder};
use super::publisher::{ChannelSink, Publisher};
use super::topics;
use crate::pipeline::{ObserverReport, Snapshot};
use crate::signal::{Guarantee, Verdict};
use nalgebra::Vector3;
use prost_types::field_descriptor_proto::Type;

/// Fields that every estimate begins with; its values follow.
const VERDICT: u32 = 1;
const GUARANTEE: u32 = 2;
const LEVEL: u32 = 3;
const RESIDUAL: u32 = 4;
const VALUES: u32 = 5;

const VERDICTS: [&str; 5] = ["CONSISTENT", "SETTLING", "ASSUMPTION_VIOLATED", "STARVED", "GROUNDED"];
const GUARANTEES: [&str; 3] = ["NO_BOUND", "STATISTICAL", "GUARANTEED"];

impl<S: ChannelSink> Publisher<S> {
    /// Records everything a snapshot holds under `/observer/SYSTEM/`: each observer under its name, `wrench` and `wind`
    /// of the vehicle, `faults`; and arrows for 3D panels.
    ///
    /// # Errors
    /// Those of the sink.
    pub fn snapshot(&mut self, s: &Snapshot<'_>) -> Result<(), RecordError> {
        let log_ns = s.received_unix_us.saturating_mul(1_000);
        let times = (log_ns, self.made_at_ns(s.vehicle.system, s.vehicle.component, s.stamp, log_ns));
        let topic = |name: &str| format!("{}{}/{name}", topics::OBSERVER, s.vehicle.system);
        for report in s.observers.iter() {
            let schema = || observer_schema(&report).encode(PACKAGE);
            self.derived(&topic(report.name), times, &type_name(report.name), PACKAGE, schema, |out| {
                put_state(out, report.estimate.verdict, report.estimate.guarantee, report.estimate.residual);
                let pairs = report.estimate.values.iter().zip(&report.estimate.half_widths);
                put_bounded(out, VALUES, pairs.map(|(&v, &h)| (v, h)));
            })?;
        }
        if let Some(w) = s.wrench {
            let values = [("force_ned_n", &["n", "e", "d"]), ("torque_frd_nm", &["x", "y", "z"])];
            self.derived(
                &topic("wrench"),
                times,
                "Wrench",
                PACKAGE,
                || vectors("Wrench", &values),
                |out| {
                    put_state(out, w.verdict, w.guarantee, f64::NAN);
                    put_bounded(out, VALUES, pairs(&w.force_ned_n, &w.force_half_width_n));
                    put_bounded(out, VALUES + 6, pairs(&w.torque_frd_nm, &w.torque_half_width_nm));
                },
            )?;
        }
        if let Some(w) = s.wind {
            let values = [("velocity_ned_mps", &["n", "e", "d"])];
            self.derived(
                &topic("wind"),
                times,
                "Wind",
                PACKAGE,
                || vectors("Wind", &values),
                |out| {
                    put_state(out, s.verdict, w.guarantee, f64::NAN);
                    put_bounded(out, VALUES, pairs(&w.velocity_ned_mps, &w.half_width_mps));
                },
            )?;
        }
        self.derived(&topic("faults"), times, "Faults", PACKAGE, faults_schema, |out| {
            out.put_u64(1, s.faults.0.into());
            s.faults.names().for_each(|name| out.put_bytes(2, name.as_bytes()));
        })?;
        self.arrows(s, times)
    }
}

fn state(schema: SchemaBuilder, name: &str) -> SchemaBuilder {
    let named = |names: &[&str]| (0..).zip(names.iter().map(|&n| n.to_owned()).collect::<Vec<_>>());
    schema
        .enumeration("Verdict", named(&VERDICTS))
        .enumeration("BoundKind", named(&GUARANTEES))
        .typed(VERDICT, "verdict", Type::Enum, &format!(".{PACKAGE}.{name}.Verdict"))
        .typed(GUARANTEE, "bound_kind", Type::Enum, &format!(".{PACKAGE}.{name}.BoundKind"))
        .field(LEVEL, "level", Type::Double)
        .comment("probability of a statistical bound")
        .field(RESIDUAL, "residual", Type::Double)
        .comment("above 1 the data contradict the assumptions")
}

/// Value and half-width of each signal.
fn observer_schema(report: &ObserverReport<'_>) -> SchemaBuilder {
    let name = type_name(report.name);
    let mut schema = state(SchemaBuilder::new(&name), &name);
    for (number, signal) in (VALUES..).step_by(2).zip(report.signals) {
        let unit = format!("{} {}", signal.unit, signal.frame);
        let field = identifier(signal.name);
        schema = schema
            .field(number, &field, Type::Double)
            .comment(unit.trim())
            .field(number + 1, &format!("{field}_half_width"), Type::Double)
            .comment("infinite where nothing is claimed");
    }
    schema
}

fn vectors(name: &str, values: &[(&str, &[&str; 3])]) -> Vec<u8> {
    let mut schema = state(SchemaBuilder::new(name), name);
    let mut number = VALUES;
    for (vector, axes) in values {
        for axis in axes.iter() {
            schema = schema.field(number, &format!("{vector}_{axis}"), Type::Double).field(
                number + 1,
                &format!("{vector}_{axis}_half_width"),
                Type::Double,
            );
            number += 2;
        }
    }
    schema.encode(PACKAGE)
}

fn faults_schema() -> Vec<u8> {
    SchemaBuilder::new("Faults").field(1, "mask", Type::Uint32).repeated(2, "active", Type::String).encode(PACKAGE)
}

fn put_state(out: &mut Vec<u8>, verdict: Verdict, guarantee: Guarantee, residual: f64) {
    let verdict = match verdict {
        Verdict::Consistent => 0,
        Verdict::Settling => 1,
        Verdict::AssumptionViolated => 2,
        Verdict::Starved => 3,
        Verdict::Grounded => 4,
    };
    let (kind, level) = match guarantee {
        Guarantee::None => (0, 0.0),
        Guarantee::Statistical(level) => (1, level),
        Guarantee::Guaranteed => (2, 1.0),
    };
    out.put_u64(VERDICT, verdict);
    out.put_u64(GUARANTEE, kind);
    out.put_f64(LEVEL, level);
    out.put_f64(RESIDUAL, residual);
}

fn put_bounded(out: &mut Vec<u8>, first: u32, values: impl Iterator<Item = (f64, f64)>) {
    for (number, (value, half_width)) in (first..).step_by(2).zip(values) {
        out.put_f64(number, value);
        out.put_f64(number + 1, half_width);
    }
}

fn pairs(values: &Vector3<f64>, half_widths: &Vector3<f64>) -> impl Iterator<Item = (f64, f64)> {
    (0..3).map(|i| (values[i], half_widths[i]))
}

/// `quadratic_bounded` as a protobuf type: `QuadraticBounded`.
fn type_name(observer: &str) -> String {
    observer
        .split('_')
        .flat_map(|word| {
            let mut letters = word.chars();
            letters.next().map(|c| c.to_ascii_uppercase()).into_iter().chain(letters)
        })
        .collect()
}

/// A signal's name with nothing in it but letters, digits and underscores.
fn identifier(name: &str) -> String {
    name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect()
}
