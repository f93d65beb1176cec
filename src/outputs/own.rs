//! The messages of `dialects/mavobserver.xml`.

use super::common::boot_us;
use super::rounding::{down, half_widths, up};
use super::text::char_array;
use crate::pipeline::{ObserverReport, Snapshot, WindEstimate, WrenchEstimate};
use crate::signal::{Guarantee, Stamp, Verdict};
use crate::wire::dialect::mavobserver::{
    FAULT_STATUS_DATA, MavobserverFault, MavobserverFaultLevel, MavobserverGuarantee, MavobserverVerdict,
    OBSERVER_STATUS_DATA, STATE_BOUNDS_DATA, WIND_ESTIMATE_DATA, WRENCH_ESTIMATE_DATA,
};
use nalgebra::Vector3;

/// Signals in one STATE_BOUNDS.
const SIGNALS: usize = 12;

fn guarantee(guarantee: Guarantee) -> (MavobserverGuarantee, f32) {
    match guarantee {
        Guarantee::None => (MavobserverGuarantee::MAVOBSERVER_GUARANTEE_NONE, 0.0),
        Guarantee::Statistical(level) => (MavobserverGuarantee::MAVOBSERVER_GUARANTEE_STATISTICAL, level as f32),
        Guarantee::Guaranteed => (MavobserverGuarantee::MAVOBSERVER_GUARANTEE_GUARANTEED, 1.0),
    }
}

fn verdict(verdict: Verdict) -> MavobserverVerdict {
    match verdict {
        Verdict::Consistent => MavobserverVerdict::MAVOBSERVER_VERDICT_CONSISTENT,
        Verdict::Settling => MavobserverVerdict::MAVOBSERVER_VERDICT_SETTLING,
        Verdict::AssumptionViolated => MavobserverVerdict::MAVOBSERVER_VERDICT_ASSUMPTION_VIOLATED,
        Verdict::Starved => MavobserverVerdict::MAVOBSERVER_VERDICT_STARVED,
        Verdict::Grounded => MavobserverVerdict::MAVOBSERVER_VERDICT_GROUNDED,
    }
}

/// The number that MAVOBSERVER_VERDICT gives a verdict.
pub(super) fn verdict_number(v: Verdict) -> u8 {
    verdict(v) as u8
}

fn floats(vector: &Vector3<f64>) -> [f32; 3] {
    [vector.x as f32, vector.y as f32, vector.z as f32]
}

pub(super) fn wrench_estimate(wrench: &WrenchEstimate, stamp: Stamp) -> WRENCH_ESTIMATE_DATA {
    let (guarantee, level) = guarantee(wrench.guarantee);
    WRENCH_ESTIMATE_DATA {
        time_boot_us: boot_us(stamp),
        force_ned: floats(&wrench.force_ned_n),
        force_half_width: half_widths(&wrench.force_ned_n, &wrench.force_half_width_n),
        torque_frd: floats(&wrench.torque_frd_nm),
        torque_half_width: half_widths(&wrench.torque_frd_nm, &wrench.torque_half_width_nm),
        level,
        guarantee,
        verdict: verdict(wrench.verdict),
    }
}

pub(super) fn wind_estimate(wind: &WindEstimate, stamp: Stamp) -> WIND_ESTIMATE_DATA {
    let (guarantee, level) = guarantee(wind.guarantee);
    WIND_ESTIMATE_DATA {
        time_boot_us: boot_us(stamp),
        wind_ned: floats(&wind.velocity_ned_mps),
        half_width: half_widths(&wind.velocity_ned_mps, &wind.half_width_mps),
        level,
        guarantee,
        verdict: verdict(wind.verdict),
    }
}

/// The intervals of one observer's signals, twelve in a message.
pub(super) fn state_bounds(report: &ObserverReport<'_>, stamp: Stamp, mut send: impl FnMut(STATE_BOUNDS_DATA)) {
    let estimate = report.estimate;
    let ends = estimate.values.chunks(SIGNALS).zip(estimate.half_widths.chunks(SIGNALS));
    for (part, (values, half_widths)) in ends.enumerate() {
        let Ok(first) = u8::try_from(part * SIGNALS) else { return };
        let mut message = STATE_BOUNDS_DATA {
            time_boot_us: boot_us(stamp),
            lower: [0.0; SIGNALS],
            upper: [0.0; SIGNALS],
            observer_id: report.id,
            first,
            // chunks of at most twelve
            count: values.len() as u8,
        };
        for (i, (value, half_width)) in values.iter().zip(half_widths).enumerate() {
            message.lower[i] = down(value - half_width);
            message.upper[i] = up(value + half_width);
        }
        send(message);
    }
}

pub(super) fn fault_status(snapshot: &Snapshot<'_>) -> FAULT_STATUS_DATA {
    let active = MavobserverFault::from_bits_truncate(snapshot.faults.0);
    let candidates = MavobserverFault::from_bits_truncate(snapshot.fault_candidates.0);
    FAULT_STATUS_DATA {
        time_boot_us: boot_us(snapshot.stamp),
        onset_boot_us: snapshot.newest_fault.map_or(0, |f| boot_us(f.onset)),
        active,
        candidates,
        magnitude: snapshot.newest_fault.map_or(f32::NAN, |f| f.magnitude as f32),
        level: match () {
            () if !candidates.is_empty() => MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_DETECTED,
            () if !active.is_empty() => MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_ISOLATED,
            () => MavobserverFaultLevel::MAVOBSERVER_FAULT_LEVEL_NONE,
        },
    }
}

/// Counts that OBSERVER_STATUS gives and a single snapshot cannot.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ObserverCounts {
    pub(super) violations: u32,
    pub(super) rate_hz: f64,
}

pub(super) fn observer_status(
    report: &ObserverReport<'_>,
    counts: ObserverCounts,
    stamp: Stamp,
) -> OBSERVER_STATUS_DATA {
    OBSERVER_STATUS_DATA {
        time_boot_us: boot_us(stamp),
        residual: report.estimate.residual as f32,
        rate: counts.rate_hz as f32,
        steps: u32::try_from(report.steps).unwrap_or(u32::MAX),
        step_ns: report.step_ns,
        violations: counts.violations,
        missing: report.missing,
        observer_id: report.id,
        verdict: verdict(report.estimate.verdict),
        name: char_array(report.name),
    }
}
