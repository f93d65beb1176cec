use super::*;
use crate::signal::Channel;
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
    /// Messages a second that the link carries.
    carries_hz: f64,
    /// Tells 0, not −1, of what it does not send.
    px4: bool,
    /// Answers no question for intervals.
    tells_nothing: bool,
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
            carries_hz: f64::INFINITY,
            px4: false,
            tells_nothing: false,
            loss: 0.0,
            rng: ChaCha8Rng::seed_from_u64(7),
        }
    }

    /// Obeys and answers, as far as the link lets it.
    fn obey(&mut self, request: Request) -> Option<Answer> {
        if self.rng.random_bool(self.loss) {
            return None;
        }
        match request {
            Request::TellInterval { message_id } => {
                let interval_us = match self.streams.get(&message_id) {
                    Some(hz) => (1e6 / hz) as i32,
                    None if self.knows.contains(&message_id) && !self.px4 => -1,
                    None => 0,
                };
                let lost = self.rng.random_bool(self.loss);
                (!self.tells_nothing && !lost).then_some(Answer::Interval(message_id, interval_us))
            }
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
                (!self.rng.random_bool(self.loss)).then_some(Answer::Ack(if known { 0 } else { 3 }))
            }
        }
    }

    /// The part of what it sends that comes through.
    fn share(&self) -> f64 {
        (self.carries_hz / self.streams.values().sum::<f64>()).min(1.0)
    }
}

enum Answer {
    /// MAV_RESULT of a SET_MESSAGE_INTERVAL.
    Ack(u8),
    /// MESSAGE_INTERVAL.
    Interval(u32, i32),
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
    fn new(kind: Autopilot, mut autopilot: SimulatedAutopilot, channels: &[Channel]) -> Self {
        autopilot.px4 = kind == Autopilot::Px4;
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
            let share = self.autopilot.share();
            for (&message, &hz) in &self.autopilot.streams {
                let due = |ms: u64| (ms as f64 * hz * share / 1e3) as u64;
                if due(self.now_ms) > due(self.now_ms - STEP_MS) {
                    self.requester.heard(message, self.now_ms);
                }
            }
            let request = self.requester.poll(self.now_ms, &mut |n| self.notices.push(n));
            if let Some(request) = request {
                self.requests.push((self.now_ms, request));
                match self.autopilot.obey(request) {
                    Some(Answer::Ack(result)) => {
                        self.requester.command_ack(SET_MESSAGE_INTERVAL, result, self.now_ms + STEP_MS);
                    }
                    Some(Answer::Interval(message, interval_us)) => {
                        self.requester.interval_told(message, interval_us);
                    }
                    None => {}
                }
            }
        }
    }

    /// The messages that were asked for, without the questions for their intervals.
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
    let first = [
        Request::TellInterval { message_id: 105 },
        Request::MessageInterval { message_id: 105, interval_us: 20_000.0 },
    ];
    assert_eq!([scene.requests[0].1, scene.requests[1].1], first);
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
    assert_eq!(scene.asked_for(), [27, 31, 245, 30]);
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
    let before = scene.asked_for().len();
    scene.autopilot.streams.remove(&105);
    scene.run(30);
    assert_eq!(scene.asked_for()[before..], [105], "one stream was stopped");

    let before = scene.asked_for().len();
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
            Notice::Met { .. } | Notice::Slowed { .. } => panic!("nothing was met, and the link is not full"),
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

#[test]
fn ardupilot_is_not_asked_for_what_it_does_not_have() {
    // it would say so on its console
    let mut scene = Scene::new(Autopilot::ArduPilot, SimulatedAutopilot::knowing(&[27, 31, 32, 36, 245]), &NEEDED);
    scene.run(60);
    assert_eq!(scene.asked_for(), [27, 31, 32, 36, 245]);
    let told = scene.requests.iter().filter(|(_, r)| *r == Request::TellInterval { message_id: 105 }).count();
    assert_eq!(told, 1);
}

#[test]
fn everything_is_given_back_as_it_was() {
    for (kind, off) in [(Autopilot::ArduPilot, -1.0), (Autopilot::Px4, -1.0)] {
        let mut autopilot = SimulatedAutopilot::knowing(&[31, 105, 245]);
        autopilot.streams.extend([(105, 4.0), (245, 0.25)]);
        let mut scene = Scene::new(kind, autopilot, &[Channel::Imu, Channel::Attitude]);
        assert_eq!(scene.requester.restore().count(), 0);
        scene.run(30);
        let mut restored: Vec<_> = scene.requester.restore().collect();
        restored.sort_by_key(|r| if let Request::MessageInterval { message_id, .. } = r { *message_id } else { 0 });
        let back = |message_id, interval_us| Request::MessageInterval { message_id, interval_us };
        assert_eq!(restored, [back(31, off), back(105, 250_000.0), back(245, 4_000_000.0)]);
        scene.requester.rebooted(scene.now_ms);
        assert_eq!(scene.requester.restore().count(), 0, "it has forgotten");
    }
}

#[test]
fn what_is_not_told_is_given_back_by_what_was_seen() {
    let mut autopilot = SimulatedAutopilot::knowing(&[31, 105]);
    autopilot.streams.insert(105, 4.0);
    autopilot.tells_nothing = true;
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &[Channel::Imu, Channel::Attitude]);
    scene.run(30);
    let back = |message_id, interval_us| Request::MessageInterval { message_id, interval_us };
    let restored: Vec<_> = scene.requester.restore().collect();
    assert!(restored.contains(&back(105, 0.0)) && restored.contains(&back(31, -1.0)), "{restored:?}");
}

#[test]
fn groups_are_given_back_too() {
    let mut autopilot = SimulatedAutopilot::knowing(&[]);
    autopilot.groups = BTreeMap::from([(1, vec![27, 29]), (10, vec![30])]);
    autopilot.streams.insert(27, 4.0);
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &[Channel::Imu, Channel::Attitude]);
    scene.run(60);
    let restored: Vec<_> = scene.requester.restore().collect();
    let back = |stream_id, rate_hz| Request::DataStream { stream_id, rate_hz };
    assert_eq!(restored, [back(1, 4), back(10, 0)]);
}

#[test]
fn a_full_link_is_asked_for_what_it_carries() {
    let mut autopilot = SimulatedAutopilot::knowing(&[31, 32, 36, 105, 245]);
    autopilot.carries_hz = 80.0;
    let mut scene = Scene::new(Autopilot::ArduPilot, autopilot, &NEEDED);
    scene.run(50);
    let sent: f64 = [31, 32, 36, 105].iter().map(|id| scene.autopilot.streams[id]).sum();
    assert!((60.0..=80.0).contains(&sent), "{:?}", scene.autopilot.streams);
    assert!(matches!(scene.notices[..], [Notice::Slowed { wanted_hz: 50.0, .. }]), "{:?}", scene.notices);
    let asked = scene.requests.len();
    assert!(asked < 20, "{asked}");

    scene.autopilot.carries_hz = f64::INFINITY;
    scene.run(900);
    assert_eq!(scene.autopilot.streams[&105], 50.0, "all of it once there is room");
    assert!(scene.requests.len() < asked + 30);
}
