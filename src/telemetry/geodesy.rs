use nalgebra::{Matrix3, Vector3};

/// Semi-major axis (m) and first eccentricity squared of WGS 84.
const SEMI_MAJOR_M: f64 = 6_378_137.0;
const ECCENTRICITY2: f64 = 6.694_379_990_141_316e-3;

/// Origin of a local level frame on the WGS 84 ellipsoid.
///
/// Height above mean sea level may stand for height above the ellipsoid: over the reach of a multirotor the geoid is
/// parallel to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalOrigin {
    ecef_m: Vector3<f64>,
    /// Rows are north, east and down in Earth-centred coordinates.
    ecef_to_ned: Matrix3<f64>,
}

impl LocalOrigin {
    pub fn new(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Self {
        let (sp, cp) = latitude_deg.to_radians().sin_cos();
        let (sl, cl) = longitude_deg.to_radians().sin_cos();
        Self {
            ecef_m: ecef_m(latitude_deg, longitude_deg, altitude_m),
            ecef_to_ned: Matrix3::new(-sp * cl, -sp * sl, cp, -sl, cl, 0.0, -cp * cl, -cp * sl, -sp),
        }
    }

    /// North, east and down from the origin, m.
    pub fn ned_m(&self, latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Vector3<f64> {
        self.ecef_to_ned * (ecef_m(latitude_deg, longitude_deg, altitude_m) - self.ecef_m)
    }
}

fn ecef_m(latitude_deg: f64, longitude_deg: f64, altitude_m: f64) -> Vector3<f64> {
    let (sp, cp) = latitude_deg.to_radians().sin_cos();
    let (sl, cl) = longitude_deg.to_radians().sin_cos();
    let normal = SEMI_MAJOR_M / (1.0 - ECCENTRICITY2 * sp * sp).sqrt();
    let across = (normal + altitude_m) * cp;
    Vector3::new(across * cl, across * sl, (normal * (1.0 - ECCENTRICITY2) + altitude_m) * sp)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_step_each_way() {
        let o = LocalOrigin::new(47.397_742, 8.545_594, 488.0);
        assert!(o.ned_m(47.397_742, 8.545_594, 488.0).norm() < 1e-6);
        let up = o.ned_m(47.397_742, 8.545_594, 498.0);
        assert!((up - Vector3::new(0.0, 0.0, -10.0)).norm() < 1e-6);
        // radii of curvature of the ellipsoid at this latitude, plus the height
        let north = o.ned_m(47.397_742 + 1e-3, 8.545_594, 488.0);
        let sin2 = 47.397_742_f64.to_radians().sin().powi(2);
        let meridian = SEMI_MAJOR_M * (1.0 - ECCENTRICITY2) / (1.0 - ECCENTRICITY2 * sin2).powf(1.5) + 488.0;
        assert!((north.x - 1e-3_f64.to_radians() * meridian).abs() < 1e-3 && north.y.abs() < 1e-6);
        let east = o.ned_m(47.397_742, 8.545_594 + 1e-3, 488.0);
        let parallel = (SEMI_MAJOR_M / (1.0 - ECCENTRICITY2 * sin2).sqrt() + 488.0) * (1.0 - sin2).sqrt();
        assert!((east.y - 1e-3_f64.to_radians() * parallel).abs() < 1e-3 && east.x.abs() < 1e-3);
    }
}
