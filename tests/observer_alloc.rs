//! After its first steps, a vehicle's chain from frame to snapshot allocates nothing.

#![allow(unsafe_code)] // an allocator cannot be written without

mod hover;

use mavobserver::pipeline::{Event, Fleet, FleetSettings};
use mavobserver::vehicle;
use mavobserver::wire::FrameBuf;
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Arc;
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
fn a_flying_vehicle_does_not_allocate() {
    let model = Arc::new(vehicle::resolve("arducopter-sitl").expect("a preset"));
    let mut fleet = Fleet::new(FleetSettings::standard(model)).expect("designs");
    let frames: Vec<(u64, FrameBuf)> = hover::frames(400);
    let mut snapshots = 0_u64;
    let mut run = |part: &[(u64, FrameBuf)]| {
        for (received, frame) in part {
            fleet.frame(frame.as_ref(), *received, &mut |event| {
                if let Event::Snapshot(s, _) = event {
                    snapshots += u64::from(s.wind.is_some());
                }
            });
        }
    };
    let (first, rest) = frames.split_at(frames.len() / 2);
    run(first);
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    run(rest);
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(after - before, 0);
    assert!(snapshots > 300, "only {snapshots} snapshots with wind");
}
