use super::read::{number, number_or, vector_at};
use crate::document::{Limit, Table};
use crate::sim::control::Leg;

#[derive(Clone, Copy)]
enum Kind {
    Wait,
    Takeoff,
    Hover,
    Goto,
    Velocity,
    Circle,
    Turn,
    Land,
}

const KINDS: [(&str, Kind); 8] = [
    ("wait", Kind::Wait),
    ("takeoff", Kind::Takeoff),
    ("hover", Kind::Hover),
    ("goto", Kind::Goto),
    ("velocity", Kind::Velocity),
    ("circle", Kind::Circle),
    ("turn", Kind::Turn),
    ("land", Kind::Land),
];

/// One `{ leg = "…", … }`.
pub(super) fn leg(t: &mut Table<'_>) -> Option<Leg> {
    let kind = t.require("leg").and_then(|v| v.one_of(&KINDS))?;
    Some(match kind {
        Kind::Wait => Leg::Wait { seconds: number(t, "seconds", Limit::NonNegative)? },
        Kind::Takeoff => Leg::Takeoff { height_m: number(t, "height_m", Limit::Within(0.5, 5000.0))? },
        Kind::Hover => Leg::Hover { seconds: number(t, "seconds", Limit::NonNegative)? },
        Kind::Goto => {
            let to = vector_at(t, "position_ned_m");
            let speed = number_or(t, "speed_mps", Limit::Positive, 5.0);
            Leg::Goto { position_ned_m: to?, speed_mps: speed? }
        }
        Kind::Velocity => {
            let velocity = vector_at(t, "velocity_ned_mps");
            let seconds = number(t, "seconds", Limit::Positive);
            Leg::Velocity { velocity_ned_mps: velocity?, seconds: seconds? }
        }
        Kind::Circle => {
            let radius = number(t, "radius_m", Limit::Positive);
            let speed = number(t, "speed_mps", Limit::Positive);
            let seconds = number(t, "seconds", Limit::Positive);
            let nose_ahead = t.get("nose_ahead").map_or(Some(false), |v| v.flag());
            Leg::Circle { radius_m: radius?, speed_mps: speed?, seconds: seconds?, nose_ahead: nose_ahead? }
        }
        Kind::Turn => Leg::Turn { heading_rad: number(t, "heading_deg", Limit::Within(-360.0, 360.0))?.to_radians() },
        Kind::Land => Leg::Land,
    })
}
