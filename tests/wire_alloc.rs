//! After its first frames, a link allocates nothing: not for framing, statistics, typed access or encoding.

mod counting;

use counting::allocations;
use mavobserver::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};
use mavobserver::wire::stats::LinkStats;
use mavobserver::wire::{Encoder, Event, FrameBuf, Parser, datagram, decode};

#[test]
fn a_running_link_does_not_allocate() {
    let mut encoder = Encoder::new(1, 1);
    let mut parser = Parser::new();
    let mut stats = LinkStats::new();
    let mut kept: Option<FrameBuf> = None;
    let mut rolls = 0.0;
    let mut run = |rounds: u32| {
        for i in 0..rounds {
            let attitude = ATTITUDE_DATA { time_boot_ms: i, roll: 0.5, ..Default::default() };
            let frame = encoder.encode(&attitude);
            parser.push(b"some noise");
            parser.push(frame.bytes());
            parser.push(encoder.encode(&HEARTBEAT_DATA::default()).bytes());
            while let Some(event) = parser.next() {
                stats.event(u64::from(i) * 20_000, &event);
                if let Event::Frame(frame) = event {
                    rolls += decode::<ATTITUDE_DATA>(frame).map_or(0.0, |attitude| attitude.roll);
                    kept = Some(frame.into());
                }
            }
            for event in datagram(frame.bytes()) {
                stats.event(u64::from(i) * 20_000, &event);
            }
        }
    };
    run(10);
    let before = allocations();
    run(10_000);
    let allocated = allocations() - before;
    assert_eq!(allocated, 0);
    assert_eq!(rolls, 0.5 * 10_010.0);
    assert!(kept.is_some());
}
