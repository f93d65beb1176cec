//! Readers of the small things that several sections share.

use crate::document::{Limit, Table, Value};
use nalgebra::Vector3;

/// A number under a key, or its default when the key is left out. `None` only when it is there and wrong.
pub(super) fn number_or(t: &mut Table<'_>, key: &'static str, limit: Limit, default: f64) -> Option<f64> {
    t.get(key).map_or(Some(default), |v| v.number(limit))
}

pub(super) fn number(t: &mut Table<'_>, key: &'static str, limit: Limit) -> Option<f64> {
    t.require(key).and_then(|v| v.number(limit))
}

/// `[x, y, z]`.
pub(super) fn vector(v: &Value<'_>) -> Option<Vector3<f64>> {
    let [x, y, z] = v.array()?;
    let (x, y, z) = (x.number(Limit::Any), y.number(Limit::Any), z.number(Limit::Any));
    Some(Vector3::new(x?, y?, z?))
}

pub(super) fn vector_at(t: &mut Table<'_>, key: &'static str) -> Option<Vector3<f64>> {
    t.require(key).and_then(|v| vector(&v))
}

/// `from_deg` (compass) and `speed_mps`, with `up_mps` besides: velocity of the air, NED.
pub(super) fn wind(t: &mut Table<'_>) -> Option<Vector3<f64>> {
    let from = number_or(t, "from_deg", Limit::Within(-360.0, 360.0), 0.0);
    let speed = number(t, "speed_mps", Limit::NonNegative);
    let up = number_or(t, "up_mps", Limit::Any, 0.0);
    Some(crate::sim::wind_from(from?.to_radians(), speed?) - Vector3::z() * up?)
}

/// Begin and end of something, s. Without an end it lasts for ever.
pub(super) fn span(t: &mut Table<'_>) -> Option<(f64, f64)> {
    let from = number_or(t, "from_s", Limit::NonNegative, 0.0);
    let until_key = t.get("until_s");
    let until = until_key.as_ref().map_or(Some(f64::INFINITY), |v| v.number(Limit::NonNegative));
    let (from, until) = (from?, until?);
    if until <= from {
        if let Some(v) = &until_key {
            v.problem(format!("is {until}, not after `from_s` ({from})"), "");
        }
        return None;
    }
    Some((from, until))
}
