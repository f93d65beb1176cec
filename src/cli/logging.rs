use super::Verbosity;
use std::io::IsTerminal;
use std::sync::OnceLock;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Registry, fmt, reload};

/// Overrides the config's filter; the flags override both.
const VARIABLE: &str = "MAVOBSERVER_LOG";

/// The filter that a config may still replace; unset once the user has chosen one.
static REPLACEABLE: OnceLock<reload::Handle<EnvFilter, Registry>> = OnceLock::new();

/// Starts logging to standard error. Calling it again has no effect.
pub(super) fn start(verbosity: Verbosity) {
    let chosen = match (verbosity.quiet, verbosity.verbose) {
        (true, _) => Some("error".to_owned()),
        (false, 0) => std::env::var(VARIABLE).ok(),
        (false, 1) => Some("info,mavobserver=debug".to_owned()),
        (false, _) => Some("trace".to_owned()),
    };
    let filter = EnvFilter::new(chosen.as_deref().unwrap_or("info"));
    let (filter, handle) = reload::Layer::new(filter);
    let colour = std::io::stderr().is_terminal();
    let lines = fmt::layer().with_writer(std::io::stderr).with_target(false).with_ansi(colour).compact();
    let started = tracing_subscriber::registry().with(filter).with(lines).try_init().is_ok();
    if started && chosen.is_none() {
        // cannot be set already: `try_init` succeeds only once
        let _ = REPLACEABLE.set(handle);
    }
}

/// Lets the config's filter take effect where neither flags nor environment chose one. An invalid filter is ignored:
/// the config reader has refused it.
pub(super) fn adopt(filter: &str) {
    if let (Some(handle), Ok(filter)) = (REPLACEABLE.get(), EnvFilter::try_new(filter)) {
        // fails only when the subscriber is gone, and with it the logging
        let _ = handle.reload(filter);
    }
}
