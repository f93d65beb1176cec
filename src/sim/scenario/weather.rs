use super::read::{number, number_or, span, vector_at, wind};
use super::series;
use crate::document::{Limit, Table, Value};
use crate::sim::profile::Profile;
use crate::sim::wind::{Gust, Turbulence};
use crate::sim::{Acts, Disturbance};
use nalgebra::Vector3;
use std::path::Path;

/// What `[wind]` says.
pub(super) struct Weather {
    pub mean: Profile,
    pub gusts: Vec<Gust>,
    pub turbulence: Option<Turbulence>,
}

/// Reads `[wind]`. `folder` is where a recorded series is looked for.
pub(super) fn weather(t: &mut Table<'_>, folder: &Path) -> Option<Weather> {
    let ramp_s = number_or(t, "ramp_s", Limit::NonNegative, 0.0);
    let steady = t.get("steady");
    let recorded = t.get("series");
    let has_steps = t.get("steps").is_some();
    let steps = t.sections("steps", |t| {
        let at = number(t, "at_s", Limit::NonNegative);
        let wind = wind(t);
        Some((at?, wind?))
    });
    if usize::from(steady.is_some()) + usize::from(recorded.is_some()) + usize::from(has_steps) > 1 {
        t.problem("`steady`, `steps` and `series` exclude each other", "keep one; gusts and turbulence add to it");
    }
    let gusts = t.sections("gusts", gust);
    let turbulence = t.get("turbulence");
    let rough = turbulence.as_ref().map(|v| v.table(turbulence_of));

    let mean = match (&steady, &recorded) {
        (Some(v), _) => v.table(wind).map(Profile::steady),
        (None, Some(v)) => series_of(v, folder),
        (None, None) => {
            let steps: Option<Vec<_>> = steps.into_iter().collect();
            steps.zip(ramp_s).map(|(steps, ramp)| Profile::steps(&steps, ramp))
        }
    };
    let rough = match rough {
        Some(read) => Some(read?),
        None => None,
    };
    Some(Weather { mean: mean?, gusts: gusts.into_iter().collect::<Option<_>>()?, turbulence: rough })
}

fn series_of(v: &Value<'_>, folder: &Path) -> Option<Profile> {
    let name = v.text()?;
    match series::wind(&folder.join(name)) {
        Ok(knots) => Some(Profile::series(&knots)),
        Err(why) => {
            v.problem(format!("names `{name}`, which {why}"), "paths are relative to the scenario file");
            None
        }
    }
}

fn gust(t: &mut Table<'_>) -> Option<Gust> {
    let start = number(t, "at_s", Limit::NonNegative);
    let rise = number_or(t, "rise_s", Limit::NonNegative, 1.0);
    let hold = number_or(t, "hold_s", Limit::NonNegative, 0.0);
    let fall = number_or(t, "fall_s", Limit::NonNegative, 1.0);
    let stays = t.get("stays").map_or(Some(false), |v| v.flag());
    let peak = wind(t);
    let hold_s = if stays? { f64::INFINITY } else { hold? };
    Some(Gust { start_s: start?, rise_s: rise?, hold_s, fall_s: fall?, peak_ned_mps: peak? })
}

fn turbulence_of(t: &mut Table<'_>) -> Option<Turbulence> {
    let strength = number(t, "wind_at_20ft_mps", Limit::Within(0.0, 60.0));
    let heading = number_or(t, "heading_deg", Limit::Within(-360.0, 360.0), 0.0);
    Some(Turbulence { wind_at_20ft_mps: strength?, heading_rad: heading?.to_radians() })
}

#[derive(Clone, Copy)]
enum Shape {
    Pulse,
    Series,
    Paper,
}

/// One `[[disturbance]]`: a force or a torque from outside.
pub(super) fn disturbance(t: &mut Table<'_>) -> Option<Disturbance> {
    let acts = t.require("acts").and_then(|v| {
        v.one_of(&[
            ("force_ned_n", Acts::ForceNed),
            ("force_frd_n", Acts::ForceFrd),
            ("torque_frd_nm", Acts::TorqueFrd),
        ])
    });
    let shapes = [("pulse", Shape::Pulse), ("series", Shape::Series), ("paper", Shape::Paper)];
    let shape = t.get("shape").map_or(Some(Shape::Pulse), |v| v.one_of(&shapes));
    let profile = match shape? {
        Shape::Pulse => {
            let (span, value) = (span(t), vector_at(t, "value"));
            let (from, until) = span?;
            Profile::pulse(from, until, value?)
        }
        Shape::Paper => Profile::paper(vector_at(t, "value")?),
        Shape::Series => Profile::series(&knots(t)?),
    };
    Some(Disturbance { acts: acts?, profile })
}

/// `knots = [[t, x, y, z], …]`.
fn knots(t: &mut Table<'_>) -> Option<Vec<(f64, Vector3<f64>)>> {
    let mut knots: Vec<(f64, Vector3<f64>)> = Vec::new();
    for row in t.require("knots")?.list()? {
        let [time, x, y, z] = row.array()?;
        let time = time.number(Limit::Any)?;
        if knots.last().is_some_and(|last| last.0 > time) {
            row.problem("lies before the knot above it", "put the knots in order of time");
            return None;
        }
        let value = Vector3::new(x.number(Limit::Any)?, y.number(Limit::Any)?, z.number(Limit::Any)?);
        knots.push((time, value));
    }
    Some(knots)
}
