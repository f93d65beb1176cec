//! Framing against arbitrary chunking, garbage, damage and unknown messages.

use mavobserver::wire::dialect::{ardupilotmega, mavobserver as ours};
use mavobserver::wire::{BadReason, Check, Encoder, Event, FrameBuf, MAX_FRAME_LEN, Parser, datagram};
use proptest::prelude::*;
use std::ops::Range;

/// What an event was, without borrowing.
#[derive(Debug, Clone, PartialEq)]
enum Seen {
    Frame(Vec<u8>, Check),
    Bad(Vec<u8>, BadReason),
}

fn seen(event: Event<'_>) -> Seen {
    match event {
        Event::Frame(frame) => Seen::Frame(frame.bytes().to_vec(), frame.check()),
        Event::Bad(bad) => Seen::Bad(bad.bytes.to_vec(), bad.reason),
    }
}

/// All events of a stream that arrives in chunks of `size` bytes and then ends.
fn parse_in_chunks(bytes: &[u8], size: usize) -> Vec<Seen> {
    let mut parser = Parser::new();
    let mut out = Vec::new();
    for chunk in bytes.chunks(size) {
        parser.push(chunk);
        while let Some(event) = parser.next() {
            out.push(seen(event));
        }
    }
    parser.finish();
    while let Some(event) = parser.next() {
        out.push(seen(event));
    }
    out
}

fn parse(bytes: &[u8]) -> Vec<Seen> {
    parse_in_chunks(bytes, bytes.len().max(1))
}

fn frames(seen: &[Seen]) -> Vec<Vec<u8>> {
    seen.iter().filter_map(|s| if let Seen::Frame(bytes, _) = s { Some(bytes.clone()) } else { None }).collect()
}

fn covered(seen: &[Seen]) -> Vec<u8> {
    seen.iter()
        .flat_map(|s| match s {
            Seen::Frame(bytes, _) | Seen::Bad(bytes, _) => bytes.clone(),
        })
        .collect()
}

/// Where the verified frames lie in the input.
fn verified_ranges(seen: &[Seen]) -> Vec<Range<usize>> {
    let mut at = 0;
    let mut out = Vec::new();
    for event in seen {
        let (Seen::Frame(bytes, _) | Seen::Bad(bytes, _)) = event;
        if matches!(event, Seen::Frame(_, Check::Verified)) {
            out.push(at..at + bytes.len());
        }
        at += bytes.len();
    }
    out
}

/// Whether a frame that was sent here came out. Nearly always it did itself; one candidate in 65536 has a right checksum
/// by chance, and such a frame in the damage may overlap the real one: no parser could tell which is which.
fn came_out(sent: &Range<usize>, verified: &[Range<usize>]) -> bool {
    verified.iter().any(|v| v.start < sent.end && sent.start < v.end)
}

/// A signed frame: the checksum covers the header with its flag, so it is recomputed; the signature is arbitrary.
fn signed(frame: &FrameBuf, signature: [u8; 13]) -> Vec<u8> {
    let mut bytes = frame.bytes().to_vec();
    let end = bytes.len() - 2;
    bytes[2] = 1;
    let extra = mavobserver::wire::message_info(frame.as_ref().message_id()).unwrap().crc_extra;
    let crc = mavlink_core::calculate_crc(&bytes[1..end], extra);
    bytes[end..].copy_from_slice(&crc.to_le_bytes());
    bytes.extend_from_slice(&signature);
    bytes
}

/// A MAVLink 2 frame of a message that nobody defines.
fn unknown(payload: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0xFD, payload.len() as u8, 0, 0, 9, 1, 1, 0x34, 0x12, 0x77];
    bytes.extend_from_slice(payload);
    bytes.extend_from_slice(&[0xAB, 0xCD]);
    bytes
}

/// A varied traffic of good frames: both versions, signed, empty-ended payloads, the longest one.
fn traffic() -> Vec<Vec<u8>> {
    let mut encoder = Encoder::new(1, 1);
    let attitude = ardupilotmega::ATTITUDE_DATA { time_boot_ms: 0xFDFE_FDFE, roll: 0.1, ..Default::default() };
    let text = ardupilotmega::STATUSTEXT_DATA { text: "a text".into(), ..Default::default() };
    let longest = ardupilotmega::LOGGING_DATA_DATA { data: [0xFE; 249], ..Default::default() };
    let bounds = ours::STATE_BOUNDS_DATA { lower: [-1.0; 12], upper: [1.0; 12], count: 12, ..Default::default() };
    let heartbeat = ardupilotmega::HEARTBEAT_DATA::default();
    let mut out = vec![
        encoder.encode(&heartbeat).bytes().to_vec(),
        encoder.encode_v1(&heartbeat).unwrap().bytes().to_vec(),
        encoder.encode(&attitude).bytes().to_vec(),
        encoder.encode_v1(&attitude).unwrap().bytes().to_vec(),
        encoder.encode(&bounds).bytes().to_vec(),
        encoder.encode(&longest).bytes().to_vec(),
        encoder.encode(&text).bytes().to_vec(),
    ];
    out.push(signed(&encoder.encode(&longest), [0xFD; 13]));
    out.push(signed(&encoder.encode(&attitude), [7; 13]));
    out
}

#[test]
fn every_chunk_size_gives_the_same_events() {
    let mut bytes = b"\xFDboot noise\xFE".to_vec();
    for (i, frame) in traffic().iter().enumerate() {
        bytes.extend_from_slice(frame);
        match i % 3 {
            0 => bytes.extend_from_slice(&unknown(&[0xFE, 0xFD, 3])),
            1 => bytes.extend_from_slice(&[0xFE, 0x20, 0xFD]),
            _ => {}
        }
    }
    // a damaged frame near the end
    let mut damaged = traffic()[2].clone();
    damaged[12] ^= 4;
    bytes.extend_from_slice(&damaged);
    bytes.extend_from_slice(&traffic()[0][..9]);

    let whole = parse(&bytes);
    assert_eq!(covered(&whole), bytes, "events cover the input exactly once");
    for frame in traffic() {
        assert!(frames(&whole).contains(&frame));
    }
    for size in 1..=bytes.len() {
        assert_eq!(parse_in_chunks(&bytes, size), whole, "chunks of {size}");
    }
}

#[test]
fn frames_know_their_parts() {
    let mut encoder = Encoder::new(42, 7);
    encoder.sequence = 99;
    let command = ardupilotmega::COMMAND_LONG_DATA { target_system: 3, target_component: 4, ..Default::default() };
    let plain = encoder.encode(&command);
    let bytes = signed(&plain, [5; 13]);
    let mut events = datagram(&bytes);
    let Some(Event::Frame(frame)) = events.next() else { panic!("a frame") };
    assert_eq!((frame.system_id(), frame.component_id(), frame.sequence()), (42, 7, 99));
    assert_eq!(frame.message_id(), 76);
    assert_eq!(frame.message_name(), Some("COMMAND_LONG"));
    assert_eq!(frame.target(), Some((3, 4)));
    assert_eq!(frame.signature(), Some(&[5; 13][..]));
    assert_eq!(frame.payload(), plain.as_ref().payload());
    assert_eq!(plain.as_ref().signature(), None);
    assert_eq!(FrameBuf::from(frame).bytes(), bytes);
    assert_eq!(events.next(), None);
    assert_eq!(MAX_FRAME_LEN, 280);
}

#[test]
fn one_damaged_frame_is_one_bad_frame() {
    let frames = traffic();
    let mut damaged = frames[5].clone(); // full of magic bytes: 249 candidates in one frame
    damaged[100] ^= 1;
    let bytes = [&frames[0][..], &damaged, &damaged, &frames[1]].concat();
    let events = parse(&bytes);
    assert_eq!(events.len(), 4, "{events:?}");
    for event in &events[1..3] {
        let Seen::Bad(bytes, BadReason::Checksum { message_id: 266, received, computed }) = event else {
            panic!("{event:?}")
        };
        assert_eq!(bytes, &damaged);
        assert_ne!(received, computed);
    }
}

#[test]
fn unknown_messages_are_kept_whole() {
    let frames = traffic();
    let strange = unknown(b"\x01\x02\xFE\xFD");
    let bytes = [&frames[0][..], &strange, &strange, &frames[1]].concat();
    let kept = Seen::Frame(strange.clone(), Check::UnknownMessage);
    let good = |i: usize| Seen::Frame(frames[i].clone(), Check::Verified);
    assert_eq!(parse(&bytes), [good(0), kept.clone(), kept.clone(), good(1)]);
    // also at the end of a datagram, and alone in one
    assert_eq!(datagram(&strange).map(seen).collect::<Vec<_>>(), [kept]);
}

#[test]
fn an_unknown_message_never_swallows_a_verified_one() {
    let frames = traffic();
    // ten bytes of the unknown message went missing, so by its header it reaches into the next frame
    let whole = unknown(&[0x11; 40]);
    let cut = [&whole[..20], &whole[30..]].concat();
    let bytes = [&frames[0][..], &cut, &frames[2], &frames[0]].concat();
    let events = parse(&bytes);
    assert_eq!(events[1], Seen::Bad(cut, BadReason::UnconfirmedUnknown { message_id: 0x77_1234 }));
    assert_eq!(self::frames(&events), [frames[0].clone(), frames[2].clone(), frames[0].clone()]);
}

#[test]
fn a_frame_does_not_continue_in_the_next_datagram() {
    let frame = &traffic()[2];
    let (head, tail) = frame.split_at(15);
    let head: Vec<_> = datagram(head).map(seen).collect();
    assert_eq!(head, [Seen::Bad(frame[..15].to_vec(), BadReason::Truncated { expected: frame.len() })]);
    assert!(datagram(tail).all(|event| matches!(event, Event::Bad(_))));
    assert_eq!(datagram(&[]).next(), None);
}

#[test]
fn foreign_incompatibility_flags_are_refused() {
    let mut frame = traffic()[2].clone();
    frame[2] = 0x02;
    let events: Vec<_> = datagram(&frame).collect();
    assert!(matches!(
        events[..],
        [Event::Bad(bad)] if bad.reason == BadReason::UnsupportedFlags { flags: 2 } && bad.bytes == frame
    ));
}

#[test]
fn endless_garbage_comes_out_in_pieces() {
    let mut parser = Parser::new();
    parser.push(&[0x55; 1000]);
    let mut given_up = 0;
    while let Some(Event::Bad(bad)) = parser.next() {
        assert_eq!(bad.bytes.len(), MAX_FRAME_LEN);
        given_up += bad.bytes.len();
    }
    assert_eq!(given_up, 3 * MAX_FRAME_LEN);
}

/// Bytes that like to look like frames.
fn garbage() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop_oneof![3 => any::<u8>(), 1 => Just(0xFE), 1 => Just(0xFD), 1 => 0u8..12];
    prop::collection::vec(byte, 0..60)
}

proptest! {
    #[test]
    fn garbage_between_frames_costs_no_frame(
        pieces in prop::collection::vec((garbage(), 0usize..9, any::<bool>()), 1..12),
        size in 1usize..400,
    ) {
        let traffic = traffic();
        let mut bytes = Vec::new();
        let mut sent = Vec::new();
        for (noise, which, strange) in pieces {
            bytes.extend_from_slice(&noise);
            if strange {
                bytes.extend_from_slice(&unknown(&noise));
            }
            sent.push(bytes.len()..bytes.len() + traffic[which].len());
            bytes.extend_from_slice(&traffic[which]);
        }
        let events = parse_in_chunks(&bytes, size);
        prop_assert_eq!(&covered(&events), &bytes);
        prop_assert_eq!(&events, &parse(&bytes));
        let verified = verified_ranges(&events);
        for frame in sent {
            prop_assert!(came_out(&frame, &verified), "frame at {:?} is lost", frame);
        }
    }

    /// One flipped bit damages one frame; its neighbours survive. (A flip in a length byte can make the damaged frame
    /// wait for more data, never lose any.)
    #[test]
    fn a_flipped_bit_costs_one_frame(which in 0usize..9, position in any::<prop::sample::Index>(), bit in 0u8..8) {
        let traffic = traffic();
        let mut damaged = traffic[which].clone();
        // the signature is not covered by the checksum
        let checked = damaged.len() - if damaged[0] == 0xFD && damaged[2] == 1 { 13 } else { 0 };
        damaged[position.index(checked)] ^= 1 << bit;
        let bytes = [&traffic[0][..], &damaged, &traffic[2], &traffic[4]].concat();
        let events = parse(&bytes);
        prop_assert_eq!(&covered(&events), &bytes);
        let verified = verified_ranges(&events);
        let after = traffic[0].len() + damaged.len();
        let whole = 0..traffic[0].len();
        prop_assert_eq!(&verified[0], &whole);
        prop_assert!(came_out(&(after..after + traffic[2].len()), &verified));
        prop_assert!(came_out(&(after + traffic[2].len()..bytes.len()), &verified));
        // a damaged message id may turn it into an unknown message, which nothing can check
        prop_assert!(!events.contains(&Seen::Frame(damaged, Check::Verified)));
    }

    #[test]
    fn a_truncated_stream_gives_the_frames_before_the_cut(cut in any::<prop::sample::Index>()) {
        let bytes = traffic().concat();
        let cut = cut.index(bytes.len() + 1);
        let mut end = 0;
        let whole: Vec<_> = traffic().into_iter().take_while(|f| { end += f.len(); end <= cut }).collect();
        let events = parse(&bytes[..cut]);
        prop_assert_eq!(frames(&events), whole);
        prop_assert_eq!(covered(&events), &bytes[..cut]);
    }

    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000), size in 1usize..300) {
        let events = parse_in_chunks(&bytes, size);
        prop_assert_eq!(covered(&events), bytes.clone());
        for event in datagram(&bytes) {
            if let Event::Frame(frame) = event {
                let _ = (frame.target(), frame.signature(), frame.fields().u64(0), format!("{frame:?}"));
            }
        }
    }
}
