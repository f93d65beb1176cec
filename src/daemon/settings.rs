use crate::config::{Link, Recording, Vehicles};
use crate::telemetry::requests::Need;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

/// What a [`Daemon`](super::Daemon) is to do.
#[derive(Debug, Clone)]
pub struct Settings {
    pub links: Vec<Link>,
    /// What live vehicles are asked for; `None` asks for nothing, not even the time.
    pub requests: Option<Vec<Need>>,
    /// The models, to be compared with what the vehicles tell of themselves.
    pub models: Vehicles,
    /// Where recordings go; `None` records nothing.
    pub record: Option<Recording>,
    /// How long a frame is known, to remove it when it comes again by another link.
    pub duplicates: Duration,
    /// Where Prometheus may ask for numbers.
    pub metrics: Option<SocketAddr>,
    /// Where parameters that ground stations set are kept; `None` forgets them.
    pub parameters: Option<PathBuf>,
    /// How long the parts may take to stop.
    pub stop_within: Duration,
    /// Time between two rounds of status lines.
    pub status_every: Duration,
}

impl Settings {
    /// These links, with everything else as usual: nothing is asked for and nothing recorded.
    pub fn new(links: Vec<Link>) -> Self {
        Self {
            links,
            requests: None,
            models: Vehicles::default(),
            record: None,
            duplicates: Duration::from_millis(500),
            metrics: None,
            parameters: None,
            stop_within: Duration::from_secs(5),
            status_every: Duration::from_secs(10),
        }
    }
}
