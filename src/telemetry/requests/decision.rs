use super::{Asked, Before, Stream, StreamRequester, Subject, Target, Want};
use crate::signal::Channel;
use crate::wire::message_info;

/// What became of one channel that is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// `None` is the landed state.
    pub channel: Option<Channel>,
    pub wanted_hz: f64,
    pub measured_hz: f64,
    /// Nine tenths of what is wanted arrive, or it can be done without.
    pub enough: bool,
    /// What was asked for and how it was answered, in words.
    pub course: String,
}

impl StreamRequester {
    /// What was decided for every channel, in the order in which they are asked for.
    pub fn decisions(&mut self, now_ms: u64) -> Vec<Decision> {
        (0..self.wants.len()).map(|index| self.decision(index, now_ms)).collect()
    }

    /// The part of the wanted rates that the link carries, 1 for all.
    pub fn pace(&self) -> f64 {
        self.pace.factor()
    }

    fn decision(&mut self, index: usize, now_ms: u64) -> Decision {
        let measured_hz = self.measured_hz(index, now_ms);
        let Want { subject, rate_hz, optional, streams, .. } = &self.wants[index];
        let (subject, wanted_hz, optional) = (*subject, *rate_hz, *optional);
        let mut steps = Vec::new();
        for &stream in streams {
            let stream = &mut self.streams[stream];
            let comes = stream.rate.hz(now_ms) > 0.0;
            if let Some(step) = stream.step(comes) {
                steps.push(step);
            }
        }
        let course = if steps.is_empty() { "not asked for yet".to_owned() } else { steps.join("; ") };
        let channel = if let Subject::Channel(channel) = subject { Some(channel) } else { None };
        let enough = optional || super::judge::is_good(measured_hz, wanted_hz);
        Decision { channel, wanted_hz, measured_hz, enough, course }
    }
}

impl Stream {
    /// What happened to this message or group; `None` if nothing has.
    fn step(&self, comes: bool) -> Option<String> {
        let name = match self.request {
            Target::Message(id) => message_info(id).map_or_else(|| format!("message {id}"), |i| i.name.to_owned()),
            Target::Group(id) => format!("stream group {id}"),
        };
        let before = match self.before {
            Before::Told { interval_us } if interval_us > 0 => format!(", was {:.1} Hz", 1e6 / f64::from(interval_us)),
            Before::Told { .. } | Before::Untold { came: false } => ", was off".to_owned(),
            Before::NotAsked | Before::Open { .. } | Before::Untold { .. } => String::new(),
        };
        let asked_hz = self.asked_hz;
        Some(match self.asked {
            Asked::No { attempts: 0, .. } if comes => format!("{name} came unasked"),
            Asked::No { attempts: 0, .. } => return None,
            Asked::No { .. } | Asked::Open { .. } => format!("{name} asked for at {asked_hz:.1} Hz"),
            Asked::Granted { .. } if comes => format!("{name} granted at {asked_hz:.1} Hz{before}"),
            Asked::Granted { .. } => format!("{name} granted at {asked_hz:.1} Hz{before}, silent"),
            Asked::Refused => format!("{name} refused"),
            Asked::Unanswered if comes => format!("{name} asked for at {asked_hz:.1} Hz, comes without an answer"),
            Asked::Unanswered => format!("{name} not answered"),
        })
    }
}
