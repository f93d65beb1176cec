//! After its first steps, a vehicle's chain from frame to snapshot allocates nothing.

mod counting;
mod hover;

use counting::allocations;
use mavobserver::pipeline::{Event, Fleet, FleetSettings};
use mavobserver::vehicle;
use mavobserver::wire::FrameBuf;
use std::sync::Arc;

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
    let before = allocations();
    run(rest);
    let after = allocations();
    assert_eq!(after - before, 0);
    assert!(snapshots > 300, "only {snapshots} snapshots with wind");
}
