use super::*;
use crate::signal::MagSource;
use crate::vehicle::resolve;
use proptest::prelude::*;

fn aligner() -> Aligner {
    Aligner::new(Arc::new(resolve("px4-sih").unwrap()))
}

fn at(ms: i64, kind: SampleKind) -> Sample {
    Sample { stamp: Stamp::from_millis(ms), kind }
}

fn imu(source: ImuSource) -> SampleKind {
    SampleKind::Imu { source, accel_frd_mps2: Vector3::new(0.0, 0.0, -9.8), rate_frd_rads: Vector3::zeros() }
}

fn fix(latitude_deg: f64, fix_type: FixType) -> SampleKind {
    SampleKind::Gnss(GnssFix {
        fix_type,
        latitude_deg,
        longitude_deg: 8.0,
        altitude_m: 500.0,
        position_ned_m: None,
        ground_velocity_mps: Some([1.0, 0.0]),
        down_velocity_mps: None,
        hdop: None,
        vdop: None,
        horizontal_accuracy_m: None,
        vertical_accuracy_m: None,
        speed_accuracy_mps: None,
        satellites: None,
        unix_s: None,
    })
}

#[test]
fn a_fix_is_placed_from_the_first_and_new_once() {
    let mut a = aligner();
    a.push(at(5, fix(47.0, FixType::TwoD)));
    a.push(at(90, fix(47.0, FixType::ThreeD)));
    a.push(at(190, fix(47.0 + 1e-4, FixType::ThreeD)));
    let mut news = Vec::new();
    for ms in (0..400).step_by(20) {
        a.push(at(ms, imu(ImuSource::HighRes)));
        // the autopilot repeats the fix that it has
        a.push(at(190, fix(47.0 + 1e-4, FixType::ThreeD)));
        while let Some(m) = a.poll() {
            if let Some(g) = m.gnss.filter(|g| g.new) {
                assert!(m.stamp >= g.stamp && m.stamp - g.stamp < 0.02 + 1e-9);
                news.push((g.stamp, g.value.position_ned_m.map(|p| p.x.round())));
            }
        }
    }
    let ms = Stamp::from_millis;
    assert_eq!(news, [(ms(5), None), (ms(90), Some(0.0)), (ms(190), Some(11.0))]);
}

#[test]
fn further_sensors_are_kept_apart() {
    let mut a = aligner();
    for ms in (0..200).step_by(20) {
        a.push(at(ms, imu(ImuSource::Scaled)));
        if ms % 100 == 0 {
            a.push(at(ms, imu(ImuSource::Second)));
        }
    }
    let measurements: Vec<_> = std::iter::from_fn(|| a.poll()).collect();
    assert!(measurements.len() >= 8);
    assert_eq!(measurements.iter().filter(|m| m.other_imus[0].is_some_and(|i| i.new)).count(), 2);
    assert!(measurements.iter().all(|m| m.other_imus[1].is_none()));
}

proptest! {
    /// Whatever the order of arrival within a few samples, each magnetometer sample that is not overtaken by a newer one
    /// before the next measurement is new exactly once.
    #[test]
    fn no_slow_sample_is_new_twice(offsets in prop::collection::vec(0i64..60, 10)) {
        let mut a = aligner();
        let mut seen = Vec::new();
        for (k, offset) in offsets.iter().enumerate() {
            let ms = 100 * (k as i64 + 1);
            let field = MagField { field_frd_gauss: Vector3::new(ms as f64, 0.0, 0.0), source: MagSource::Scaled };
            a.push(at(ms + offset, SampleKind::Mag(field)));
            for step in 0..5 {
                a.push(at(ms + 20 * step, imu(ImuSource::Scaled)));
                seen.extend(std::iter::from_fn(|| a.poll()).filter_map(|m| m.magnetometer?.fresh()));
            }
        }
        let stamps: Vec<f64> = seen.iter().map(|m| m.field_frd_gauss.x).collect();
        prop_assert!(stamps.windows(2).all(|w| w[0] < w[1]));
        prop_assert!(stamps.len() >= 9);
    }
}
