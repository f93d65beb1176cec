use super::output::output;
use super::record::record;
use super::rules::rules;
use super::signing::signing;
use super::{Config, Link, LinkUrl, Requests, Vehicles};
use crate::document::{Limit, Table, Value};
use crate::faults::FaultSettings;
use crate::observers::{OptionValue, Options, REGISTRY};
use crate::outputs::OutputSettings;
use crate::pipeline::ObserverSetting;
use crate::vehicle::{Vehicle, VehicleError, from_file, presets, resolve};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use tracing_subscriber::EnvFilter;

pub(super) fn config(t: &mut Table<'_>, base: &Path) -> Option<Config> {
    let defaults = Config::default();
    let mut parameters = None;
    let output = t.section("output", |t| {
        parameters = t.get("parameters").and_then(|v| v.text()).map(|file| base.join(file));
        output(t, defaults.output)
    });
    let links = links(t, base, output);
    let vehicles = t.section("vehicle", |t| vehicles(t, base));
    let observers = t.get("observer").is_some().then(|| observers(t));
    let record = t.section("record", |t| record(t, base));
    let requests = t.section("requests", requests);
    let duplicates = t.section("bridge", |t| t.get("duplicates_ms").and_then(|v| v.integer(0..=10_000)));
    let duplicates =
        duplicates.and_then(|ms| u64::try_from(ms).ok()).map_or(defaults.duplicates, Duration::from_millis);
    let metrics = t.section("metrics", |t| t.get("listen").and_then(|v| address(&v)));
    let log = t.section("log", |t| t.get("filter").and_then(|v| log_filter(&v))).unwrap_or(defaults.log);
    let observers = observers.unwrap_or(defaults.observers);
    let faults = t.section("faults", faults);
    Some(Config {
        links: links?,
        vehicles,
        observers,
        faults,
        output,
        parameters,
        record,
        requests,
        duplicates,
        metrics,
        log,
    })
}

fn links(t: &mut Table<'_>, base: &Path, defaults: OutputSettings) -> Option<Vec<Link>> {
    let (mut names, mut bound) = (Vec::new(), Vec::new());
    let mut number = 0;
    let links = t.sections("link", |t| {
        let url_key = t.require("url");
        let url = url_key.as_ref().and_then(|v| link_url(v, base));
        if let (Some(v), Some(claim)) = (&url_key, url.as_ref().and_then(LinkUrl::claims)) {
            if bound.contains(&claim) {
                v.problem(format!("is the second link on {claim}"), "one link serves any number of peers");
            }
            bound.push(claim);
        }
        let name_key = t.get("name");
        let name = match (&name_key, &url) {
            (Some(v), _) => v.text().map(str::to_owned),
            (None, url) => url.as_ref().map(LinkUrl::to_string),
        };
        if let Some(name) = &name {
            if names.contains(name) {
                t.problem(format!("two links are named `{name}`"), "give each its own `name`");
            }
            names.push(name.clone());
        }
        let output = t.section("output", |t| output(t, defaults));
        let rules = rules(t);
        let signing = t.section("signing", |t| signing(t, base, number));
        number += 1;
        Some(Link { name: name?, url: url?, output, rules, signing })
    });
    links.into_iter().collect()
}

fn link_url(v: &Value<'_>, base: &Path) -> Option<LinkUrl> {
    match v.text()?.parse::<LinkUrl>() {
        Ok(url) => Some(url.relative_to(base)),
        Err(e) => {
            v.problem(format!("is no link: {e}"), "");
            None
        }
    }
}

fn vehicles(t: &mut Table<'_>, base: &Path) -> Vehicles {
    let default = vehicle(t, base).map(Arc::new);
    let mut by_system = BTreeMap::new();
    for (system, v) in t.take_matching(|key| key.parse::<u8>().ok().filter(|id| *id > 0)) {
        let own = v.table(|t| {
            let own = vehicle(t, base);
            if t.is_empty() {
                t.problem(format!("system {system} has no model"), "add `preset = …` or `file = …`");
            }
            own
        });
        by_system.extend(own.map(|vehicle| (system, Arc::new(vehicle))));
    }
    Vehicles { default, by_system }
}

fn vehicle(t: &mut Table<'_>, base: &Path) -> Option<Vehicle> {
    match (t.get("preset"), t.get("file")) {
        (Some(_), Some(file)) => {
            file.problem("stands beside `preset`", "keep one of them");
            None
        }
        (Some(v), None) => {
            let name = v.text()?;
            if presets::text(name).is_some() {
                return load(&v, resolve(name));
            }
            let words: Vec<_> = presets::names().map(|n| (n, ())).collect();
            v.one_of(&words);
            None
        }
        (None, Some(v)) => load(&v, from_file(&base.join(PathBuf::from(v.text()?)))),
        (None, None) => None,
    }
}

fn load(v: &Value<'_>, loaded: Result<Vehicle, VehicleError>) -> Option<Vehicle> {
    match loaded {
        Ok(vehicle) => Some(vehicle),
        Err(VehicleError::Invalid { issues, .. }) => {
            v.adopt(issues);
            None
        }
        Err(other) => {
            v.problem(format!("cannot be used: {other}"), "");
            None
        }
    }
}

fn observers(t: &mut Table<'_>) -> Vec<ObserverSetting> {
    let mut running = Vec::new();
    let observers = t.sections("observer", |t| {
        let names: Vec<_> = REGISTRY.iter().map(|r| (r.name, r)).collect();
        let name = t.require("name");
        let chosen = name.as_ref().and_then(|v| v.one_of(&names));
        let enabled = t.get("enabled").and_then(|v| v.flag()).unwrap_or(true);
        // with an unknown name any observer's options pass: the name is the mistake to tell
        let mut options = Options::default();
        for key in REGISTRY.iter().filter(|r| chosen.is_none_or(|c| c.name == r.name)).flat_map(|r| r.options) {
            if let Some(value) = t.get(key).and_then(|v| option(&v)) {
                options.insert(*key, value);
            }
        }
        let (name, chosen) = (name?, chosen?);
        if enabled && running.contains(&chosen.name) {
            name.problem("runs already", "an observer runs once on each vehicle");
        }
        running.extend(enabled.then_some(chosen.name));
        enabled.then(|| ObserverSetting { options, ..ObserverSetting::named(chosen.name) })
    });
    observers.into_iter().flatten().collect()
}

fn option(v: &Value<'_>) -> Option<OptionValue> {
    if v.is_text() {
        v.text().map(|text| OptionValue::Text(text.to_owned()))
    } else if v.is_flag() {
        v.flag().map(OptionValue::Bool)
    } else {
        v.number(Limit::Any).map(OptionValue::Number)
    }
}

fn address(v: &Value<'_>) -> Option<SocketAddr> {
    let address = v.text()?.parse();
    if address.is_err() {
        v.problem("is no address with a port", "such as \"127.0.0.1:9150\"");
    }
    address.ok()
}

fn log_filter(v: &Value<'_>) -> Option<String> {
    let filter = v.text()?;
    if let Err(e) = EnvFilter::try_new(filter) {
        v.problem(format!("is no log filter: {e}"), "such as \"info\" or \"warn,mavobserver::daemon=debug\"");
        return None;
    }
    Some(filter.to_owned())
}

fn faults(t: &mut Table<'_>) -> FaultSettings {
    let [least, most] = FaultSettings::RATES;
    let rate = t.get("false_alarms_per_hour").and_then(|v| v.number(Limit::Within(least, most)));
    rate.map_or_else(FaultSettings::default, |false_alarms_per_hour| FaultSettings { false_alarms_per_hour })
}

fn requests(t: &mut Table<'_>) -> Requests {
    let defaults = Requests::default();
    let streams = t.get("streams").and_then(|v| v.flag()).unwrap_or(defaults.streams);
    let rate_key = t.get("rate_hz");
    if let (Some(v), false) = (&rate_key, streams) {
        v.warn("has no effect while `streams` is false", "");
    }
    let rate_hz = rate_key.and_then(|v| v.number(Limit::Within(1.0, 500.0))).unwrap_or(defaults.rate_hz);
    Requests { streams, rate_hz }
}
