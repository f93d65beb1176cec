use super::read::number_or;
use super::{Home, Scenario, bundled, faults, mission, vary, weather};
use crate::document::{Document, Issues, Limit, Table, Value, nearest};
use crate::sim::control::Limits;
use crate::sim::dynamics::Battery;
use crate::sim::faults::{Fault, FaultKind};
use crate::sim::feed::Stack;
use crate::sim::sensors::{NoiseShape, SensorSuite};
use crate::sim::{FlightPlan, NavigationSource};
use crate::vehicle::{self, Vehicle};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Why there is no scenario.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    #[error("no scenario is called `{name}`{hint}\nknown: {known}; or give the path of a TOML file")]
    Unknown { name: String, hint: String, known: String },
    #[error("{}: {source}", path.display())]
    Unreadable { path: PathBuf, source: std::io::Error },
    #[error("{}: {issues}", path.display())]
    Invalid { path: PathBuf, issues: Issues },
}

/// The scenario that a command line names: one that comes with the program, or the path of a TOML file.
pub fn resolve(name_or_file: &str) -> Result<Scenario, ScenarioError> {
    if let Some(text) = bundled::text(name_or_file) {
        let path = PathBuf::from(format!("config/scenarios/{name_or_file}.toml"));
        let document = Document::new(path.display().to_string(), text);
        return parse(&document, Path::new("")).map_err(|issues| ScenarioError::Invalid { path, issues });
    }
    let path = Path::new(name_or_file);
    if path.components().count() > 1 || path.extension().is_some_and(|e| e == "toml") || path.is_file() {
        return from_file(path);
    }
    let hint = nearest(name_or_file, bundled::names()).map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
    let known = bundled::names().collect::<Vec<_>>().join(", ");
    Err(ScenarioError::Unknown { name: name_or_file.to_owned(), hint, known })
}

/// The scenario in a file. Files it names are looked for beside it.
pub fn from_file(path: &Path) -> Result<Scenario, ScenarioError> {
    let document =
        Document::open(path).map_err(|source| ScenarioError::Unreadable { path: path.to_owned(), source })?;
    let folder = path.parent().unwrap_or(Path::new(""));
    parse(&document, folder).map_err(|issues| ScenarioError::Invalid { path: path.to_owned(), issues })
}

/// A checked scenario, or everything that is wrong with it.
pub fn parse(document: &Document, folder: &Path) -> Result<Scenario, Issues> {
    document.read(|t| scenario(t, folder)).map(|(scenario, _warnings)| scenario)
}

#[derive(Clone, Copy)]
enum SensorChoice {
    Bounded,
    Mems,
    ArduPilotSitl,
    Px4Sih,
    Perfect,
}

fn scenario(t: &mut Table<'_>, folder: &Path) -> Option<Scenario> {
    let name = t.require("name").and_then(|v| v.text());
    let description = t.get("description").map_or(Some(""), |v| v.text());
    let vehicle = t.require("vehicle").and_then(|v| vehicle_of(&v, folder));
    let stack = t
        .get("autopilot")
        .map_or(Some(Stack::ArduPilot), |v| v.one_of(&[("ardupilot", Stack::ArduPilot), ("px4", Stack::Px4)]));
    let seed = t.get("seed").map_or(Some(1), |v| v.integer(0..=i64::MAX));
    let duration_s = t.require("duration_s").and_then(|v| v.number(Limit::Positive));
    let vehicles = t.get("vehicles").map_or(Some(1), |v| v.integer(1..=250));
    let sensors = t.get("sensors").map_or(Some(SensorChoice::Bounded), |v| {
        v.one_of(&[
            ("bounded", SensorChoice::Bounded),
            ("mems", SensorChoice::Mems),
            ("ardupilot-sitl", SensorChoice::ArduPilotSitl),
            ("px4-sih", SensorChoice::Px4Sih),
            ("perfect", SensorChoice::Perfect),
        ])
    });
    let noise = t.get("noise").map_or(Some(None), |v| {
        v.one_of(&[
            ("bounded", Some(NoiseShape::Truncated { sigmas: 3.0 })),
            ("gaussian", Some(NoiseShape::Gaussian)),
            ("uniform", Some(NoiseShape::Uniform)),
        ])
    });
    let navigation = t.get("navigation").map_or(Some(NavigationSource::Estimator), |v| {
        v.one_of(&[("estimator", NavigationSource::Estimator), ("truth", NavigationSource::Truth)])
    });
    let sampled = t.get("model").map_or(Some(false), |v| v.one_of(&[("exact", false), ("sampled", true)]));
    let home = t.section("home", home);
    let limits = t.section("limits", limits);
    let battery = t.section("battery", |t| battery(t, vehicle.as_ref()));
    let legs = t.sections("mission", mission::leg);
    let weather = t.section("wind", |t| weather::weather(t, folder));
    let disturbances = t.sections("disturbance", weather::disturbance);
    let mut all_faults = t.sections("fault", |t| faults::fault(t, vehicle.as_ref()));
    let link = t.get("link").map(|v| v.table(faults::link));
    let streams = t.section("streams", streams);
    let vary = t.section("vary", vary::vary);
    if let Some(trouble) = link {
        let kind = trouble.map(FaultKind::Link);
        all_faults.push(kind.map(|kind| Fault { kind, from_s: 0.0, until_s: f64::INFINITY }));
    }

    let (vehicle, stack, home, weather) = (vehicle?, stack?, home?, weather?);
    let (limits, acceleration_mps2) = limits?;
    let suite = match sensors? {
        SensorChoice::Bounded => SensorSuite::within_bounds_of(&vehicle),
        SensorChoice::Mems => SensorSuite::mems(&vehicle),
        SensorChoice::ArduPilotSitl => SensorSuite::ardupilot_sitl(&vehicle),
        SensorChoice::Px4Sih => SensorSuite::px4_sih(&vehicle),
        SensorChoice::Perfect => SensorSuite::perfect(&vehicle),
    };
    let suite = noise?.map_or(suite, |shape| suite.with_noise(shape));
    let (step_s, steps_per_loop) = stack.timing();
    let plan = FlightPlan {
        model: vehicle.clone(),
        vehicle,
        seed: u64::try_from(seed?).ok()?,
        system: 1,
        step_s,
        steps_per_loop,
        home_altitude_m: home.altitude_m,
        heading_rad: home.heading_deg.to_radians(),
        battery: Some(battery?),
        sensors: suite,
        navigation: navigation?,
        limits,
        acceleration_mps2,
        mission: legs.into_iter().collect::<Option<_>>()?,
        wind: weather.mean,
        gusts: weather.gusts,
        turbulence: weather.turbulence,
        disturbances: disturbances.into_iter().collect::<Option<_>>()?,
        faults: all_faults.into_iter().collect::<Option<_>>()?,
    };
    Some(Scenario {
        name: name?.to_owned(),
        description: description?.to_owned(),
        duration_s: duration_s?,
        stack,
        home,
        vehicles: u8::try_from(vehicles?).ok()?,
        streams,
        sampled: sampled?,
        vary: vary?,
        plan,
    })
}

/// A preset, or a file beside the scenario.
fn vehicle_of(v: &Value<'_>, folder: &Path) -> Option<Vehicle> {
    let name = v.text()?;
    let found = match name.ends_with(".toml") {
        true => vehicle::from_file(&folder.join(name)),
        false => vehicle::resolve(name),
    };
    let vehicle = match found {
        Ok(vehicle) => vehicle,
        Err(e) => {
            v.problem(format!("names a vehicle that cannot be used: {e}"), "");
            return None;
        }
    };
    if vehicle.facts().hover_command.is_none() {
        v.problem(format!("names `{name}`, which cannot lift itself"), "a scenario needs a vehicle that flies");
        return None;
    }
    Some(vehicle)
}

fn home(t: &mut Table<'_>) -> Option<Home> {
    let latitude = number_or(t, "latitude_deg", Limit::Within(-85.0, 85.0), -35.363_262);
    let longitude = number_or(t, "longitude_deg", Limit::Within(-180.0, 180.0), 149.165_237);
    let altitude = number_or(t, "altitude_m", Limit::Within(-400.0, 9000.0), 584.0);
    let heading = number_or(t, "heading_deg", Limit::Within(-360.0, 360.0), 0.0);
    Some(Home { latitude_deg: latitude?, longitude_deg: longitude?, altitude_m: altitude?, heading_deg: heading? })
}

fn limits(t: &mut Table<'_>) -> Option<(Limits, f64)> {
    let base = Limits::default();
    let tilt = number_or(t, "tilt_deg", Limit::Within(5.0, 70.0), base.tilt_rad.to_degrees());
    let catch_up = number_or(t, "catch_up_mps", Limit::Positive, base.catch_up_mps);
    let acceleration = number_or(t, "acceleration_mps2", Limit::Positive, 2.5);
    Some((Limits { tilt_rad: tilt?.to_radians(), catch_up_mps: catch_up?, ..base }, acceleration?))
}

fn battery(t: &mut Table<'_>, vehicle: Option<&Vehicle>) -> Option<Battery> {
    let reference = vehicle.and_then(|v| v.thrust.voltage_ref_v).unwrap_or(12.6);
    let mass = vehicle.map_or(1.0, |v| v.mass_kg.nominal);
    let full = number_or(t, "full_v", Limit::Positive, reference);
    let current = number_or(t, "hover_current_a", Limit::Positive, 8.0 * mass);
    let typical = Battery::typical(full?, current?);
    let capacity = number_or(t, "capacity_ah", Limit::Positive, typical.capacity_ah);
    let resistance = number_or(t, "resistance_ohm", Limit::NonNegative, typical.resistance_ohm);
    let empty = number_or(t, "empty_v", Limit::Positive, typical.empty_v);
    Some(Battery { capacity_ah: capacity?, resistance_ohm: resistance?, empty_v: empty?, ..typical })
}

/// Message names and rates in Hz.
fn streams(t: &mut Table<'_>) -> BTreeMap<String, f64> {
    let mut rates = BTreeMap::new();
    for (name, value) in t.take_matching(|key| Some(key.to_owned())) {
        if !crate::sim::feed::can_send(&name) {
            value.problem("is no message the simulator sends", "names are MAVLink's, such as ATTITUDE_QUATERNION");
        } else if let Some(hz) = value.number(Limit::Within(0.0, 1000.0)) {
            rates.insert(name, hz);
        }
    }
    rates
}
