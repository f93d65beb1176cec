use super::IdentifyArgs;
use super::log::Recorded;
use crate::vehicle::Vehicle;
use crate::vehicle::identify::text::Basis;
use crate::vehicle::identify::{ArmOrigin, Comparison, Identified, Quantity};
use serde_json::{Value, json};
use std::fmt::Write;

pub struct Report<'a> {
    pub args: &'a IdentifyArgs,
    pub recorded: &'a Recorded,
    pub identified: &'a Identified,
    pub basis: &'a Basis<'a>,
    pub model: &'a Vehicle,
}

/// A row of the table: what, its value, the factor to the unit shown, the unit.
type Row = (&'static str, Quantity, f64, &'static str);

impl Report<'_> {
    fn rows(&self) -> Vec<Row> {
        let id = self.identified;
        let mut rows: Vec<Row> = vec![
            ("full thrust of a rotor", id.thrust.max_npkg, 1.0, "N/kg"),
            ("hover command", id.thrust.hover_command, 1.0, ""),
            ("exponent of voltage", id.thrust.voltage_exponent, 1.0, ""),
            ("change of expo", id.thrust.expo_change, 1.0, ""),
        ];
        if let Some(m) = self.basis.mass_kg {
            rows.insert(1, ("full thrust of a rotor", id.thrust.max_npkg, m, "N"));
        }
        if let Some(t) = &id.torque {
            for (name, axis) in ["roll effectiveness", "pitch effectiveness", "yaw effectiveness"].iter().zip(&t.axes) {
                rows.push((name, axis.effectiveness, 1.0, "1/m"));
            }
            for (name, axis) in ["roll damping", "pitch damping", "yaw damping"].iter().zip(&t.axes) {
                rows.push((name, axis.damping, 1.0, "1/s"));
            }
            rows.push(("rotor time constant", t.time_constant_s, 1e3, "ms"));
            rows.push(("actuator delay", t.actuator_delay_s, 1e3, "ms"));
            rows.push(("gyro delay", t.gyro_delay_s, 1e3, "ms"));
        }
        if let Some(d) = &id.drag {
            let names = [
                ["linear drag forward", "quadratic drag forward", "drag at 5 m/s forward"],
                ["linear drag right", "quadratic drag right", "drag at 5 m/s right"],
            ];
            for (k, [linear, quadratic, at_5]) in names.into_iter().enumerate() {
                rows.push((linear, d.linear[k], 1.0, "1/s"));
                rows.push((quadratic, d.quadratic[k], 1.0, "1/m"));
                rows.push((at_5, d.at_5_mps[k], 1.0, "m/s²"));
            }
        }
        rows.push(("drag along the thrust axis", id.thrust.vertical_drag, 1.0, "1/s"));
        rows
    }

    pub fn text(&self, comparison: Option<&[Comparison]>) -> String {
        let mut out = String::new();
        // writing to a string cannot fail
        let _ = self.write(&mut out, comparison);
        out
    }

    fn write(&self, out: &mut String, comparison: Option<&[Comparison]>) -> std::fmt::Result {
        let id = self.identified;
        writeln!(out, "{}: {:.0} s of free flight", self.args.log.display(), id.flown_s)?;
        writeln!(out, "  {} rotors; {}", id.airframe.places.len(), id.airframe.geometry_origin)?;
        writeln!(out, "  thrust curve: {}\n", id.airframe.curve_origin)?;
        for (name, q, factor, unit) in self.rows() {
            let value = if q.is_known() {
                format!("{:>9.3} ± {:<7.3} {unit:<5}", q.value * factor, q.sigma * factor)
            } else {
                format!("{:>9}   {:<7} {unit:<5}", "unknown", "")
            };
            writeln!(out, "  {name:<27} {value} {}", q.verdict())?;
        }
        let n = &id.noise;
        let list = |v: [f64; 3], digits: usize| v.map(|x| format!("{x:.digits$}")).join(", ");
        writeln!(out, "  {:<27} {} m/s², {} rad/s", "IMU noise bounds", list(n.accel_mps2, 3), list(n.gyro_rads, 4))?;
        if let Some([half, most]) = self.recorded.lateness_s {
            let text = "of the messages come this much later than the quickest";
            writeln!(
                out,
                "  {:<27} half within {:.0} ms, 95 % within {:.0} ms {text}",
                "telemetry delay",
                half * 1e3,
                most * 1e3
            )?;
        }
        if id.torque.is_none() {
            writeln!(out, "\nno rotation: IMU and motor outputs are needed at 20 Hz or more, better 50")?;
        }
        let inertia = self.model.inertia_kgm2.diagonal();
        writeln!(out, "\narm {:.3} m: {}", self.basis.arm.length_m, self.arm())?;
        if self.basis.mass_kg.is_some() {
            writeln!(out, "inertia {:.5}, {:.5}, {:.5} kg m²", inertia[0], inertia[1], inertia[2])?;
        } else {
            writeln!(out, "no mass: give --mass, and forces come in newtons instead of newtons per kilogram")?;
        }
        if let Some(rows) = comparison {
            writeln!(out, "\nagainst {}", self.args.check.as_deref().unwrap_or(&self.args.log).display())?;
            for c in rows {
                let verdict = if c.agrees { "agrees" } else { "DIFFERS" };
                let share = 100.0 * c.difference;
                writeln!(
                    out,
                    "  {:<27} {:>9.3} here, {:>9.3} there ({share:+.1} %)  {verdict}",
                    c.name, c.here.value, c.there.value
                )?;
            }
        }
        if let Some(path) = &self.args.output {
            writeln!(out, "\nwrote {}; see it with `mavobserver check --vehicle {0}`", path.display())?;
        }
        Ok(())
    }

    fn arm(&self) -> String {
        match &self.basis.arm.origin {
            ArmOrigin::Given => "as given".to_owned(),
            ArmOrigin::Parameters => "from the autopilot's geometry parameters".to_owned(),
            ArmOrigin::Known(name) => format!("of the preset {name}, which agrees in thrust, torque and drag per mass"),
            ArmOrigin::Usual => {
                "GUESSED from the usual distribution of mass; measure it and give --arm, or torque and \
                                 inertia are wrong by up to a factor of three"
                    .to_owned()
            }
        }
    }

    pub fn json(&self, comparison: Option<&[Comparison]>) -> String {
        let id = self.identified;
        let quantity = |q: &Quantity| {
            let known = q.is_known();
            json!({
                "value": known.then_some(q.value),
                "sigma": (known && q.sigma.is_finite()).then_some(q.sigma),
                "well_observed": q.missing.is_none(),
                "missing": q.missing,
            })
        };
        let axis = |k: usize| {
            id.torque.as_ref().map(|t| {
                let a = &t.axes[k];
                json!({
                    "effectiveness_per_m": quantity(&a.effectiveness),
                    "rotors_rads2_per_npkg": a.rotors.iter().map(&quantity).collect::<Vec<_>>(),
                    "damping_per_s": quantity(&a.damping),
                    "explained": a.explained,
                })
            })
        };
        let inertia = self.model.inertia_kgm2.diagonal();
        let value = json!({
            "log": self.args.log,
            "system": self.recorded.system,
            "flown_s": id.flown_s,
            "origins": {
                "geometry": id.airframe.geometry_origin,
                "curve": id.airframe.curve_origin,
                "mapping": id.airframe.mapping_origin,
                "arm": self.arm(),
            },
            "mass_kg": self.basis.mass_kg,
            "arm_m": self.basis.arm.length_m,
            "inertia_kgm2": [inertia[0], inertia[1], inertia[2]],
            "thrust": {
                "max_npkg": quantity(&id.thrust.max_npkg),
                "max_n": self.basis.mass_kg.map(|m| m * id.thrust.max_npkg.value),
                "voltage_ref_v": id.voltage_ref_v,
                "density_ref_kgm3": id.density_ref_kgm3,
                "voltage_exponent": quantity(&id.thrust.voltage_exponent),
                "expo_change": quantity(&id.thrust.expo_change),
                "hover_command": quantity(&id.thrust.hover_command),
            },
            "roll": axis(0),
            "pitch": axis(1),
            "yaw": axis(2),
            "rotor_time_constant_s": id.torque.as_ref().map(|t| quantity(&t.time_constant_s)),
            "actuator_delay_s": id.torque.as_ref().map(|t| quantity(&t.actuator_delay_s)),
            "gyro_delay_s": id.torque.as_ref().map(|t| quantity(&t.gyro_delay_s)),
            "drag": id.drag.as_ref().map(|d| json!({
                "grows_with_thrust": d.form == crate::vehicle::identify::drag::Form::Rotors,
                "isotropic": d.isotropic,
                "linear_per_s": d.linear.each_ref().map(&quantity),
                "quadratic_per_m": d.quadratic.each_ref().map(&quantity),
                "at_5_mps_mps2": d.at_5_mps.each_ref().map(&quantity),
                "vertical_per_s": quantity(&id.thrust.vertical_drag),
            })),
            "noise": {
                "accel_mps2": id.noise.accel_mps2,
                "gyro_rads": id.noise.gyro_rads,
                "tilt_rad": id.noise.tilt_rad,
                "velocity_mps": id.noise.velocity_mps,
            },
            "telemetry_lateness_s": self.recorded.lateness_s,
            "check": comparison.map(|rows| rows.iter().map(|c| json!({
                "quantity": c.name,
                "here": quantity(&c.here),
                "there": quantity(&c.there),
                "difference": c.difference,
                "agrees": c.agrees,
            })).collect::<Vec<Value>>()),
            "output": self.args.output,
        });
        format!("{value:#}")
    }
}
