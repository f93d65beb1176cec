use super::read::{number, number_or, span, vector_at};
use crate::document::{Limit, Table};
use crate::sim::dynamics::{MassProperties, Payload};
use crate::sim::faults::{Fault, FaultKind, LinkTrouble};
use crate::vehicle::Vehicle;
use nalgebra::{Matrix3, Vector3};

#[derive(Clone, Copy)]
enum Kind {
    RotorWeak,
    RotorLost,
    RotorDamaged,
    RotorStuck,
    Payload,
    AccelBias,
    AccelNoise,
    AccelFrozen,
    GyroBias,
    GyroNoise,
    GyroFrozen,
    MagBias,
    MagNoise,
    MagFrozen,
    BaroBias,
    BaroNoise,
    BaroFrozen,
    GnssStep,
    GnssRamp,
    GnssLost,
    Link,
}

const KINDS: [(&str, Kind); 21] = [
    ("rotor_weak", Kind::RotorWeak),
    ("rotor_lost", Kind::RotorLost),
    ("rotor_damaged", Kind::RotorDamaged),
    ("rotor_stuck", Kind::RotorStuck),
    ("payload", Kind::Payload),
    ("accel_bias", Kind::AccelBias),
    ("accel_noise", Kind::AccelNoise),
    ("accel_frozen", Kind::AccelFrozen),
    ("gyro_bias", Kind::GyroBias),
    ("gyro_noise", Kind::GyroNoise),
    ("gyro_frozen", Kind::GyroFrozen),
    ("mag_bias", Kind::MagBias),
    ("mag_noise", Kind::MagNoise),
    ("mag_frozen", Kind::MagFrozen),
    ("baro_bias", Kind::BaroBias),
    ("baro_noise", Kind::BaroNoise),
    ("baro_frozen", Kind::BaroFrozen),
    ("gnss_step", Kind::GnssStep),
    ("gnss_ramp", Kind::GnssRamp),
    ("gnss_lost", Kind::GnssLost),
    ("link", Kind::Link),
];

/// One `[[fault]]`; rotors and inertial sensors count from 1 in the file.
pub(super) fn fault(t: &mut Table<'_>, vehicle: Option<&Vehicle>) -> Option<Fault> {
    let kind = t.require("kind").and_then(|v| v.one_of(&KINDS));
    let span = span(t);
    let kind = kind_of(kind?, t, vehicle);
    let ((from_s, until_s), kind) = (span?, kind?);
    Some(Fault { kind, from_s, until_s })
}

fn kind_of(kind: Kind, t: &mut Table<'_>, vehicle: Option<&Vehicle>) -> Option<FaultKind> {
    Some(match kind {
        Kind::RotorWeak => {
            let (rotor, share) = (rotor(t, vehicle), number(t, "share", Limit::Within(0.0, 1.0)));
            FaultKind::RotorWeak { rotor: rotor?, share: share? }
        }
        Kind::RotorLost => FaultKind::RotorWeak { rotor: rotor(t, vehicle)?, share: 0.0 },
        Kind::RotorDamaged => {
            let (rotor, share) = (rotor(t, vehicle), number(t, "share", Limit::Within(0.0, 1.0)));
            FaultKind::RotorDamaged { rotor: rotor?, share: share? }
        }
        Kind::RotorStuck => {
            let (rotor, command) = (rotor(t, vehicle), number(t, "command", Limit::Within(0.0, 1.0)));
            FaultKind::RotorStuck { rotor: rotor?, command: command? }
        }
        Kind::Payload => FaultKind::PayloadAttached(payload(t, vehicle)?),
        Kind::AccelBias => {
            let (imu, bias) = (imu(t), vector_at(t, "bias_mps2"));
            FaultKind::AccelBias { imu: imu?, bias_mps2: bias? }
        }
        Kind::AccelNoise => {
            let (imu, sigma) = (imu(t), number(t, "sigma_mps2", Limit::Positive));
            FaultKind::AccelNoise { imu: imu?, sigma_mps2: sigma? }
        }
        Kind::AccelFrozen => FaultKind::AccelFrozen { imu: imu(t)? },
        Kind::GyroBias => {
            let (imu, bias) = (imu(t), vector_at(t, "bias_rads"));
            FaultKind::GyroBias { imu: imu?, bias_rads: bias? }
        }
        Kind::GyroNoise => {
            let (imu, sigma) = (imu(t), number(t, "sigma_rads", Limit::Positive));
            FaultKind::GyroNoise { imu: imu?, sigma_rads: sigma? }
        }
        Kind::GyroFrozen => FaultKind::GyroFrozen { imu: imu(t)? },
        Kind::MagBias => FaultKind::MagBias { bias_gauss: vector_at(t, "bias_gauss")? },
        Kind::MagNoise => FaultKind::MagNoise { sigma_gauss: number(t, "sigma_gauss", Limit::Positive)? },
        Kind::MagFrozen => FaultKind::MagFrozen,
        Kind::BaroBias => FaultKind::BaroBias { bias_pa: number(t, "bias_pa", Limit::Any)? },
        Kind::BaroNoise => FaultKind::BaroNoise { sigma_pa: number(t, "sigma_pa", Limit::Positive)? },
        Kind::BaroFrozen => FaultKind::BaroFrozen,
        Kind::GnssStep => FaultKind::GnssStep { shift_ned_m: vector_at(t, "shift_ned_m")? },
        Kind::GnssRamp => FaultKind::GnssRamp { speed_ned_mps: vector_at(t, "speed_ned_mps")? },
        Kind::GnssLost => FaultKind::GnssLost,
        Kind::Link => FaultKind::Link(link(t)?),
    })
}

fn rotor(t: &mut Table<'_>, vehicle: Option<&Vehicle>) -> Option<usize> {
    let last = vehicle.map_or(crate::signal::MAX_ROTORS, |v| v.rotors.len());
    let n = t.require("rotor")?.integer(1..=i64::try_from(last).ok()?)?;
    usize::try_from(n - 1).ok()
}

fn imu(t: &mut Table<'_>) -> Option<usize> {
    let n = t.get("imu").map_or(Some(1), |v| v.integer(1..=2))?;
    usize::try_from(n - 1).ok()
}

fn payload(t: &mut Table<'_>, vehicle: Option<&Vehicle>) -> Option<Payload> {
    let mass = number(t, "mass_kg", Limit::Positive);
    let position = t.get("position_frd_m").map_or(Some(Vector3::zeros()), |v| super::read::vector(&v));
    let moments = t.get("inertia_kgm2").map_or(Some(Vector3::zeros()), |v| super::read::vector(&v));
    let load = Payload { mass_kg: mass?, position_frd_m: position?, inertia_kgm2: Matrix3::from_diagonal(&moments?) };
    let body = vehicle.and_then(|v| MassProperties::empty(v.mass_kg.nominal, v.inertia_kgm2));
    if body.is_some_and(|b| b.with(&load).is_none()) {
        t.problem("with this payload the vehicle is no rigid body", "give `inertia_kgm2` three positive numbers");
        return None;
    }
    Some(load)
}

/// What a `[link]` section or a link fault says.
pub(super) fn link(t: &mut Table<'_>) -> Option<LinkTrouble> {
    let share = Limit::Within(0.0, 1.0);
    let loss = number_or(t, "loss", share, 0.0);
    let duplicate = number_or(t, "duplicate", share, 0.0);
    let corrupt = number_or(t, "corrupt", share, 0.0);
    let reorder = number_or(t, "reorder", share, 0.0);
    let delay = number_or(t, "delay_s", Limit::Within(0.0, 60.0), 0.0);
    let jitter = number_or(t, "jitter_s", Limit::Within(0.0, 60.0), 0.0);
    Some(LinkTrouble {
        loss: loss?,
        duplicate: duplicate?,
        corrupt: corrupt?,
        delay_s: delay?,
        jitter_s: jitter?,
        reorder: reorder?,
    })
}
