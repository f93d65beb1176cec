use crate::sim::random::Random;
use crate::vehicle::{Ranged, Vehicle};

/// A vehicle that the declared ranges of `model` allow: each number drawn uniformly from its range, the inertia scaled
/// within its uncertainty.
pub(super) fn within_ranges(model: &Vehicle, random: &mut Random) -> Vehicle {
    let mut v = model.clone();
    let mut draw = |r: &mut Ranged| {
        if r.range.hi() > r.range.lo() {
            r.nominal = random.between(r.range.lo(), r.range.hi());
        }
    };
    draw(&mut v.mass_kg);
    draw(&mut v.thrust.max_n);
    for axis in v.drag.linear.iter_mut().chain(&mut v.drag.rotor).chain(&mut v.drag.area_m2) {
        draw(axis);
    }
    v.inertia_kgm2 *= 1.0 + random.between(-v.inertia_uncertainty, v.inertia_uncertainty);
    v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::random::Part;
    use crate::vehicle::resolve;

    #[test]
    fn samples_stay_within_the_declared_ranges_and_differ() {
        let model = resolve("arducopter-sitl").unwrap();
        let mut random = Random::new(1, 1, Part::Vehicle);
        let vehicles: Vec<_> = (0..50).map(|_| within_ranges(&model, &mut random)).collect();
        for v in &vehicles {
            assert!(model.mass_kg.range.contains(v.mass_kg.nominal));
            assert!(model.thrust.max_n.range.contains(v.thrust.max_n.nominal));
            assert!((0..3).all(|i| model.drag.area_m2[i].range.contains(v.drag.area_m2[i].nominal)));
        }
        assert!(vehicles.windows(2).all(|w| w[0].mass_kg.nominal != w[1].mass_kg.nominal));
    }
}
