use super::channels::bounds_of;
use super::paper::momentum_plant;
use super::plant::Plant;
use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, DVector};

/// The paper's plant with the bounds that a vehicle declares: order 1, since an envelope bounds the wrench's rate and
/// no higher derivative. The input's error enters beside the wrench's rate.
///
/// Each box of k bounds |ηᵢ| ≤ bᵢ is put into the ellipsoid Σ(ηᵢ/bᵢ)² ≤ k; the axes designed one by one, which run
/// online, need no such detour and are tighter.
pub fn declared_plant(vehicle: &Vehicle) -> Plant {
    let bounds = bounds_of(vehicle);
    let ellipsoid = |box_: &[f64]| {
        let k = box_.len() as f64;
        DMatrix::from_diagonal(&DVector::from_iterator(box_.len(), box_.iter().map(|b| 1.0 / (k * b * b))))
    };
    let rates = bounds.map(|b| b.rate);
    let outputs: Vec<f64> = bounds.iter().map(|b| b.momentum).chain(bounds.iter().filter_map(|b| b.direct)).collect();
    let plant = momentum_plant(1, ellipsoid(&rates), ellipsoid(&outputs));
    // inputs that are known exactly add no disturbance
    let unsure: Vec<usize> = (0..6).filter(|&i| bounds[i].input > 0.0).collect();
    let n = plant.a.nrows();
    let w1 = DMatrix::from_fn(n, 6 + unsure.len(), |i, j| match unsure.get(j.wrapping_sub(6)) {
        Some(&axis) => f64::from(i == axis),
        None => plant.w1[(i, j)],
    });
    let process: Vec<f64> = rates.into_iter().chain(unsure.iter().map(|&i| bounds[i].input)).collect();
    Plant { w1, q1: ellipsoid(&process), ..plant }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::design_continuous;
    use crate::vehicle::resolve;

    #[test]
    fn every_flying_preset_has_a_design() {
        for name in ["arducopter-sitl", "px4-sih", "px4-x500"] {
            let plant = declared_plant(&resolve(name).unwrap());
            plant.check().unwrap();
            let design = design_continuous(&plant, 2.0).unwrap();
            assert!(design.margin > 0.0 && design.half_widths.iter().all(|w| w.is_finite()), "{name}");
        }
    }
}
