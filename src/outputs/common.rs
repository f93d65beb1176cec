//! The messages that every ground station knows.

use super::rounding::{down, half_widths, up};
use super::text::char_array;
use crate::pipeline::{Snapshot, WindEstimate};
use crate::signal::{Guarantee, Stamp};
use crate::wire::dialect::ardupilotmega::{
    DEBUG_FLOAT_ARRAY_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA, MavAutopilot, MavModeFlag, MavState, MavType,
    NAMED_VALUE_FLOAT_DATA, NAMED_VALUE_INT_DATA, WIND_COV_DATA, WIND_DATA,
};
use nalgebra::Vector3;

/// Numbers in a DEBUG_FLOAT_ARRAY.
const ARRAY: usize = 58;

/// A NAMED_VALUE_FLOAT: what a ground station plots or overlays.
#[derive(Debug, Clone, Copy)]
pub struct Scalar {
    /// At most nine characters: PX4 overwrites the tenth when it passes a message on.
    pub name: &'static str,
    pub unit: &'static str,
    pub meaning: &'static str,
    pub(super) value: fn(&Snapshot<'_>) -> Option<f64>,
}

/// Every NAMED_VALUE_FLOAT. Mission Planner shows them as `MAV_` and the name.
pub const SCALARS: [Scalar; 8] = [
    Scalar {
        name: "WindSpd",
        unit: "m/s",
        meaning: "horizontal wind speed",
        value: |s| s.wind.map(|w| w.velocity_ned_mps.xy().norm()),
    },
    Scalar {
        name: "WindDir",
        unit: "deg",
        meaning: "where the wind comes from, 0 to 360 from north over east",
        value: |s| s.wind.map(|w| from_direction_deg(&w.velocity_ned_mps)),
    },
    Scalar {
        name: "WindUp",
        unit: "m/s",
        meaning: "vertical wind, positive upwards",
        value: |s| s.wind.map(|w| -w.velocity_ned_mps.z),
    },
    Scalar {
        name: "WindHw",
        unit: "m/s",
        meaning: "the larger horizontal half-width of the wind",
        value: |s| s.wind.map(|w| w.half_width_mps.xy().max()),
    },
    Scalar {
        name: "ForceAbs",
        unit: "N",
        meaning: "size of the residual force",
        value: |s| s.wrench.map(|w| w.force_ned_n.norm()),
    },
    Scalar {
        name: "ForceHw",
        unit: "N",
        meaning: "the largest half-width of the residual force",
        value: |s| s.wrench.map(|w| w.force_half_width_n.max()),
    },
    Scalar {
        name: "TorqAbs",
        unit: "N m",
        meaning: "size of the residual torque",
        value: |s| s.wrench.map(|w| w.torque_frd_nm.norm()),
    },
    Scalar {
        name: "ObsState",
        unit: "",
        meaning: "0 consistent, 1 settling, 2 assumption violated, 3 starved, 4 on the ground",
        value: |s| Some(f64::from(super::own::verdict_number(s.verdict))),
    },
];

/// Direction that a wind blowing towards `velocity_ned` comes from, degrees in [0, 360).
fn from_direction_deg(velocity_ned: &Vector3<f64>) -> f64 {
    let degrees = (-velocity_ned.y).atan2(-velocity_ned.x).to_degrees().rem_euclid(360.0);
    // rem_euclid rounds a tiny negative angle up to 360 itself
    if degrees < 360.0 { degrees } else { 0.0 }
}

/// A number for the wire: what is not finite is NaN.
fn known(value: f64) -> f32 {
    known_f32(value as f32)
}

fn known_f32(value: f32) -> f32 {
    if value.is_finite() { value } else { f32::NAN }
}

pub(super) fn boot_us(stamp: Stamp) -> u64 {
    u64::try_from(stamp.nanos() / 1_000).unwrap_or(0)
}

pub(super) fn heartbeat() -> HEARTBEAT_DATA {
    HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    }
}

pub(super) fn debug_vect(name: &str, vector: &Vector3<f64>, stamp: Stamp) -> DEBUG_VECT_DATA {
    DEBUG_VECT_DATA {
        time_usec: boot_us(stamp),
        x: known(vector.x),
        y: known(vector.y),
        z: known(vector.z),
        name: char_array(name),
    }
}

pub(super) fn wrench_array(snapshot: &Snapshot<'_>) -> DEBUG_FLOAT_ARRAY_DATA {
    let mut data = [0.0; ARRAY];
    data[..18].fill(f32::NAN);
    let mut put = |at: usize, values: &Vector3<f64>, widths_at: usize, widths: &Vector3<f64>| {
        for (i, width) in half_widths(values, widths).into_iter().enumerate() {
            data[at + i] = known(values[i]);
            data[widths_at + i] = known_f32(width);
        }
    };
    if let Some(wrench) = &snapshot.wrench {
        put(0, &wrench.force_ned_n, 6, &wrench.force_half_width_n);
        put(3, &wrench.torque_frd_nm, 9, &wrench.torque_half_width_nm);
    }
    if let Some(wind) = &snapshot.wind {
        put(12, &wind.velocity_ned_mps, 15, &wind.half_width_mps);
    }
    let given = [snapshot.wrench.map(|w| w.guarantee), snapshot.wind.map(|w| w.guarantee)];
    let mut given = given.into_iter().flatten().peekable();
    let guaranteed = given.peek().is_some() && given.all(|g| g == Guarantee::Guaranteed);
    data[18] = f32::from(u8::from(guaranteed));
    // exact up to 24 bits, and there are 22 faults
    data[19] = snapshot.faults.0 as f32;
    float_array(1, "WRENCH", data, snapshot.stamp)
}

/// Lower and upper ends of all observers' signals; `None` if there are none.
pub(super) fn bound_arrays(snapshot: &Snapshot<'_>) -> Option<[DEBUG_FLOAT_ARRAY_DATA; 2]> {
    let (mut lower, mut upper) = ([0.0; ARRAY], [0.0; ARRAY]);
    let estimates = snapshot.observers.iter().map(|o| o.estimate);
    let signals = estimates.flat_map(|e| e.values.iter().zip(&e.half_widths));
    let mut any = false;
    for ((low, high), (value, half_width)) in lower.iter_mut().zip(&mut upper).zip(signals) {
        *low = known_f32(down(value - half_width));
        *high = known_f32(up(value + half_width));
        any = true;
    }
    any.then(|| [float_array(2, "BOUND_LO", lower, snapshot.stamp), float_array(3, "BOUND_HI", upper, snapshot.stamp)])
}

fn float_array(array_id: u16, name: &str, data: [f32; ARRAY], stamp: Stamp) -> DEBUG_FLOAT_ARRAY_DATA {
    DEBUG_FLOAT_ARRAY_DATA { time_usec: boot_us(stamp), array_id, name: char_array(name), data }
}

pub(super) fn named_value(scalar: &Scalar, snapshot: &Snapshot<'_>) -> Option<NAMED_VALUE_FLOAT_DATA> {
    Some(NAMED_VALUE_FLOAT_DATA {
        // the message's clock wraps after 49.7 days, as the autopilot's does
        time_boot_ms: (boot_us(snapshot.stamp) / 1_000) as u32,
        value: known((scalar.value)(snapshot)?),
        name: char_array(scalar.name),
    })
}

/// The faults that are present, one bit each as in MAVOBSERVER_FAULT, for ground stations that know no FAULT_STATUS.
pub(super) fn fault_mask(snapshot: &Snapshot<'_>) -> NAMED_VALUE_INT_DATA {
    NAMED_VALUE_INT_DATA {
        time_boot_ms: (boot_us(snapshot.stamp) / 1_000) as u32,
        // 22 bits
        value: snapshot.faults.0.cast_signed(),
        name: char_array("Faults"),
    }
}

/// Wind as WIND_COV. Its accuracies are standard deviations: a bound gives that of the uniform distribution over it.
pub(super) fn wind_cov(wind: &WindEstimate, stamp: Stamp) -> WIND_COV_DATA {
    let deviation = |half_width: f64| known(half_width / 3_f64.sqrt());
    WIND_COV_DATA {
        time_usec: boot_us(stamp),
        wind_x: known(wind.velocity_ned_mps.x),
        wind_y: known(wind.velocity_ned_mps.y),
        wind_z: known(wind.velocity_ned_mps.z),
        var_horiz: f32::NAN,
        var_vert: f32::NAN,
        wind_alt: f32::NAN,
        horiz_accuracy: deviation(wind.half_width_mps.xy().max()),
        vert_accuracy: deviation(wind.half_width_mps.z),
    }
}

/// Wind as ArduPilot's WIND: where it comes from, and downwards as the third part.
pub(super) fn wind(wind: &WindEstimate) -> WIND_DATA {
    let velocity = wind.velocity_ned_mps;
    WIND_DATA {
        direction: known(from_direction_deg(&velocity)),
        speed: known(velocity.xy().norm()),
        speed_z: known(velocity.z),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_where_the_wind_comes_from() {
        for (north, east, from) in [(-1.0, 0.0, 0.0), (0.0, -2.0, 90.0), (3.0, 0.0, 180.0), (0.0, 1.0, 270.0)] {
            let direction = from_direction_deg(&Vector3::new(north, east, 0.4));
            assert!((direction - from).abs() < 1e-9, "{north} {east}: {direction}");
        }
        assert_eq!(from_direction_deg(&Vector3::new(-1.0, 1e-300, 0.0)), 0.0);
    }

    #[test]
    fn names_fit_and_differ() {
        let mut names: Vec<_> = SCALARS.iter().map(|s| s.name).collect();
        assert!(names.iter().all(|n| n.len() <= 9 && n.is_ascii()));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), SCALARS.len());
    }
}
