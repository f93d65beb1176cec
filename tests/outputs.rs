//! What leaves for a vehicle, decoded again: fields, rates, numbering, and that nothing is allocated for it.

mod live_support;

use live_support::{Echo, attitude, hover_step};
use mavlink_core::MessageData;
use mavobserver::daemon::steady_ns;
use mavobserver::outputs::{LinkOutputs, OutputSettings, Rate, SCALARS};
use mavobserver::pipeline::{Event, FaultDetail, FaultMask, Fleet, FleetSettings, Severity, VehicleId};
use mavobserver::signal::{Guarantee, Stamp, Verdict};
use mavobserver::wire::dialect::ardupilotmega::{
    DEBUG_FLOAT_ARRAY_DATA, DEBUG_VECT_DATA, HEARTBEAT_DATA, MavAutopilot, MavSeverity, MavState, MavType,
    NAMED_VALUE_FLOAT_DATA, NAMED_VALUE_INT_DATA, STATUSTEXT_DATA, WIND_COV_DATA, WIND_DATA,
};
use mavobserver::wire::dialect::mavobserver::{
    FAULT_STATUS_DATA, MavobserverFault, MavobserverFaultLevel, MavobserverGuarantee, MavobserverVerdict,
    OBSERVER_STATUS_DATA, STATE_BOUNDS_DATA, WIND_ESTIMATE_DATA, WRENCH_ESTIMATE_DATA,
};
use mavobserver::wire::{Encoder, FrameBuf, decode};
use nalgebra::Vector3;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Arc;

const VEHICLE: VehicleId = VehicleId { system: 4, component: 1 };
const START_US: u64 = 1_700_000_000_000_000;

/// Counts the allocations of each thread.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes to the system's allocator unchanged.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: as the caller's
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as the caller's
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Ten seconds of snapshots at 50 Hz through these settings.
fn ten_seconds(settings: OutputSettings) -> Vec<FrameBuf> {
    let mut outputs = LinkOutputs::new(settings);
    let mut sent = Vec::new();
    for k in 0..500 {
        let now = START_US + 20_000 * u64::from(k);
        outputs.heard(VEHICLE, now, &mut |frame| sent.push(frame.into()));
        outputs.snapshot(&Echo::snapshot(VEHICLE, &attitude(k), now), &mut |frame| sent.push(frame.into()));
    }
    sent
}

fn all<M: MessageData>(frames: &[FrameBuf]) -> Vec<M> {
    frames.iter().filter_map(|f| decode(f.as_ref())).collect()
}

fn floats(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

#[test]
fn every_message_keeps_its_rate_and_its_number() {
    let sent = ten_seconds(OutputSettings::default());
    for (k, frame) in sent.iter().enumerate() {
        let frame = frame.as_ref();
        assert_eq!((frame.system_id(), frame.component_id()), (4, 191));
        assert_eq!(usize::from(frame.sequence()), k % 256);
    }
    let counts = [
        ("HEARTBEAT", all::<HEARTBEAT_DATA>(&sent).len(), 10),
        ("DEBUG_VECT", all::<DEBUG_VECT_DATA>(&sent).len(), 200),
        ("DEBUG_FLOAT_ARRAY", all::<DEBUG_FLOAT_ARRAY_DATA>(&sent).len(), 50),
        ("NAMED_VALUE_FLOAT", all::<NAMED_VALUE_FLOAT_DATA>(&sent).len(), 100),
        ("WIND_COV", all::<WIND_COV_DATA>(&sent).len(), 0),
        ("WRENCH_ESTIMATE", all::<WRENCH_ESTIMATE_DATA>(&sent).len(), 100),
        ("WIND_ESTIMATE", all::<WIND_ESTIMATE_DATA>(&sent).len(), 100),
        ("FAULT_STATUS", all::<FAULT_STATUS_DATA>(&sent).len(), 10),
    ];
    for (name, count, expected) in counts {
        assert!(count.abs_diff(expected) <= expected / 50 + usize::from(expected > 0), "{name}: {count}");
    }
}

#[test]
fn the_heartbeat_is_that_of_an_onboard_controller() {
    let heartbeat = all::<HEARTBEAT_DATA>(&ten_seconds(OutputSettings::default())).remove(0);
    assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
    assert_eq!(heartbeat.autopilot, MavAutopilot::MAV_AUTOPILOT_INVALID);
    assert_eq!(heartbeat.system_status, MavState::MAV_STATE_ACTIVE);
}

#[test]
fn vectors_and_arrays_hold_the_estimate_at_its_place() {
    let mut settings = OutputSettings::default();
    settings.rates.debug_vect = Rate::EVERY;
    settings.rates.wrench_array = Rate::EVERY;
    settings.rates.wind_cov = Rate::EVERY;
    settings.rates.wind = Rate::EVERY;
    let sent = ten_seconds(settings);
    let truth: BTreeMap<u64, _> = (0..500)
        .map(|k| (u64::from(attitude(k).time_boot_ms) * 1_000, Echo::snapshot(VEHICLE, &attitude(k), 0)))
        .collect();

    let vectors = all::<DEBUG_VECT_DATA>(&sent);
    assert_eq!(vectors.len(), 1_000);
    for vector in vectors {
        let wrench = truth[&vector.time_usec].wrench.expect("always");
        let expected = match vector.name.to_str().expect("ASCII") {
            "WR_F" => wrench.force_ned_n,
            "WR_T" => wrench.torque_frd_nm,
            name => panic!("{name}"),
        };
        assert_eq!([vector.x, vector.y, vector.z], floats(expected));
    }
    for array in all::<DEBUG_FLOAT_ARRAY_DATA>(&sent) {
        assert_eq!((array.array_id, array.name.to_str()), (1, Ok("WRENCH")));
        let snapshot = &truth[&array.time_usec];
        let (wrench, wind) = (snapshot.wrench.expect("always"), snapshot.wind.expect("always"));
        assert_eq!(array.data[0..3], floats(wrench.force_ned_n));
        assert_eq!(array.data[3..6], floats(wrench.torque_frd_nm));
        for (sent, meant) in array.data[6..9].iter().zip(wrench.force_half_width_n.iter()) {
            let excess = f64::from(*sent) - meant;
            assert!((0.0..1e-5).contains(&excess), "half-widths are rounded up: {sent} for {meant}");
        }
        assert!(array.data[9..12].iter().all(|x| x.is_nan()), "no claim is NaN");
        assert_eq!(array.data[12..15], floats(wind.velocity_ned_mps));
        assert!(array.data[15..18].iter().all(|&x| (1.5..1.500_01).contains(&x)));
        assert_eq!(array.data[18..20], [1.0, 5.0], "guaranteed; fault bits 0 and 2");
        assert!(array.data[20..].iter().all(|&x| x == 0.0));
    }
    let winds = all::<WIND_DATA>(&sent);
    assert_eq!(winds.len(), 500);
    for (wind, snapshot) in winds.iter().zip(truth.values()) {
        let velocity = snapshot.wind.expect("always").velocity_ned_mps;
        let from = (-velocity.y).atan2(-velocity.x).to_degrees().rem_euclid(360.0);
        assert!((f64::from(wind.direction) - from).abs() < 1e-4, "from, not towards");
        assert_eq!([wind.speed, wind.speed_z], [velocity.xy().norm() as f32, velocity.z as f32]);
    }
    let winds = all::<WIND_COV_DATA>(&sent);
    assert_eq!(winds.len(), 500);
    for wind in winds {
        let truth = truth[&wind.time_usec].wind.expect("always");
        assert_eq!([wind.wind_x, wind.wind_y, wind.wind_z], floats(truth.velocity_ned_mps), "towards");
        assert_eq!(wind.horiz_accuracy, (1.5 / 3_f64.sqrt()) as f32);
        assert!(wind.var_horiz.is_nan() && wind.wind_alt.is_nan());
    }
}

#[test]
fn scalars_take_turns() {
    let named = all::<NAMED_VALUE_FLOAT_DATA>(&ten_seconds(OutputSettings::default()));
    for (k, value) in named.iter().enumerate() {
        assert_eq!(value.name.to_str(), Ok(SCALARS[k % SCALARS.len()].name));
    }
    let last = named.iter().rfind(|n| n.name.to_str() == Ok("WindSpd")).expect("sent");
    let k = (last.time_boot_ms - 1_000) / 20;
    let wind = Echo::snapshot(VEHICLE, &attitude(k), 0).wind.expect("always");
    assert_eq!(last.value, wind.velocity_ned_mps.xy().norm() as f32);
}

#[test]
fn our_own_messages_hold_everything() {
    let sent = ten_seconds(OutputSettings::default());
    let wrench = all::<WRENCH_ESTIMATE_DATA>(&sent).remove(3);
    assert_eq!(wrench.guarantee, MavobserverGuarantee::MAVOBSERVER_GUARANTEE_GUARANTEED);
    assert_eq!(wrench.verdict, MavobserverVerdict::MAVOBSERVER_VERDICT_CONSISTENT);
    assert_eq!((wrench.level, wrench.torque_half_width), (1.0, [f32::INFINITY; 3]));
    let fault = all::<FAULT_STATUS_DATA>(&sent).remove(0);
    let rotors = MavobserverFault::MAVOBSERVER_FAULT_ROTOR_1 | MavobserverFault::MAVOBSERVER_FAULT_ROTOR_3;
    assert_eq!((fault.active, fault.onset_boot_us, fault.magnitude), (rotors, 1_000_000, 0.25));
    let mask = all::<NAMED_VALUE_INT_DATA>(&sent).remove(0);
    assert_eq!((mask.value, mask.name.to_str()), (0b101, Ok("Faults")));
}

#[test]
fn a_fault_is_told_at_once_and_its_end_too() {
    let mut outputs = LinkOutputs::new(OutputSettings::default());
    let mut told = Vec::new();
    for k in 0..100 {
        let now = START_US + 20_000 * u64::from(k);
        let mut snapshot = Echo::snapshot(VEHICLE, &attitude(k), now);
        let (fault, onset) = (FaultMask(1 << 12), Stamp::from_millis(i64::from(attitude(33).time_boot_ms) - 300));
        let newest = FaultDetail { mask: fault, onset, magnitude: 0.05, guarantee: Guarantee::Guaranteed };
        let lasts = (33..61).contains(&k);
        snapshot.faults = if lasts { fault } else { FaultMask(0) };
        snapshot.newest_fault = lasts.then_some(newest);
        outputs.snapshot(&snapshot, &mut |frame| {
            if let Some(fault) = decode::<FAULT_STATUS_DATA>(frame) {
                told.push((k, fault.active, fault.level, fault.onset_boot_us));
            }
        });
    }
    let none = (MavobserverFault::empty(), MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_NONE, 0);
    let gyro = MavobserverFault::MAVOBSERVER_FAULT_GYRO;
    // when it began, not when it was told
    let onset = u64::from(attitude(33).time_boot_ms) * 1_000 - 300_000;
    let gyro = (gyro, MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_ISOLATED, onset);
    let changes: Vec<_> = [0, 33, 61].map(|k| told.iter().find(|t| t.0 == k).map(|t| (t.1, t.2, t.3))).into();
    assert_eq!(changes, [Some(none), Some(gyro), Some(none)]);
}

#[test]
fn long_texts_come_in_chunks_under_one_id() {
    let mut outputs = LinkOutputs::new(OutputSettings::default());
    let mut sent = Vec::new();
    let long = "quadratic_bounded is starved of actuators (ACTUATOR_OUTPUT_STATUS or SERVO_OUTPUT_RAW)";
    outputs.text(VEHICLE, Severity::Warning, "short", &mut |frame| sent.push(frame.into()));
    outputs.text(VEHICLE, Severity::Warning, long, &mut |frame| sent.push(frame.into()));
    let texts = all::<STATUSTEXT_DATA>(&sent);
    assert_eq!(texts.iter().map(|t| t.chunk_seq).collect::<Vec<_>>(), [0, 0, 1]);
    assert_eq!(texts[0].id, 0);
    assert!(texts[1].id != 0 && texts[1].id == texts[2].id);
    let joined: String = texts[1..].iter().map(|t| t.text.to_str().expect("ASCII")).collect();
    assert_eq!(joined, long);
    assert!(texts.iter().all(|t| t.severity == MavSeverity::MAV_SEVERITY_WARNING));

    let mut silent = LinkOutputs::new(OutputSettings { status_text: false, ..OutputSettings::default() });
    silent.text(VEHICLE, Severity::Warning, long, &mut |_| panic!("switched off"));
}

/// Real observers, so that there are signals to bound.
fn hovering_fleet() -> Fleet {
    let vehicle = Arc::new(mavobserver::vehicle::resolve("arducopter-sitl").expect("a preset"));
    Fleet::new(FleetSettings::standard(vehicle)).expect("a design").timed(steady_ns)
}

#[test]
fn bounds_of_every_signal_leave_and_contain_the_estimate() {
    let mut fleet = hovering_fleet();
    let mut settings = OutputSettings::default();
    settings.rates.state_bounds = Rate::EVERY;
    settings.rates.bound_arrays = Rate::EVERY;
    let mut outputs = LinkOutputs::new(settings);
    let mut encoder = Encoder::new(4, 1);
    let (mut statuses, mut bounded) = (Vec::new(), 0);
    for k in 0..500 {
        for frame in hover_step(&mut encoder, k) {
            let now = START_US + 20_000 * u64::from(k);
            fleet.frame(frame.as_ref(), now, &mut |event| {
                let Event::Snapshot(snapshot, _) = event else { return };
                let mut sent = Vec::new();
                outputs.snapshot(snapshot, &mut |frame| sent.push(frame.into()));
                statuses.extend(all::<OBSERVER_STATUS_DATA>(&sent));
                let parts = all::<STATE_BOUNDS_DATA>(&sent);
                let mut arrays = all::<DEBUG_FLOAT_ARRAY_DATA>(&sent);
                arrays.retain(|a| a.array_id != 1);
                assert_eq!(arrays.iter().map(|a| a.array_id).collect::<Vec<_>>(), [2, 3]);
                let mut at = 0;
                for report in snapshot.observers.iter() {
                    for (i, (value, width)) in
                        report.estimate.values.iter().zip(&report.estimate.half_widths).enumerate()
                    {
                        let part = parts
                            .iter()
                            .find(|p| p.observer_id == report.id && usize::from(p.first) == i / 12 * 12)
                            .expect("every signal is sent");
                        let (lower, upper) = (part.lower[i % 12], part.upper[i % 12]);
                        assert!(i % 12 < usize::from(part.count));
                        assert!(f64::from(lower) <= value - width && value + width <= f64::from(upper));
                        if at >= arrays[0].data.len() {
                            // the arrays have no room for more; STATE_BOUNDS has
                            continue;
                        }
                        if width.is_finite() {
                            assert!(f64::from(upper - lower) <= 2.0 * width * (1.0 + 1e-5) + 1e-5);
                            assert_eq!((arrays[0].data[at], arrays[1].data[at]), (lower, upper));
                            bounded += 1;
                        } else {
                            assert!(arrays[0].data[at].is_nan() && arrays[1].data[at].is_nan());
                        }
                        at += 1;
                    }
                }
            });
        }
    }
    assert!(bounded > 1_000, "the observer settles in hover: {bounded}");
    let last = statuses.iter().rfind(|s| s.name.to_str() == Ok("quadratic_bounded")).expect("sent");
    assert!(last.step_ns > 0 && last.missing == 0, "timed, and starved of nothing");
    assert!((last.rate - 50.0).abs() < 1.0, "{} steps/s", last.rate);
}

#[test]
fn nothing_is_allocated_for_a_snapshot() {
    let mut fleet = hovering_fleet();
    let mut settings = OutputSettings::default();
    settings.rates.wind_cov = Rate::EVERY;
    settings.rates.state_bounds = Rate::EVERY;
    settings.rates.observer_status = Rate::EVERY;
    let mut outputs = LinkOutputs::new(settings);
    let mut encoder = Encoder::new(4, 1);
    let (mut allocated, mut frames, mut verdicts) = (0, 0_u64, Vec::new());
    for k in 0..300 {
        for frame in hover_step(&mut encoder, k) {
            let now = START_US + 20_000 * u64::from(k);
            fleet.frame(frame.as_ref(), now, &mut |event| {
                let Event::Snapshot(snapshot, _) = event else { return };
                let before = ALLOCATIONS.with(Cell::get);
                outputs.heard(VEHICLE, now, &mut |_| frames += 1);
                outputs.snapshot(snapshot, &mut |_| frames += 1);
                let during = ALLOCATIONS.with(Cell::get) - before;
                // the first snapshot makes room for the vehicle
                allocated += if verdicts.is_empty() { 0 } else { during };
                verdicts.push(snapshot.verdict);
                if let Some(wrench) = snapshot.wrench {
                    assert!(wrench.guarantee != Guarantee::None);
                }
            });
        }
    }
    assert!(verdicts.contains(&Verdict::Consistent) && frames > 1_000, "{frames} frames");
    assert_eq!(allocated, 0);
}
