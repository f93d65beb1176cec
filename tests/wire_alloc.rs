//! After its first frames, a link allocates nothing: not for framing, statistics, typed access or encoding.

#![allow(unsafe_code)] // an allocator cannot be written without

use mavobserver::wire::dialect::ardupilotmega::{ATTITUDE_DATA, HEARTBEAT_DATA};
use mavobserver::wire::stats::LinkStats;
use mavobserver::wire::{Encoder, Event, FrameBuf, Parser, datagram, decode};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

// The only test of this binary: another one on another thread would be counted too.
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
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    run(10_000);
    let allocated = ALLOCATIONS.load(Ordering::Relaxed) - before;
    assert_eq!(allocated, 0);
    assert_eq!(rolls, 0.5 * 10_010.0);
    assert!(kept.is_some());
}
