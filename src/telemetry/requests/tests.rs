use super::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::collections::{BTreeMap, BTreeSet};

const STEP_MS: u64 = 5;

/// An autopilot as far as streams go: what it knows, what it refuses, and what the link loses.
struct SimulatedAutopilot {
    knows: BTreeSet<u32>,
    /// Acknowledged, then never sent.
    mute: BTreeSet<u32>,
    refuses_intervals: bool,
    groups: BTreeMap<u8, Vec<u32>>,
    /// Message to rate.
    streams: BTreeMap<u32, f64>,
    fastest_hz: f64,
    loss: f64,
    rng: ChaCha8Rng,
}

impl SimulatedAutopilot {
    fn knowing(messages: &[u32]) -> Self {
        Self {
            knows: messages.iter().copied().collect(),
            mute: BTreeSet::new(),
            refuses_intervals: false,
            groups: BTreeMap::new(),
            streams: BTreeMap::from([(0, 1.0)]),
            fastest_hz: 1e3,
            loss: 0.0,
            rng: ChaCha8Rng::seed_from_u64(7),
        }
    }

    /// Obeys; returns the MAV_RESULT of its answer, if there is one.
    fn obey(&mut self, request: Request) -> Option<u8> {
        if self.rng.random_bool(self.loss) {
            return None;
        }
        match request {
            Request::DataStream { stream_id, rate_hz } => {
                for &message in self.groups.get(&stream_id).into_iter().flatten() {
                    self.streams.insert(message, f64::from(rate_hz).min(self.fastest_hz));
                }
                None
            }
            Request::MessageInterval { message_id, interval_us } => {
                let known = self.knows.contains(&message_id) && !self.refuses_intervals;
                if known && !self.mute.contains(&message_id) {
                    self.streams.insert(message_id, (1e6 / f64::from(interval_us)).min(self.fastest_hz));
                }
                (!self.rng.random_bool(self.loss)).then_some(if known { 0 } else { 3 })
            }
        }
    }
}

/// Runs both sides and keeps what happened.
struct Scene {
    autopilot: SimulatedAutopilot,
    requester: StreamRequester,
    now_ms: u64,
    requests: Vec<(u64, Request)>,
    notices: Vec<Notice>,
}

impl Scene {
    fn new(kind: Autopilot, autopilot: SimulatedAutopilot, channels: &[Channel]) -> Self {
        let needs: Vec<_> = channels.iter().map(|&c| Need::at_default_rate(c)).collect();
        Self {
            autopilot,
            requester: StreamRequester::new(kind, &needs, 1_000),
            now_ms: 1_000,
            requests: Vec::new(),
            notices: Vec::new(),
        }
    }

    fn run(&mut self, seconds: u64) {
        for _ in 0..seconds * 1_000 / STEP_MS {
            self.now_ms += STEP_MS;
            for (&message, &hz) in &self.autopilot.streams {
                let due = |ms: u64| (ms as f64 * hz / 1e3) as u64;
                if due(self.now_ms) > due(self.now_ms - STEP_MS) {
                    self.requester.heard(message, self.now_ms);
                }
            }
            let request = self.requester.poll(self.now_ms, &mut |n| self.notices.push(n));
            if let Some(request) = request {
                self.requests.push((self.now_ms, request));
                if let Some(result) = self.autopilot.obey(request) {
                    self.requester.command_ack(result, self.now_ms + STEP_MS);
                }
            }
        }
    }

    fn asked_for(&self) -> Vec<u32> {
        let id =
            |r: &Request| if let Request::MessageInterval { message_id, .. } = r { Some(*message_id) } else { None };
        self.requests.iter().filter_map(|(_, r)| id(r)).collect()
    }
}

const NEEDED: [Channel; 4] = [Channel::Imu, Channel::Attitude, Channel::Velocity, Channel::Actuators];

#[test]
fn asks_once_for_each_message_and_is_content() {
    let mut scene = Scene::new(Autopilot::Px4, SimulatedAutopilot::knowing(&[31, 32, 105, 245, 375]), &NEEDED);
    scene.run(120);
    assert_eq!(scene.asked_for(), [105, 31, 32, 375, 245]);
    assert!(scene.requests.iter().all(|(ms, _)| *ms >= 1_000 + LOOK_FIRST_MS), "looks before it asks");
    assert_eq!(scene.requests[0].1, Request::MessageInterval { message_id: 105, interval_us: 20_000.0 });
    assert!(scene.notices.is_empty());
}

#[test]
fn leaves_running_streams_alone() {
    let mut autopilot = SimulatedAutopilot::knowing(&[]);
    autopilot.streams.extend([(30, 100.0), (27, 50.0), (32, 50.0), (36, 48.0), (245, 1.0)]);
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &NEEDED);
    scene.run(60);
    assert_eq!(scene.requests, []);
}

#[test]
fn takes_the_next_message_when_one_is_refused_or_stays_silent() {
    let mut autopilot = SimulatedAutopilot::knowing(&[27, 31, 30, 245]);
    autopilot.mute.insert(31);
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &[Channel::Imu, Channel::Attitude]);
    scene.run(60);
    assert_eq!(scene.asked_for(), [105, 27, 31, 245, 30]);
    assert!(scene.notices.is_empty());
}

#[test]
fn falls_back_to_groups_where_intervals_are_refused() {
    let mut autopilot = SimulatedAutopilot::knowing(&[]);
    autopilot.groups = BTreeMap::from([(1, vec![27, 29]), (3, vec![36]), (6, vec![32, 33]), (10, vec![30])]);
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &NEEDED);
    scene.run(120);
    let groups: Vec<_> =
        scene.requests.iter().filter(|(_, r)| matches!(r, Request::DataStream { .. })).map(|(_, r)| *r).collect();
    assert_eq!(groups, [1, 10, 6, 3].map(|stream_id| Request::DataStream { stream_id, rate_hz: 50 }));
    assert!(scene.notices.is_empty(), "{:?}", scene.notices);
}

#[test]
fn a_lossy_link_is_asked_again_until_the_streams_run() {
    let mut autopilot = SimulatedAutopilot::knowing(&[27, 31, 32, 36, 105, 245]);
    autopilot.loss = 0.4;
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &NEEDED);
    scene.run(180);
    for messages in [[105, 27], [31, 30], [32, 33], [36, 36]] {
        assert!(messages.iter().any(|m| scene.autopilot.streams.contains_key(m)), "none of {messages:?} runs");
    }
    assert!(scene.requests.len() < 60, "{} requests", scene.requests.len());
}

#[test]
fn a_reboot_and_a_lost_stream_are_noticed_by_their_rates_and_by_word() {
    let mut scene = Scene::new(Autopilot::Px4, SimulatedAutopilot::knowing(&[31, 32, 105, 245, 375]), &NEEDED);
    scene.run(90);
    let before = scene.requests.len();
    scene.autopilot.streams.remove(&105);
    scene.run(30);
    assert_eq!(scene.asked_for()[before..], [105], "one stream was stopped");

    let before = scene.requests.len();
    scene.autopilot.streams.retain(|&id, _| id == 0);
    scene.requester.rebooted(scene.now_ms);
    scene.run(10);
    assert_eq!(scene.asked_for()[before..], [105, 31, 32, 375, 245], "everything was forgotten");
}

#[test]
fn unmet_needs_are_reported_once_with_their_cause_and_never_flood() {
    let mut autopilot = SimulatedAutopilot::knowing(&[291, 245]);
    autopilot.mute.insert(291);
    autopilot.streams.insert(375, 10.0);
    autopilot.fastest_hz = 10.0;
    autopilot.knows.insert(375);
    let mut scene = Scene::new(Autopilot::Px4, autopilot, &[Channel::Imu, Channel::Rpm, Channel::Actuators]);
    scene.run(3_600);
    let causes: BTreeSet<_> = scene
        .notices
        .iter()
        .map(|n| match n {
            Notice::Unmet { channel, cause, .. } => (*channel, format!("{cause:?}")),
            Notice::Met { .. } => panic!("nothing was met"),
        })
        .collect();
    let expected = [(Channel::Imu, "Refused"), (Channel::Rpm, "Silent"), (Channel::Actuators, "Slow")];
    assert_eq!(causes, expected.map(|(c, s)| (c, s.to_owned())).into());
    assert_eq!(scene.notices.len(), 3, "each change once");
    // rests of 10, 20, … 300 s: about 16 rounds an hour, four messages each
    assert!(scene.requests.len() < 100, "{} requests in an hour", scene.requests.len());

    scene.autopilot.streams.insert(105, 50.0);
    scene.run(10);
    assert!(matches!(scene.notices.last(), Some(Notice::Met { channel: Channel::Imu, .. })));
}

#[test]
fn what_is_only_welcome_is_asked_for_and_not_missed() {
    let needs = [Need::at_default_rate(Channel::Gnss), Need::at_default_rate(Channel::Battery).optional()];
    let mut scene = Scene::new(Autopilot::Px4, SimulatedAutopilot::knowing(&[]), &[]);
    scene.requester = StreamRequester::new(Autopilot::Px4, &needs, 1_000);
    scene.run(60);
    assert!(scene.asked_for().contains(&147));
    assert!(matches!(scene.notices[..], [Notice::Unmet { channel: Channel::Gnss, .. }]), "{:?}", scene.notices);
}

#[test]
fn an_unanswering_vehicle_is_asked_three_times_ever_later() {
    let mut autopilot = SimulatedAutopilot::knowing(&[]);
    autopilot.loss = 1.0;
    let mut scene = Scene::new(Autopilot::Px4, autopilot, &[Channel::Gnss]);
    scene.run(12);
    let times: Vec<_> = scene
        .requests
        .iter()
        .filter(|(_, r)| matches!(r, Request::MessageInterval { message_id: 24, .. }))
        .map(|(ms, _)| *ms)
        .collect();
    assert_eq!(times.len(), 3);
    assert!(times[1] - times[0] >= ANSWER_MS && times[2] - times[1] >= 2 * ANSWER_MS);
    scene.run(20);
    assert!(scene.notices.iter().any(|n| matches!(n, Notice::Unmet { cause: Cause::Unanswered, .. })));
}

#[test]
fn silence_and_parameter_transfers_stop_all_asking() {
    let mut autopilot = SimulatedAutopilot::knowing(&[24, 245]);
    autopilot.streams.clear();
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &[Channel::Gnss]);
    scene.run(30);
    assert_eq!(scene.requests, [], "nobody is there");
    scene.autopilot.streams.extend([(0, 1.0), (22, 20.0)]);
    scene.run(30);
    assert_eq!(scene.requests, [], "parameters first");
    scene.autopilot.streams.remove(&22);
    scene.run(10);
    assert_eq!(scene.asked_for(), [24, 245]);
}

#[test]
fn the_rate_meter_measures() {
    for hz in [1_u64, 5, 10, 50, 250] {
        let mut meter = RateMeter::new(40);
        for k in 0..20 * hz {
            meter.count(40 + k * 1_000 / hz);
        }
        let measured = meter.hz(20_040);
        assert!((measured - hz as f64).abs() <= 0.21 * (hz as f64).max(1.0), "{hz} Hz measured as {measured}");
        assert_eq!(meter.hz(40_000), 0.0, "and forgets");
    }
}
