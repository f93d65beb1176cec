//! The rules of [`super`], held against a second, naive reading of them, and networks of several routers.

use super::*;
use crate::wire::dialect::ardupilotmega::{COMMAND_LONG_DATA, HEARTBEAT_DATA};
use crate::wire::{self, Encoder, Event, FrameBuf};
use proptest::prelude::*;
use std::collections::BTreeSet;

fn end(link: usize, peer: u32) -> Origin {
    Origin { link: LinkId(link), peer: Some(PeerId(peer)) }
}

fn heartbeat(system: u8, component: u8) -> FrameBuf {
    Encoder::new(system, component).encode(&HEARTBEAT_DATA::DEFAULT)
}

fn command(source: (u8, u8), target: (u8, u8)) -> FrameBuf {
    let (target_system, target_component) = target;
    let command = COMMAND_LONG_DATA { target_system, target_component, ..COMMAND_LONG_DATA::DEFAULT };
    Encoder::new(source.0, source.1).encode(&command)
}

fn with_groups(groups: &[Option<&str>], window_us: u64) -> Routes {
    let rules = groups.iter().map(|g| Rules { group: g.map(str::to_owned), ..Rules::default() });
    Routes::new(rules.collect(), window_us)
}

/// What happened on a network: who was heard where and when.
#[derive(Debug, Clone, Copy)]
struct Heard {
    source: (u8, u8),
    at: Origin,
    time_us: u64,
}

/// The rules, read literally, for a frame that was just heard (it is the last of `history`).
fn prescribed(
    ends: &[Origin],
    groups: &[Option<&str>],
    history: &[Heard],
    target: Option<(u8, u8)>,
) -> BTreeSet<Origin> {
    let now = history[history.len() - 1];
    let group = |e: Origin| groups[e.link.0];
    let kin = |a: Origin, b: Origin| a == b || (group(a).is_some() && group(a) == group(b));
    let heard_at =
        |matches: &dyn Fn((u8, u8)) -> bool, e: Origin| history.iter().any(|h| matches(h.source) && kin(h.at, e));
    ends.iter()
        .copied()
        .filter(|&e| match target {
            None | Some((0, _)) => true,
            Some((system, component)) => {
                let exact = component != 0 && history.iter().any(|h| h.source == (system, component));
                if exact { heard_at(&|s| s == (system, component), e) } else { heard_at(&|s| s.0 == system, e) }
            }
        })
        .filter(|&e| {
            let back = |h: &Heard| h.source == now.source && kin(h.at, e) && now.time_us - h.time_us <= ECHO_US;
            !history.iter().any(back)
        })
        .collect()
}

/// A topology: ends of each link, and its group.
fn topology() -> impl Strategy<Value = Vec<(u32, Option<&'static str>)>> {
    let group = prop_oneof![3 => Just(None), 1 => Just(Some("a")), 1 => Just(Some("b"))];
    prop::collection::vec((1u32..=3, group), 1..=5)
}

/// A frame: source, where it comes in (to be reduced to an existing end), its target, the pause before it.
type Traffic = ((u8, u8), (usize, u32), Option<(u8, u8)>, u64);

fn traffic() -> impl Strategy<Value = Vec<Traffic>> {
    let id = || (1u8..5, 1u8..4);
    let target = prop_oneof![1 => Just(None), 3 => prop::option::of((0u8..6, 0u8..4))];
    let pause = prop_oneof![4 => 0u64..1_000_000, 1 => 9_000_000u64..12_000_000];
    prop::collection::vec((id(), (0usize..5, 0u32..3), target, pause), 1..60)
}

proptest! {
    #[test]
    fn every_frame_reaches_exactly_the_prescribed_ends_once(links in topology(), frames in traffic()) {
        let groups: Vec<_> = links.iter().map(|&(_, group)| group).collect();
        let mut routes = with_groups(&groups, 0);
        let mut ends = Vec::new();
        for (link, &(peers, _)) in links.iter().enumerate() {
            ends.extend((0..peers).map(|peer| end(link, peer)));
        }
        ends.iter().rev().for_each(|&e| routes.open(e));
        let (mut history, mut now_us, mut to) = (Vec::new(), 50_000_000, Vec::new());
        for (source, (link, peer), target, pause) in frames {
            now_us += pause;
            let link = link % links.len();
            let at = end(link, peer % links[link].0);
            let frame = match target {
                None => heartbeat(source.0, source.1),
                Some(target) => command(source, target),
            };
            history.push(Heard { source, at, time_us: now_us });
            // without a window for duplicates nothing is one
            prop_assert_eq!(routes.route(frame.as_ref(), at, now_us, &mut to), Fate::Passed);
            let reached: BTreeSet<_> = to.iter().copied().collect();
            prop_assert_eq!(reached.len(), to.len(), "an end was given twice: {:?}", to);
            prop_assert_eq!(reached, prescribed(&ends, &groups, &history, target));
        }
    }

    /// Routers in any connected network, with any number of ways around: every station hears every frame exactly
    /// once, and the network comes to rest.
    #[test]
    fn no_way_around_doubles_a_frame_or_keeps_it_going(
        routers in 1usize..5,
        extra in prop::collection::vec((0usize..5, 0usize..5), 0..6),
        senders in prop::collection::vec(0usize..5, 1..12),
    ) {
        // a line, and more edges at will; one station at each router's link 0
        let mut edges: Vec<_> = (1..routers).map(|i| (i - 1, i)).collect();
        edges.extend(extra.iter().map(|&(a, b)| (a % routers, b % routers)).filter(|(a, b)| a != b));
        let mut far: Vec<Vec<(usize, usize)>> = vec![vec![(usize::MAX, 0)]; routers];
        for (a, b) in edges {
            let (at_a, at_b) = (far[a].len(), far[b].len());
            far[a].push((b, at_b));
            far[b].push((a, at_a));
        }
        let whole = |link: usize| Origin { link: LinkId(link), peer: None };
        let mut network: Vec<_> = far.iter().map(|links| {
            let mut routes = Routes::new(vec![Rules::default(); links.len()], 500_000);
            (0..links.len()).for_each(|link| routes.open(whole(link)));
            routes
        }).collect();
        let mut encoders: Vec<_> = (0..routers).map(|i| Encoder::new(i as u8 + 1, 1)).collect();
        for (k, sender) in senders.iter().enumerate() {
            let sender = sender % routers;
            let frame = encoders[sender].encode(&HEARTBEAT_DATA::DEFAULT);
            let mut heard = vec![0; routers];
            let mut on_the_way = vec![(sender, 0usize)];
            let (mut steps, mut to) = (0, Vec::new());
            while let Some((router, link)) = on_the_way.pop() {
                steps += 1;
                prop_assert!(steps < 1_000, "it goes round and round");
                network[router].route(frame.as_ref(), whole(link), 1_000_000 * k as u64, &mut to);
                for e in &to {
                    match far[router][e.link.0] {
                        (usize::MAX, _) => heard[router] += 1,
                        next => on_the_way.push(next),
                    }
                }
            }
            let expected: Vec<_> = (0..routers).map(|i| i32::from(i != sender)).collect();
            prop_assert_eq!(heard, expected);
        }
    }
}

#[test]
fn a_target_is_learnt_and_forgotten_with_its_end() {
    let mut routes = with_groups(&[None, None, None], 0);
    let (vehicle, other, station) = (end(0, 0), end(1, 0), end(2, 0));
    [vehicle, other, station].into_iter().for_each(|e| routes.open(e));
    let mut to = Vec::new();
    routes.route(command((255, 190), (1, 1)).as_ref(), station, 0, &mut to);
    assert_eq!(to, [], "nobody has heard of it");
    routes.route(heartbeat(1, 1).as_ref(), vehicle, 1, &mut to);
    assert_eq!(to, [other, station]);
    for (component, reached) in [(1, vec![vehicle]), (0, vec![vehicle]), (154, vec![vehicle])] {
        routes.route(command((255, 190), (1, component)).as_ref(), station, 2, &mut to);
        assert_eq!(to, reached, "component {component}");
    }
    routes.route(heartbeat(1, 154).as_ref(), other, 3, &mut to);
    routes.route(command((255, 190), (1, 154)).as_ref(), station, 4, &mut to);
    assert_eq!(to, [other], "the component lives elsewhere");
    routes.close(vehicle);
    routes.route(command((255, 190), (1, 1)).as_ref(), station, 5, &mut to);
    assert_eq!(to, [other], "the system is known there, its autopilot nowhere");
    routes.close(other);
    routes.route(command((255, 190), (1, 1)).as_ref(), station, 6, &mut to);
    assert_eq!(to, []);
}

#[test]
fn what_is_for_us_goes_nowhere_and_our_own_frames_do_not_come_round() {
    let mut routes = with_groups(&[None, None], 500_000);
    let (vehicle, station) = (end(0, 0), end(1, 0));
    [vehicle, station].into_iter().for_each(|e| routes.open(e));
    let mut to = Vec::new();
    routes.route(heartbeat(1, 1).as_ref(), vehicle, 0, &mut to);
    let own = heartbeat(1, 191);
    routes.sent(own.as_ref(), 1);
    routes.route(command((255, 190), (1, 191)).as_ref(), station, 2, &mut to);
    assert_eq!(to, []);
    assert_eq!(routes.route(own.as_ref(), station, 3, &mut to), Fate::Duplicate);
}

#[test]
fn two_senders_with_the_same_ids_are_told_from_two_ways_to_one() {
    let mut routes = with_groups(&[None, None], 500_000);
    let (radio, mobile) = (end(0, 0), end(1, 0));
    [radio, mobile].into_iter().for_each(|e| routes.open(e));
    let (mut vehicle, mut to) = (Encoder::new(1, 1), Vec::new());
    let mut fate = |encoder: &mut Encoder, at, now_us| {
        routes.route(encoder.encode(&HEARTBEAT_DATA::DEFAULT).as_ref(), at, now_us, &mut to)
    };
    assert_eq!(fate(&mut vehicle, radio, 0), Fate::Passed);
    assert_eq!(fate(&mut vehicle, mobile, 10), Fate::Twin, "nothing shows yet that it is the same");
    let mut again = Encoder::new(1, 1);
    assert_eq!(fate(&mut again, mobile, 20), Fate::Duplicate);
    assert_eq!(fate(&mut vehicle, mobile, 30), Fate::Passed, "two ways to one vehicle");
    assert_eq!(fate(&mut vehicle, radio, 40), Fate::Passed);

    let (mut one, mut other) = (Encoder::new(2, 1), Encoder::new(2, 1));
    other.sequence = 100;
    for k in 0..20 {
        assert_eq!(fate(&mut one, radio, 1_000 * k), Fate::Passed);
        assert_eq!(fate(&mut other, mobile, 1_000 * k), Fate::Twin);
    }
    assert_eq!(fate(&mut other, mobile, 19_000 + TWIN_US + 1), Fate::Passed, "the first is gone");
}

#[test]
fn two_ports_of_one_vehicle_are_no_twins_where_a_group_says_so() {
    let mut routes = with_groups(&[Some("vehicle"), Some("vehicle"), None], 50_000);
    let (first, second) = (end(0, 0), end(1, 0));
    [first, second].into_iter().for_each(|e| routes.open(e));
    let (mut one, mut other, mut to) = (Encoder::new(1, 1), Encoder::new(1, 1), Vec::new());
    other.sequence = 7;
    let (mut passed, mut duplicates) = (0, 0);
    for k in 0..2_000 {
        let mut fate = |encoder: &mut Encoder, at| {
            routes.route(encoder.encode(&HEARTBEAT_DATA::DEFAULT).as_ref(), at, 100_000 * k, &mut to)
        };
        // one port is busier: its numbers overtake the other's, and now and then the same frame comes twice
        for _ in 0..5 {
            assert_eq!(fate(&mut one, first), Fate::Passed);
        }
        match fate(&mut other, second) {
            Fate::SecondWay => {}
            Fate::Duplicate => duplicates += 1,
            _ => passed += 1,
        }
    }
    assert!(duplicates > 0 && passed == 0, "{duplicates} duplicates, {passed} passed");
}

#[test]
fn filters_and_limits_hold_for_their_direction() {
    let block = |messages: Vec<u32>| {
        Filter::new(Selection::default(), Selection::new(messages, Ids::default(), Ids::default()))
    };
    let deaf = Rules { inward: block(vec![0]), ..Rules::default() };
    let mute = Rules { outward: block(vec![0]), ..Rules::default() };
    let slow = Rules { limits: Limits::new([(0, 1.0)]), ..Rules::default() };
    let mut routes = Routes::new(vec![deaf, mute.clone(), slow], 0);
    let (first, second, third) = (end(0, 0), end(1, 0), end(2, 0));
    [first, second, third, end(2, 1)].into_iter().for_each(|e| routes.open(e));
    let mut to = Vec::new();
    assert_eq!(routes.route(heartbeat(1, 1).as_ref(), first, 0, &mut to), Fate::Blocked);
    assert_eq!(routes.route(heartbeat(2, 1).as_ref(), second, 0, &mut to), Fate::Passed);
    assert_eq!(to, [first, third, end(2, 1)], "its limit counts once for all ends of the link");
    routes.route(heartbeat(2, 1).as_ref(), second, 500_000, &mut to);
    assert_eq!(to, [first]);
    assert_eq!(routes.held_back(LinkId(2)), (0, 1));
    routes.set_rules(LinkId(0), mute);
    assert_eq!(routes.route(heartbeat(1, 1).as_ref(), first, 2_000_000, &mut to), Fate::Passed);
    assert_eq!(to, [third, end(2, 1)]);
    assert_eq!(routes.held_back(LinkId(1)), (1, 0));
}

#[test]
fn unknown_and_signed_messages_go_to_everyone() {
    let unknown = [0xFD, 4, 0, 0, 9, 1, 1, 0x39, 0x30, 0x00, 1, 2, 3, 4, 0xAA, 0xBB];
    let Some(Event::Frame(frame)) = wire::datagram(&unknown).next() else { panic!("a frame") };
    let mut routes = with_groups(&[None, None], 0);
    [end(0, 0), end(1, 0)].into_iter().for_each(|e| routes.open(e));
    let mut to = Vec::new();
    routes.route(frame, end(0, 0), 0, &mut to);
    assert_eq!(to, [end(1, 0)]);
}
