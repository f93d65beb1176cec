use nalgebra::Vector3;
use world_magnetic_model::GeomagneticField;
use world_magnetic_model::time::Date;
use world_magnetic_model::uom::si::angle::degree;
use world_magnetic_model::uom::si::f32::{Angle, Length};
use world_magnetic_model::uom::si::length::meter;
use world_magnetic_model::uom::si::magnetic_flux_density::gauss;

/// Days from the civil epoch of Julian days to 1970-01-01.
const UNIX_EPOCH_JULIAN_DAY: i32 = 2_440_588;
/// The date taken where a vehicle tells none: the middle of the model's years. The declination moves by about 0.1° a
/// year.
const UNKNOWN_DATE_UNIX_S: f64 = 1.814_4e9;

/// The Earth's magnetic field by the World Magnetic Model, NED, gauss. `None` outside the model's years and heights.
pub fn earth_field_ned_gauss(
    latitude_deg: f64,
    longitude_deg: f64,
    altitude_m: f64,
    unix_s: Option<f64>,
) -> Option<Vector3<f64>> {
    let days = unix_s.unwrap_or(UNKNOWN_DATE_UNIX_S) / 86_400.0;
    // saturates far outside the range that the next line accepts
    let date = Date::from_julian_day((days.floor() as i32).saturating_add(UNIX_EPOCH_JULIAN_DAY)).ok()?;
    let height = Length::new::<meter>(altitude_m as f32);
    let (latitude, longitude) = (Angle::new::<degree>(latitude_deg as f32), Angle::new::<degree>(longitude_deg as f32));
    let field = GeomagneticField::new(height, latitude, longitude, date).ok()?;
    let [x, y, z] = [field.x(), field.y(), field.z()].map(|b| f64::from(b.get::<gauss>()));
    Some(Vector3::new(x, y, z))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_places() {
        // Zurich and Canberra
        let zurich = earth_field_ned_gauss(47.3977, 8.5456, 488.0, None).unwrap();
        assert!((zurich.y.atan2(zurich.x).to_degrees() - 3.4).abs() < 0.6, "{zurich}");
        assert!((zurich.norm() - 0.485).abs() < 0.01, "{zurich}");
        let canberra = earth_field_ned_gauss(-35.3632, 149.1652, 584.0, Some(1.795e9)).unwrap();
        assert!((canberra.y.atan2(canberra.x).to_degrees() - 12.8).abs() < 0.6 && canberra.z < -0.5, "{canberra}");
        assert_eq!(earth_field_ned_gauss(0.0, 0.0, 0.0, Some(1e300)), None);
        assert_eq!(earth_field_ned_gauss(95.0, 0.0, 0.0, None), None);
    }
}
