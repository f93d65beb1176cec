//! After its first second, a simulated vehicle allocates nothing: not for physics, sensors, autopilot or messages.

use mavobserver::sim::scenario;
use mavobserver::sim::{Run, RunOptions};
use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system allocator unchanged.
#[allow(unsafe_code)]
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
fn a_flight_does_not_allocate() {
    for name in ["turbulence", "px4-wind", "sensor-faults"] {
        let mut run = Run::new(&scenario::resolve(name).unwrap(), &RunOptions::default()).unwrap();
        let mut frames = 0_u32;
        let mut fly = |run: &mut Run, until_s: f64| {
            while run.now_s() < until_s {
                run.advance(&mut |_| frames += 1);
            }
        };
        fly(&mut run, 1.0);
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        fly(&mut run, 40.0);
        assert_eq!(ALLOCATIONS.load(Ordering::Relaxed) - before, 0, "{name}");
        assert!(frames > 5_000);
    }
}
