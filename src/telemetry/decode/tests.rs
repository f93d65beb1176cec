use super::*;
use crate::signal::{FixType, MagSource};
use crate::wire::Encoder;
use mavlink::MessageData;

/// All samples of a message, received at once.
fn samples<M: MessageData>(decoder: &mut Decoder, message: &M) -> Vec<SampleKind> {
    let frame = Encoder::new(1, 1).encode(message);
    let mut out = Vec::new();
    decoder.frame(frame.as_ref(), 1_700_000_000_000_000, &mut |d| {
        if let Decoded::Sample(s) = d {
            out.push(s.kind);
        }
    });
    out
}

fn highres(time_usec: u64, xmag: f32, updated: u16) -> mav::HIGHRES_IMU_DATA {
    let fields_updated = mav::HighresImuUpdatedFlags::from_bits_retain(updated);
    mav::HIGHRES_IMU_DATA { time_usec, xmag, zacc: -9.8, abs_pressure: 950.0, fields_updated, ..Default::default() }
}

fn fields(kinds: &[SampleKind]) -> Vec<(f64, MagSource)> {
    let field = |k: &SampleKind| if let SampleKind::Mag(m) = k { Some((m.field_frd_gauss.x, m.source)) } else { None };
    kinds.iter().filter_map(field).collect()
}

#[test]
fn the_field_of_highres_imu_is_brought_to_gauss() {
    for sent in [0.25, 250.0, 250_000.0] {
        let got = fields(&samples(&mut Decoder::default(), &highres(1_000_000, sent, 0xFFFF)));
        assert!((got[0].0 - 0.25).abs() < 1e-6 && got.len() == 1, "{sent}: {got:?}");
    }
}

#[test]
fn a_repeated_field_is_no_new_sample() {
    let mut d = Decoder::default();
    // accelerometer and gyro only: the rest of the message is what it was
    const INERTIAL: u16 = 0x3F;
    assert_eq!(fields(&samples(&mut d, &highres(1_000_000, 0.25, INERTIAL))).len(), 1);
    assert_eq!(fields(&samples(&mut d, &highres(1_004_000, 0.25, INERTIAL))).len(), 0);
    assert_eq!(fields(&samples(&mut d, &highres(1_008_000, 0.26, INERTIAL))).len(), 1);
    assert_eq!(fields(&samples(&mut d, &highres(1_012_000, 0.26, INERTIAL | 0x1C0))).len(), 1);
}

#[test]
fn one_magnetometer_through_two_messages_is_used_once() {
    let mut d = Decoder::default();
    let raw = mav::RAW_IMU_DATA { time_usec: 1_000_000, xmag: 250, ..Default::default() };
    assert_eq!(fields(&samples(&mut d, &raw)), [(0.25, MagSource::Scaled)]);
    assert_eq!(fields(&samples(&mut d, &highres(1_001_000, 250_500.0, 0xFFFF))).len(), 1);
    assert_eq!(fields(&samples(&mut d, &mav::RAW_IMU_DATA { time_usec: 1_020_000, ..raw })), []);
}

#[test]
fn a_raw_fix_with_what_it_knows() {
    let message = mav::GPS_RAW_INT_DATA {
        time_usec: 5_000_000,
        fix_type: mav::GpsFixType::GPS_FIX_TYPE_3D_FIX,
        lat: 473_977_420,
        lon: 85_455_940,
        alt: 488_000,
        eph: 121,
        epv: u16::MAX,
        vel: 500,
        cog: 9000,
        satellites_visible: 12,
        h_acc: 900,
        ..Default::default()
    };
    let [SampleKind::Gnss(fix)] = samples(&mut Decoder::default(), &message)[..] else { panic!("one sample") };
    assert_eq!((fix.fix_type, fix.satellites), (FixType::ThreeD, Some(12)));
    let [n, e] = fix.ground_velocity_mps.unwrap();
    assert!(n.abs() < 1e-12 && (e - 5.0).abs() < 1e-12 && fix.velocity_ned_mps().is_none());
    assert_eq!((fix.hdop, fix.vdop, fix.horizontal_accuracy_m), (Some(1.21), None, Some(0.9)));
    let none = mav::GPS_RAW_INT_DATA { fix_type: mav::GpsFixType::GPS_FIX_TYPE_NO_FIX, ..message };
    assert!(samples(&mut Decoder::default(), &none).is_empty());
}
