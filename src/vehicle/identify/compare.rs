use super::{Identified, Quantity};

/// One quantity in two flights.
#[derive(Debug, Clone)]
pub struct Comparison {
    pub name: &'static str,
    pub here: Quantity,
    pub there: Quantity,
    /// Share by which the other flight's value differs.
    pub difference: f64,
    /// Within three standard deviations, or a tenth?
    pub agrees: bool,
}

/// Holds what two flights of one vehicle show against each other. Quantities that either shows only weakly are left out.
pub fn compare(here: &Identified, there: &Identified) -> Vec<Comparison> {
    let mut rows = Vec::new();
    let mut row = |name: &'static str, here: Quantity, there: Quantity| {
        if here.missing.is_some() || there.missing.is_some() || !here.is_known() || !there.is_known() {
            return;
        }
        let apart = (there.value - here.value).abs();
        let agrees = apart <= (3.0 * here.sigma.hypot(there.sigma)).max(0.1 * here.value.abs());
        rows.push(Comparison { name, here, there, difference: (there.value - here.value) / here.value, agrees });
    };
    row("full thrust of a rotor, N/kg", here.thrust.max_npkg, at_reference(here, there));
    row("hover command", here.thrust.hover_command, there.thrust.hover_command);
    if let (Some(a), Some(b)) = (&here.drag, &there.drag) {
        row("drag at 5 m/s forward, m/s²", a.at_5_mps[0], b.at_5_mps[0]);
        row("drag at 5 m/s right, m/s²", a.at_5_mps[1], b.at_5_mps[1]);
    }
    if let (Some(a), Some(b)) = (&here.torque, &there.torque) {
        const NAMES: [&str; 3] = ["roll effectiveness, 1/m", "pitch effectiveness, 1/m", "yaw effectiveness, 1/m"];
        for (name, (a, b)) in NAMES.into_iter().zip(a.axes.iter().zip(&b.axes)) {
            row(name, a.effectiveness, b.effectiveness);
        }
    }
    rows
}

/// The other flight's thrust scale at this one's reference voltage and density.
fn at_reference(here: &Identified, there: &Identified) -> Quantity {
    let ratio = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(1.0, |(a, b)| a / b);
    let factor =
        ratio(here.voltage_ref_v, there.voltage_ref_v).powi(2) * ratio(here.density_ref_kgm3, there.density_ref_kgm3);
    let q = there.thrust.max_npkg;
    Quantity { value: q.value * factor, sigma: q.sigma * factor, ..q }
}
