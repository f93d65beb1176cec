//! What was identified, as a vehicle file with the origin of every number.

use super::drag::Form;
use super::{Arm, ArmOrigin, Identified, Quantity};
use crate::vehicle::airframe::Autopilot;
use crate::vehicle::{GRAVITY_MPS2, Spin};
use std::fmt::{self, Write};

/// What the log cannot tell, and how the file is to be called.
#[derive(Debug, Clone)]
pub struct Basis<'a> {
    pub name: &'a str,
    /// The log, as the comments name it.
    pub source: &'a str,
    /// `None`: the file describes one kilogram of the vehicle.
    pub mass_kg: Option<f64>,
    pub arm: Arm,
}

/// Share of a value that two standard deviations are, in percent, for a range in the file.
fn percent(q: &Quantity) -> f64 {
    if q.value == 0.0 || !q.sigma.is_finite() {
        return 50.0;
    }
    (200.0 * q.sigma / q.value.abs()).clamp(0.5, 90.0)
}

/// `value ± sigma (verdict)`.
fn told(q: &Quantity, scale: f64) -> String {
    format!("{:.4} ± {:.4}, {}", q.value * scale, q.sigma * scale, q.verdict())
}

/// The vehicle file. Every number that the flight showed carries its uncertainty; every other says what stands in.
pub fn vehicle_file(id: &Identified, basis: &Basis<'_>) -> String {
    let mut out = String::new();
    // writing to a string cannot fail
    let _ = write_file(&mut out, id, basis);
    out
}

fn write_file(out: &mut String, id: &Identified, basis: &Basis<'_>) -> fmt::Result {
    let mass = basis.mass_kg.unwrap_or(1.0);
    writeln!(out, "# Identified from {}: {:.0} s of free flight.", basis.source, id.flown_s)?;
    writeln!(out, "# Ranges are two standard deviations. Check against another flight with `identify --check`.\n")?;
    writeln!(out, "name = {:?}", basis.name)?;
    match basis.mass_kg {
        Some(m) => writeln!(out, "mass_kg = {{ nominal = {m}, percent = 1 }}  # given")?,
        None => {
            writeln!(
                out,
                "# No mass was given: everything below is for one kilogram, forces are N per kg of vehicle."
            )?;
            writeln!(out, "mass_kg = 1.0")?;
        }
    }
    write_inertia(out, id, basis, mass)?;
    write_rotors(out, id, basis)?;
    write_thrust(out, id, mass)?;
    write_dynamics(out, id)?;
    write_drag(out, id, basis, mass)?;
    write_sensors(out, id)?;
    write_envelope(out, id, basis, mass)
}

fn write_inertia(out: &mut String, id: &Identified, basis: &Basis<'_>, mass: f64) -> fmt::Result {
    let arm = &basis.arm;
    writeln!(out, "\n# Telemetry shows torque only relative to inertia; the arm's length sets the scale of both.")?;
    let length = arm.length_m;
    let (origin, share) = match &arm.origin {
        ArmOrigin::Given => (format!("arm of {length} m as given"), 5.0),
        ArmOrigin::Parameters => (format!("arm of {length:.3} m from the autopilot's geometry parameters"), 15.0),
        ArmOrigin::Known(name) => (
            format!("thrust, torque and drag per mass agree with the preset {name}: its arm of {length:.3} m is taken"),
            10.0,
        ),
        ArmOrigin::Usual => {
            (format!("arm of {length:.3} m guessed from the usual distribution of mass: measure it, give --arm"), 80.0)
        }
    };
    writeln!(out, "# {origin}.")?;
    match arm.inertia_per_mass_m2(id) {
        Some(inertia) => {
            let [xx, yy, zz] = inertia.map(|i| i * mass);
            let turn = id
                .torque
                .as_ref()
                .map_or(50.0, |t| percent(&t.axes[0].effectiveness).max(percent(&t.axes[1].effectiveness)));
            let flat = format!("{:.2} times the mean of the others", arm.flatness);
            if arm.yaw_is_damped(id) {
                writeln!(out, "# Izz is the mean of {flat} and of what the rotors' drag makes of the damping of yaw.")?;
            } else {
                writeln!(out, "# Izz is taken as {flat}: no flight of this kind shows it.")?;
            }
            writeln!(out, "inertia_kgm2 = [{xx:.5}, {yy:.5}, {zz:.5}]")?;
            writeln!(out, "inertia_percent = {:.0}", f64::hypot(turn, share).min(90.0))
        }
        None => {
            let xx = 0.2 * mass * length * length;
            writeln!(out, "# The telemetry is too slow to show rotation: the usual distribution of mass stands in.")?;
            writeln!(out, "inertia_kgm2 = [{xx:.5}, {xx:.5}, {:.5}]\ninertia_percent = 80", 1.9 * xx)
        }
    }
}

fn write_rotors(out: &mut String, id: &Identified, basis: &Basis<'_>) -> fmt::Result {
    let arm = &basis.arm;
    let yaw = id.torque.as_ref().map(|t| &t.axes[2].effectiveness);
    let ratio = match (yaw, arm.inertia_per_mass_m2(id)) {
        (Some(yaw), Some(inertia)) if yaw.value > 0.0 => yaw.value * inertia[2],
        _ => 0.02 * arm.length_m / 0.25,
    };
    writeln!(out, "\n# Geometry: {}.", id.airframe.geometry_origin)?;
    writeln!(out, "# Outputs: {}.", id.airframe.mapping_origin)?;
    if let Some(t) = &id.torque {
        writeln!(
            out,
            "# Angular acceleration per N/kg at the end of the longest arm (yaw: per N/kg of one sense), 1/m:"
        )?;
        for (name, axis) in ["roll ", "pitch", "yaw  "].iter().zip(&t.axes) {
            writeln!(out, "#   {name}  {}; {:.0} % explained", told(&axis.effectiveness, 1.0), 100.0 * axis.explained)?;
        }
    }
    for (i, place) in id.airframe.places.iter().enumerate() {
        let p = place.forward_right * arm.length_m;
        let spin = if place.spin == Spin::Ccw { "ccw" } else { "cw" };
        if let Some(t) = &id.torque {
            let of = |k: usize| t.axes[k].rotors.get(i).map_or(f64::NAN, |q| q.value);
            let sigma = |k: usize| t.axes[k].rotors.get(i).map_or(f64::NAN, |q| q.sigma);
            write!(out, "\n# By itself, rad/s² per N/kg of its thrust: roll {:+.2} ± {:.2}", of(0), sigma(0))?;
            write!(out, ", pitch {:+.2} ± {:.2}, yaw {:+.3} ± {:.3}", of(1), sigma(1), of(2), sigma(2))?;
        }
        writeln!(out, "\n[[rotor]]")?;
        writeln!(out, "position_frd_m = [{:.4}, {:.4}, 0.0]", p.x, p.y)?;
        writeln!(out, "spin = \"{spin}\"\ntorque_ratio_m = {ratio:.5}\noutput = {}", place.output + 1)?;
    }
    Ok(())
}

fn write_thrust(out: &mut String, id: &Identified, mass: f64) -> fmt::Result {
    let t = &id.thrust;
    writeln!(out, "\n# Full thrust of a rotor: {} N/kg.", told(&t.max_npkg, 1.0))?;
    if t.hover_command.is_known() {
        writeln!(out, "# Hover at a command of {:.3} ± {:.3}.", t.hover_command.value, t.hover_command.sigma)?;
    }
    writeln!(out, "[thrust]")?;
    let share = percent(&t.max_npkg).max(1.0);
    writeln!(out, "max_n = {{ nominal = {:.4}, percent = {share:.1} }}", t.max_npkg.value * mass)?;
    writeln!(out, "expo = {}  # {}", id.airframe.curve.expo, id.airframe.curve_origin)?;
    writeln!(out, "# The flight would bend the curve by {}.", told(&t.expo_change, 1.0))?;
    if t.voltage_exponent.is_known() {
        writeln!(out, "# Thrust goes with voltage to the power of {}.", told(&t.voltage_exponent, 1.0))?;
    }
    match id.voltage_ref_v {
        Some(v) => writeln!(out, "voltage_ref_v = {v:.3}  # mean of the flight")?,
        None => writeln!(out, "# voltage_ref_v is left out: thrust does not follow the battery, or none was reported")?,
    }
    match id.density_ref_kgm3 {
        Some(d) => writeln!(out, "density_ref_kgm3 = {d:.4}  # mean of the flight"),
        None => writeln!(out, "# density_ref_kgm3 is left out: no static pressure was reported"),
    }
}

fn write_dynamics(out: &mut String, id: &Identified) -> fmt::Result {
    writeln!(out, "\n[rotor_dynamics]")?;
    match &id.torque {
        Some(t) => {
            writeln!(out, "time_constant_s = {:.3}  # {}", t.time_constant_s.value, told(&t.time_constant_s, 1.0))?;
            writeln!(out, "delay_s = {:.4}  # {}", t.actuator_delay_s.value, told(&t.actuator_delay_s, 1.0))
        }
        None => writeln!(out, "# not observed: the telemetry is slower than 20 Hz\ntime_constant_s = 0.03"),
    }
}

fn write_drag(out: &mut String, id: &Identified, basis: &Basis<'_>, mass: f64) -> fmt::Result {
    writeln!(out, "\n[drag]")?;
    let Some(d) = &id.drag else {
        return writeln!(out, "# not observed: fly straight legs at 5 m/s or more, there and back, in two directions");
    };
    let axes = if d.isotropic { "one law for both axes is as good" } else { "forward and right differ" };
    writeln!(
        out,
        "# Wind estimated beside it; {axes}; 5 % of the flight above {:.1} m/s of airspeed.",
        d.airspeed_mps
    )?;
    writeln!(out, "# At 5 m/s: forward {} m/s²", told(&d.at_5_mps[0], 1.0))?;
    writeln!(out, "#          right   {} m/s²", told(&d.at_5_mps[1], 1.0))?;
    let list = |values: [(f64, f64); 3]| {
        let items = values.map(|(v, p)| format!("{{ nominal = {v:.5}, percent = {p:.0} }}"));
        format!("[\n    {},\n]", items.join(",\n    "))
    };
    // the law's two coefficients trade against each other; what matters is their sum at flying speeds
    let share = |i: usize| percent(&d.at_5_mps[i]).max(3.0);
    let vertical = &id.thrust.vertical_drag;
    let down = if vertical.is_known() { (vertical.value, percent(vertical)) } else { (d.linear[0].value, 50.0) };
    writeln!(out, "# Along the thrust axis: {} 1/s.", told(vertical, 1.0))?;
    let (key, scale) = match d.form {
        Form::Rotors => {
            let sum_sqrt = id.mean_sqrt_shape * (id.thrust.max_npkg.value * mass).sqrt();
            writeln!(out, "# Momentum drag of the rotors (grows with Σ√T) fits better than drag of the body alone.")?;
            ("rotor_n_per_mps_sqrt_n", mass / sum_sqrt)
        }
        Form::Body => ("linear_n_per_mps", mass),
    };
    let linear = [
        (d.linear[0].value * scale, share(0)),
        (d.linear[1].value * scale, share(1)),
        (down.0 * scale, down.1.max(10.0)),
    ];
    writeln!(out, "{key} = {}", list(linear))?;
    let half_density = 0.5 * id.density_ref_kgm3.unwrap_or(1.225);
    let area = |i: usize| d.quadratic[i].value * mass / half_density;
    let z = 0.5 * (area(0) + area(1));
    writeln!(out, "# Below 3 m/s of airspeed the quadratic part hardly shows; along z it is taken as across.")?;
    writeln!(out, "area_m2 = {}", list([(area(0), share(0)), (area(1), share(1)), (z, 30.0)]))?;
    if let (Some(t), Some(inertia)) = (&id.torque, basis.arm.inertia_per_mass_m2(id)) {
        let damping = [0, 1, 2].map(|k| t.axes[k].damping.value.max(0.0) * inertia[k] * mass);
        let said = [0, 1, 2].map(|k| format!("{:.2} ± {:.2}", t.axes[k].damping.value, t.axes[k].damping.sigma));
        writeln!(out, "# Damping of rotation, 1/s: {}.", said.join(", "))?;
        writeln!(out, "angular_nm_per_rads = [{:.5}, {:.5}, {:.5}]", damping[0], damping[1], damping[2])?;
    }
    let curve = id.airframe.curve;
    writeln!(out, "\n[actuators]\nsource = \"auto\"\nat_zero = {}\nat_full = {}", curve.at_zero, curve.at_full)
}

fn write_sensors(out: &mut String, id: &Identified) -> fmt::Result {
    if let Some(t) = &id.torque {
        writeln!(out, "\n[sensors]\ngyro_delay_s = {:.4}  # against the attitude's stamps", t.gyro_delay_s.value)?;
    }
    let n = &id.noise;
    let list = |v: [f64; 3]| format!("[{:.3}, {:.3}, {:.3}]", v[0], v[1], v[2]);
    writeln!(out, "\n# Estimates from the sensors' scatter and contradictions: no truth was at hand.\n[noise]")?;
    writeln!(out, "accel_mps2 = {}", list(n.accel_mps2))?;
    writeln!(out, "accel_bias_mps2 = {}", list(n.accel_bias_mps2))?;
    writeln!(out, "gyro_rads = {}", list(n.gyro_rads))?;
    writeln!(out, "velocity_mps = {}", list(n.velocity_mps))?;
    writeln!(out, "tilt_deg = {:.2}", n.tilt_rad.to_degrees())?;
    let yaw = match id.airframe.autopilot {
        Autopilot::ArduPilot => "2.0  # not observable: what a calibrated compass gives in flight",
        Autopilot::Px4 => "10.0  # not observable: the estimate drifts in hover",
    };
    writeln!(out, "yaw_deg = {yaw}\ndensity_percent = 2")
}

/// How far off the centre the wind's force may act, in arms.
const OFF_CENTRE: f64 = 0.05;

/// From drag: the force of 15 m/s of wind, built up within two seconds, and the torque of that force a little off the
/// centre, within one.
fn write_envelope(out: &mut String, id: &Identified, basis: &Basis<'_>, mass: f64) -> fmt::Result {
    let Some(d) = &id.drag else { return Ok(()) };
    let across = [0, 1].map(|k| (d.linear[k].value * 15.0 + d.quadratic[k].value * 225.0) * mass);
    let least = 0.3 * mass * GRAVITY_MPS2;
    let force = [across[0].max(least), across[1].max(least), least.max(0.5 * across[0])];
    writeln!(out, "\n# The drag of 15 m/s of wind, reached within two seconds.\n[envelope]")?;
    writeln!(out, "force_n = [{:.1}, {:.1}, {:.1}]", force[0], force[1], force[2])?;
    writeln!(out, "force_rate_nps = [{:.1}, {:.1}, {:.1}]", force[0] / 2.0, force[1] / 2.0, force[2] / 2.0)?;
    let torque = OFF_CENTRE * basis.arm.length_m * force[0].max(force[1]);
    writeln!(out, "# That force, a twentieth of an arm off the centre, within one second.")?;
    writeln!(out, "torque_nm = [{torque:.3}, {torque:.3}, {torque:.3}]")?;
    writeln!(out, "torque_rate_nmps = [{torque:.3}, {torque:.3}, {torque:.3}]")
}
