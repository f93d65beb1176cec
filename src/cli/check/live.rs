use crate::cli::run::pairing;
use crate::cli::{Failure, print};
use crate::config::Config;
use serde_json::json;

pub(super) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (1.0..=3_600.0).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number of seconds, 1 to 3600".to_owned()),
    }
}

/// Pairs for so long, and shows what came of it.
pub(super) fn run(config: Config, seconds: f64, as_json: bool) -> Result<(), Failure> {
    if config.links.is_empty() {
        return Err(Failure::Usage("--live needs a link: give one with --link or [[link]]".to_owned()));
    }
    if !config.requests.streams {
        return Err(Failure::Usage("--live asks the vehicles, and `[requests] streams = false` forbids it".to_owned()));
    }
    let status = pairing::pair(config, seconds)?;
    if status.pairings.is_empty() {
        return Err(Failure::Failed(format!("no autopilot of a multirotor was heard within {seconds:.0} s")));
    }
    if as_json {
        return print(&format!(
            "{:#}",
            json!({ "pairings": status.pairings.iter().map(pairing::json).collect::<Vec<_>>() })
        ));
    }
    let mut out = String::new();
    for (id, decisions) in &status.pairings {
        // writing to a String cannot fail
        let _ = pairing::table(&mut out, id, decisions);
    }
    print(out.trim_end())
}
