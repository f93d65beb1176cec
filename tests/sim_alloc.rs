//! After its first second, a simulated vehicle allocates nothing: not for physics, sensors, autopilot or messages.

mod counting;

use counting::allocations;
use mavobserver::sim::scenario;
use mavobserver::sim::{Run, RunOptions};

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
        let before = allocations();
        fly(&mut run, 40.0);
        assert_eq!(allocations() - before, 0, "{name}");
        assert!(frames > 5_000);
    }
}
