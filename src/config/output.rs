use crate::document::{Limit, Table};
use crate::outputs::{OutputSettings, Rate, Rates};

/// Reads what leaves on a link; what the table leaves out is as in `base`.
pub(super) fn output(t: &mut Table<'_>, base: OutputSettings) -> OutputSettings {
    let component = t.get("component").and_then(|v| v.integer(1..=255)).and_then(|id| u8::try_from(id).ok());
    OutputSettings {
        component: component.unwrap_or(base.component),
        heartbeat: rate(t, "heartbeat_hz", base.heartbeat),
        status_text: t.get("status_text").and_then(|v| v.flag()).unwrap_or(base.status_text),
        rates: t.section("rate_hz", |t| rates(t, base.rates)),
    }
}

fn rates(t: &mut Table<'_>, base: Rates) -> Rates {
    Rates {
        debug_vect: rate(t, "debug_vect", base.debug_vect),
        wrench_array: rate(t, "wrench_array", base.wrench_array),
        bound_arrays: rate(t, "bound_arrays", base.bound_arrays),
        named_values: rate(t, "named_values", base.named_values),
        wind_cov: rate(t, "wind_cov", base.wind_cov),
        wind: rate(t, "wind", base.wind),
        wrench_estimate: rate(t, "wrench_estimate", base.wrench_estimate),
        wind_estimate: rate(t, "wind_estimate", base.wind_estimate),
        state_bounds: rate(t, "state_bounds", base.state_bounds),
        fault_status: rate(t, "fault_status", base.fault_status),
        observer_status: rate(t, "observer_status", base.observer_status),
    }
}

fn rate(t: &mut Table<'_>, key: &'static str, base: Rate) -> Rate {
    t.get(key).and_then(|v| v.number(Limit::Within(0.0, 1000.0))).map_or(base, Rate::hz)
}
