//! From `f64` to the wire's `f32` without a bound becoming narrower than it was.

use nalgebra::Vector3;

/// An `f32` above the real number that was rounded to `x`.
pub(super) fn up(x: f64) -> f32 {
    let x = x.next_up();
    let nearest = x as f32;
    if f64::from(nearest) < x { nearest.next_up() } else { nearest }
}

/// An `f32` below the real number that was rounded to `x`.
pub(super) fn down(x: f64) -> f32 {
    -up(-x)
}

/// Half-widths that still cover what `values ± half_widths` covers once the values are `f32`.
pub fn half_widths(values: &Vector3<f64>, half_widths: &Vector3<f64>) -> [f32; 3] {
    std::array::from_fn(|i| {
        let moved = (f64::from(values[i] as f32) - values[i]).abs();
        up(half_widths[i] + moved)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What the receiver computes from the message contains what was meant.
        #[test]
        fn bounds_never_shrink_on_the_wire(value in -1e6_f64..1e6, width in 0.0_f64..1e3, at in -1.0_f64..=1.0) {
            let truth = value + at * width;
            let sent = half_widths(&Vector3::from_element(value), &Vector3::from_element(width))[0];
            prop_assert!((truth - f64::from(value as f32)).abs() <= f64::from(sent));
            prop_assert!(f64::from(down(truth)) < truth && truth < f64::from(up(truth)));
        }
    }

    #[test]
    fn infinity_stays_infinite() {
        assert_eq!(half_widths(&Vector3::zeros(), &Vector3::from_element(f64::INFINITY)), [f32::INFINITY; 3]);
        assert_eq!(down(f64::NEG_INFINITY), f32::NEG_INFINITY);
        assert!(up(f64::NAN).is_nan());
    }
}
