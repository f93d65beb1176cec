use super::{
    Actuators, Drag, Envelope, GRAVITY_MPS2, NoiseBounds, OutputSource, Ranged, Rotor, RotorDynamics, Sensors, Spin,
    ThrustCurve, Vehicle, presets,
};
use crate::document::{Document, Issue, Issues, Limit, Table, Value, nearest};
use crate::sets::Interval;
use crate::signal::MAX_ROTORS;
use nalgebra::{Matrix3, Vector3};
use std::path::{Path, PathBuf};

/// Why a vehicle could not be had.
#[derive(Debug, thiserror::Error)]
pub enum VehicleError {
    #[error(
        "there is no vehicle preset `{name}`{hint}\npresets: {known}\nfor a vehicle of your own give the path of its TOML file"
    )]
    UnknownPreset { name: String, hint: String, known: String },
    #[error("cannot read the vehicle file {}: {source}", path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("vehicle file {}: {issues}", path.display())]
    Invalid { path: PathBuf, issues: Issues },
}

/// The vehicle that a command line or a config names: a preset, or the path of a TOML file.
///
/// Whatever holds a path separator, ends in `.toml` or exists as a file is a path; everything else is a preset.
pub fn resolve(preset_or_file: &str) -> Result<Vehicle, VehicleError> {
    if let Some(text) = presets::text(preset_or_file) {
        let name = format!("config/vehicles/{preset_or_file}.toml");
        return parse(&Document::new(&name, text))
            .map_err(|issues| VehicleError::Invalid { path: name.into(), issues });
    }
    let path = Path::new(preset_or_file);
    let is_path = path.components().count() > 1 || path.extension().is_some_and(|e| e == "toml") || path.is_file();
    if is_path { from_file(path) } else { Err(unknown_preset(preset_or_file)) }
}

/// The vehicle in a TOML file.
pub fn from_file(path: &Path) -> Result<Vehicle, VehicleError> {
    let document = Document::open(path).map_err(|source| VehicleError::Unreadable { path: path.to_owned(), source })?;
    parse(&document).map_err(|issues| VehicleError::Invalid { path: path.to_owned(), issues })
}

/// A checked vehicle, or everything that is wrong with it.
pub fn parse(document: &Document) -> Result<Vehicle, Issues> {
    document.read(vehicle).map(|(vehicle, _warnings): (_, Vec<Issue>)| vehicle)
}

fn unknown_preset(name: &str) -> VehicleError {
    let hint = nearest(name, presets::names()).map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
    let known = presets::names().collect::<Vec<_>>().join(", ");
    VehicleError::UnknownPreset { name: name.to_owned(), hint, known }
}

fn vehicle(t: &mut Table<'_>) -> Option<Vehicle> {
    let name = t.require("name").and_then(|v| v.text());
    let mass = t.require("mass_kg").and_then(|v| ranged(&v, Limit::Positive));
    let inertia = t.require("inertia_kgm2").and_then(|v| inertia(&v));
    let inertia_uncertainty = t.get("inertia_percent").and_then(|v| v.number(Limit::Within(0.0, 90.0)));
    let rotors = rotors(t);
    let thrust = t.section("thrust", thrust);
    let dynamics = t.section("rotor_dynamics", dynamics);
    let drag = t.section("drag", drag);
    let actuators = t.section("actuators", actuators);
    let sensors = t.section("sensors", sensors);
    let noise = t.section("noise", noise);
    // the envelope's defaults are shares of the vehicle's weight and arm, which a faulty file may not have
    let weight_n = mass.map_or(1.0, |m| m.nominal) * GRAVITY_MPS2;
    let arm_m = rotors.iter().flatten().map(|r| r.position_frd_m.xy().norm()).fold(0.0, f64::max);
    let envelope = t.section("envelope", |t| envelope(t, weight_n, arm_m));
    Some(Vehicle {
        name: name?.to_owned(),
        mass_kg: mass?,
        inertia_kgm2: inertia?,
        inertia_uncertainty: inertia_uncertainty.unwrap_or(5.0) / 100.0,
        rotors: rotors.into_iter().collect::<Option<_>>()?,
        thrust: thrust?,
        dynamics,
        drag,
        actuators,
        sensors,
        noise,
        envelope,
    })
}

/// `3.0`, `{ nominal = 3.0, min = 2.9, max = 3.1 }` or `{ nominal = 3.0, percent = 2 }`.
fn ranged(v: &Value<'_>, limit: Limit) -> Option<Ranged> {
    if !v.is_table() {
        return v.number(limit).map(Ranged::exact);
    }
    v.table(|t| {
        let nominal = t.require("nominal").and_then(|v| v.number(limit));
        let min = t.get("min");
        let max = t.get("max");
        let percent = t.get("percent");
        let share = percent.as_ref().and_then(|v| v.number(Limit::Within(0.0, 100.0)));
        let lo = min.as_ref().and_then(|v| v.number(limit));
        let hi = max.as_ref().and_then(|v| v.number(limit));
        match (&min, &max, &percent) {
            (Some(_), Some(_), None) => {
                let (nominal, lo, hi) = (nominal?, lo?, hi?);
                if !(lo <= nominal && nominal <= hi) {
                    v.problem(format!("has the range {lo} to {hi}, which does not hold its nominal {nominal}"), "");
                    return None;
                }
                Some(Ranged { nominal, range: Interval::new(lo, hi) })
            }
            (None, None, Some(_)) => Some(Ranged::relative(nominal?, share? / 100.0)),
            _ => {
                v.problem("needs either `min` and `max`, or `percent`", "such as { nominal = 3.0, percent = 2 }");
                None
            }
        }
    })
}

/// Three values in body axes; one number alone stands for all three.
fn triple<T: Copy>(v: &Value<'_>, read: impl Fn(&Value<'_>) -> Option<T>) -> Option<[T; 3]> {
    if !v.is_list() {
        return read(v).map(|x| [x; 3]);
    }
    let [x, y, z] = v.array()?;
    let (x, y, z) = (read(&x), read(&y), read(&z));
    Some([x?, y?, z?])
}

fn vector(v: &Value<'_>) -> Option<Vector3<f64>> {
    let [x, y, z] = v.array()?;
    let (x, y, z) = (x.number(Limit::Any), y.number(Limit::Any), z.number(Limit::Any));
    Some(Vector3::new(x?, y?, z?))
}

/// `[xx, yy, zz]`, or `[xx, yy, zz, xy, xz, yz]` with the entries of the matrix (minus the products of inertia).
fn inertia(v: &Value<'_>) -> Option<Matrix3<f64>> {
    let numbers: Option<Vec<f64>> = v.list()?.iter().map(|v| v.number(Limit::Any)).collect();
    let (xx, yy, zz, xy, xz, yz) = match numbers?.as_slice() {
        [xx, yy, zz] => (*xx, *yy, *zz, 0.0, 0.0, 0.0),
        [xx, yy, zz, xy, xz, yz] => (*xx, *yy, *zz, *xy, *xz, *yz),
        other => {
            let problem = format!("must have 3 or 6 numbers, not {}", other.len());
            v.problem(problem, "write [xx, yy, zz] or [xx, yy, zz, xy, xz, yz]");
            return None;
        }
    };
    let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let mut moments: [f64; 3] = matrix.symmetric_eigenvalues().into();
    moments.sort_by(f64::total_cmp);
    let [small, middle, large] = moments;
    if small <= 0.0 {
        v.problem(format!("is not positive definite: its principal moments are {}", list(moments)), "check the signs");
        return None;
    }
    // no mass distribution has one principal moment above the sum of the others; a flat plate reaches equality, so
    // allow for the rounding of published figures
    if large > (small + middle) * 1.02 {
        let problem =
            format!("belongs to no body: of its principal moments {} one exceeds the others' sum", list(moments));
        v.problem(problem, "check the order (xx, yy, zz) and the unit (kg m²)");
        return None;
    }
    Some(matrix)
}

fn list(numbers: [f64; 3]) -> String {
    numbers.map(|x| format!("{x:.4}")).join(", ")
}

fn rotors(t: &mut Table<'_>) -> Vec<Option<Rotor>> {
    let mut taken = [false; MAX_ROTORS];
    let mut count = 0;
    let rotors = t.sections("rotor", |t| {
        count += 1;
        rotor(t, count, &mut taken)
    });
    if count == 0 {
        t.problem("the vehicle has no rotor", "add a [[rotor]] table for each");
    } else if count > MAX_ROTORS {
        t.problem(format!("the vehicle has {count} rotors, but at most {MAX_ROTORS} are supported"), "");
    }
    rotors
}

fn rotor(t: &mut Table<'_>, count: usize, taken: &mut [bool; MAX_ROTORS]) -> Option<Rotor> {
    let position = t.require("position_frd_m").and_then(|v| vector(&v));
    let axis = t.get("axis_frd").map_or(Some(-Vector3::z()), |v| unit_vector(&v));
    let spin = t.require("spin").and_then(|v| v.one_of(&[("ccw", Spin::Ccw), ("cw", Spin::Cw)]));
    let torque_ratio = t.require("torque_ratio_m").and_then(|v| v.number(Limit::NonNegative));
    let output_key = t.get("output");
    let output = match &output_key {
        Some(v) => v.integer(1..=MAX_ROTORS as i64).and_then(|n| usize::try_from(n - 1).ok()),
        None => Some(count - 1),
    };
    if let Some(slot) = output.and_then(|o| taken.get_mut(o))
        && std::mem::replace(slot, true)
    {
        t.problem(
            "two rotors use the same `output`",
            "outputs count from 1; left out, it is the rotor's place in the file",
        );
    }
    Some(Rotor {
        position_frd_m: position?,
        axis_frd: axis?,
        spin: spin?,
        torque_ratio_m: torque_ratio?,
        output: output?,
    })
}

fn unit_vector(v: &Value<'_>) -> Option<Vector3<f64>> {
    let axis = vector(v)?;
    let length = axis.norm();
    // typed figures are rounded: take those within 1 % as meant to be of unit length
    if (length - 1.0).abs() > 0.01 {
        v.problem(format!("must be a unit vector, but its length is {length:.3}"), "[0, 0, -1] thrusts upwards");
        return None;
    }
    Some(axis / length)
}

fn thrust(t: &mut Table<'_>) -> Option<ThrustCurve> {
    let max_n = t.require("max_n").and_then(|v| ranged(&v, Limit::Positive));
    let expo = t.get("expo").and_then(|v| v.number(Limit::Within(-1.0, 1.0)));
    let voltage_ref_v = t.get("voltage_ref_v").and_then(|v| v.number(Limit::Positive));
    let density_ref_kgm3 = t.get("density_ref_kgm3").and_then(|v| v.number(Limit::Positive));
    let inflow_speed_mps = t.get("inflow_speed_mps").and_then(|v| v.number(Limit::Positive));
    Some(ThrustCurve { max_n: max_n?, expo: expo.unwrap_or(0.0), voltage_ref_v, density_ref_kgm3, inflow_speed_mps })
}

fn dynamics(t: &mut Table<'_>) -> RotorDynamics {
    let dynamics = RotorDynamics {
        time_constant_s: number(t, "time_constant_s", Limit::Within(0.0, 5.0), 0.03),
        delay_s: number(t, "delay_s", Limit::Within(0.0, 1.0), 0.0),
        inertia_kgm2: number(t, "inertia_kgm2", Limit::NonNegative, 0.0),
        max_speed_rads: number(t, "max_speed_rads", Limit::NonNegative, 0.0),
    };
    if dynamics.inertia_kgm2 > 0.0 && dynamics.max_speed_rads == 0.0 {
        t.problem("`rotor_dynamics.inertia_kgm2` has no effect without `max_speed_rads`", "add `max_speed_rads = …`");
    }
    dynamics
}

fn drag(t: &mut Table<'_>) -> Drag {
    let mut coefficients = |key| {
        let given = t.get(key).and_then(|v| triple(&v, |v| ranged(v, Limit::NonNegative)));
        given.unwrap_or([Ranged::exact(0.0); 3])
    };
    Drag {
        linear: coefficients("linear_n_per_mps"),
        rotor: coefficients("rotor_n_per_mps_sqrt_n"),
        area_m2: coefficients("area_m2"),
        angular: numbers(t, "angular_nm_per_rads", [0.0; 3]),
    }
}

fn actuators(t: &mut Table<'_>) -> Actuators {
    let sources = [
        ("auto", OutputSource::Auto),
        ("servo_output_raw", OutputSource::ServoOutputRaw),
        ("actuator_output_status", OutputSource::ActuatorOutputStatus),
        ("hil_actuator_controls", OutputSource::HilActuatorControls),
    ];
    let source = t.get("source").and_then(|v| v.one_of(&sources)).unwrap_or(OutputSource::Auto);
    let at_zero = number(t, "at_zero", Limit::Any, 1000.0);
    let at_full = number(t, "at_full", Limit::Any, 2000.0);
    if at_zero == at_full {
        t.problem("`actuators.at_zero` and `actuators.at_full` are equal: no output would move a rotor", "");
    }
    Actuators { source, at_zero, at_full }
}

fn sensors(t: &mut Table<'_>) -> Sensors {
    Sensors {
        accel_delay_s: number(t, "accel_delay_s", Limit::Within(0.0, 0.5), 0.0),
        gyro_delay_s: number(t, "gyro_delay_s", Limit::Within(0.0, 0.5), 0.0),
        gnss_delay_s: number(t, "gnss_delay_s", Limit::Within(0.0, 1.0), 0.0),
    }
}

/// Defaults: a calibrated autopilot with vibration damping and GNSS, seen through telemetry.
fn noise(t: &mut Table<'_>) -> NoiseBounds {
    NoiseBounds {
        accel_mps2: numbers(t, "accel_mps2", [0.5; 3]),
        accel_bias_mps2: numbers(t, "accel_bias_mps2", [0.1; 3]),
        gyro_rads: numbers(t, "gyro_rads", [0.03; 3]),
        position_m: numbers(t, "position_m", [2.0; 3]),
        velocity_mps: numbers(t, "velocity_mps", [0.3; 3]),
        velocity_bias_mps: numbers(t, "velocity_bias_mps", [0.0; 3]),
        tilt_bias_rad: number(t, "tilt_bias_deg", Limit::Within(0.0, 90.0), 0.0).to_radians(),
        tilt_rad: number(t, "tilt_deg", Limit::Within(0.0, 90.0), 1.5).to_radians(),
        yaw_bias_rad: number(t, "yaw_bias_deg", Limit::Within(0.0, 180.0), 0.0).to_radians(),
        yaw_rad: number(t, "yaw_deg", Limit::Within(0.0, 180.0), 5.0).to_radians(),
        density: number(t, "density_percent", Limit::Within(0.0, 90.0), 3.0) / 100.0,
    }
}

/// Defaults: half the weight at the centre of mass, an eighth of it at the arm's end, either built up within half a
/// second; ±1 m/s of vertical wind.
fn envelope(t: &mut Table<'_>, weight_n: f64, arm_m: f64) -> Envelope {
    let (force, torque) = (0.5 * weight_n, 0.125 * weight_n * arm_m);
    Envelope {
        force_n: numbers(t, "force_n", [force; 3]),
        force_rate_nps: numbers(t, "force_rate_nps", [force / 0.5; 3]),
        torque_nm: numbers(t, "torque_nm", [torque; 3]),
        torque_rate_nmps: numbers(t, "torque_rate_nmps", [torque / 0.5; 3]),
        vertical_wind_mps: number(t, "vertical_wind_mps", Limit::NonNegative, 1.0),
    }
}

fn number(t: &mut Table<'_>, key: &'static str, limit: Limit, default: f64) -> f64 {
    t.get(key).and_then(|v| v.number(limit)).unwrap_or(default)
}

fn numbers(t: &mut Table<'_>, key: &'static str, default: [f64; 3]) -> [f64; 3] {
    t.get(key).and_then(|v| triple(&v, |v| v.number(Limit::NonNegative))).unwrap_or(default)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"
name = "test"
mass_kg = { nominal = 2.0, percent = 5 }
inertia_kgm2 = [0.02, 0.02, 0.04, 0.001, 0.0, 0.0]

[[rotor]]
position_frd_m = [0.2, 0.2, 0.0]
axis_frd = [0.0, 0.1, -0.995]
spin = "ccw"
torque_ratio_m = 0.02
output = 3

[[rotor]]
position_frd_m = [-0.2, -0.2, 0.0]
spin = "cw"
torque_ratio_m = 0.02

[thrust]
max_n = 20

[drag]
linear_n_per_mps = [0.1, { nominal = 0.2, min = 0.1, max = 0.4 }, 0]
"#;

    fn problems(source: &str) -> Vec<String> {
        let issues = parse(&Document::new("v.toml", source)).unwrap_err();
        issues.iter().map(|i| format!("{}:{} {}", i.line, i.column, i.problem)).collect()
    }

    #[test]
    fn numbers_may_carry_a_range() {
        let v = parse(&Document::new("v.toml", GOOD)).unwrap();
        assert!(v.mass_kg.range.contains(1.9) && v.mass_kg.range.contains(2.1) && !v.mass_kg.range.contains(2.11));
        assert_eq!(v.drag.linear[1], Ranged { nominal: 0.2, range: Interval::new(0.1, 0.4) });
        assert_eq!(v.drag.area_m2, [Ranged::exact(0.0); 3]);
        assert_eq!(v.inertia_kgm2[(1, 0)], 0.001);
        assert_eq!(v.rotors.iter().map(|r| r.output).collect::<Vec<_>>(), [2, 1]);
        assert!((v.rotors[0].axis_frd.norm() - 1.0).abs() < 1e-12);
        assert_eq!(v.envelope.force_n[0], GRAVITY_MPS2);
    }

    #[test]
    fn every_problem_of_a_file_is_told_at_once() {
        let bad = GOOD
            .replace("nominal = 2.0, percent = 5", "nominal = -2.0, percent = 5")
            .replace("0.04, 0.001", "0.06, 0.001")
            .replace("-0.995", "-1.5")
            .replace("spin = \"cw\"", "spin = \"clockwise\"\noutput = 3")
            .replace("max_n = 20", "max = 20")
            .replace("min = 0.1", "min = 0.3");
        let found = problems(&bad);
        let expected = [
            "`mass_kg.nominal` must be greater than 0, not -2",
            "`inertia_kgm2` belongs to no body",
            "`rotor[1].axis_frd` must be a unit vector",
            "two rotors use the same `output`",
            "`rotor[2].spin` must be one of \"ccw\", \"cw\", not \"clockwise\"",
            "`thrust.max_n` is missing",
            "unknown key `max` in `thrust`",
            "`drag.linear_n_per_mps[2]` has the range 0.3 to 0.4, which does not hold its nominal 0.2",
        ];
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for (f, e) in found.iter().zip(expected) {
            assert!(f.contains(e), "{f} / {e}");
        }
    }

    #[test]
    fn a_vehicle_needs_rotors_and_a_definite_inertia() {
        let found =
            problems("name = 'x'\nmass_kg = nan\ninertia_kgm2 = [0.02, 0.02, 0.04, 0.03, 0, 0]\nthrust.max_n = 1");
        assert!(found.iter().any(|p| p.contains("no rotor")), "{found:?}");
        assert!(found.iter().any(|p| p.contains("`mass_kg` must be a finite number")), "{found:?}");
        assert!(found.iter().any(|p| p.contains("not positive definite")), "{found:?}");
    }

    #[test]
    fn an_unknown_preset_names_the_nearest() {
        let message = resolve("ardupilot-sitl").unwrap_err().to_string();
        assert!(message.contains("did you mean `arducopter-sitl`?") && message.contains("px4-x500"), "{message}");
        assert!(matches!(resolve("./nowhere.toml"), Err(VehicleError::Unreadable { .. })));
    }
}
