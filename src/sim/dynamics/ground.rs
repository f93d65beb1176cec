use nalgebra::{Vector2, Vector3};

/// A flat floor under four feet. Downwards each foot is a spring and a damper; sideways it sticks to a point of the
/// floor by a spring and a damper of its own until Coulomb's limit is reached, then it drags that point along.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    /// Height of the floor below the origin of the local frame, m (positive down).
    pub down_m: f64,
    /// Feet: half the side of their square, and depth below the body's origin, m.
    pub half_span_m: f64,
    pub depth_m: f64,
    pub stiffness_npm: f64,
    pub damping_nspm: f64,
    /// Coulomb's coefficient.
    pub friction: f64,
}

/// How far a foot sinks into the floor before the damper acts fully, and at rest, m.
const SAG_M: f64 = 0.02;

impl Ground {
    /// For a vehicle of this mass and arm length that stands with its origin at the origin of the local frame. The
    /// sag of 2 cm makes the floor soft enough for the physics' step.
    pub fn under(mass_kg: f64, arm_m: f64) -> Self {
        let feet = 4.0;
        let stiffness = mass_kg * crate::vehicle::GRAVITY_MPS2 / (feet * SAG_M);
        let depth = 0.4 * arm_m;
        Self {
            down_m: depth - SAG_M,
            half_span_m: 0.5 * arm_m,
            depth_m: depth,
            stiffness_npm: stiffness,
            damping_nspm: 1.2 * (stiffness * mass_kg / feet).sqrt(),
            friction: 0.8,
        }
    }

    pub(super) fn feet(&self) -> [Vector3<f64>; 4] {
        let (a, d) = (self.half_span_m, self.depth_m);
        [Vector3::new(a, a, d), Vector3::new(-a, -a, d), Vector3::new(a, -a, d), Vector3::new(-a, a, d)]
    }

    /// Whether any foot can reach the floor from this height, however the body is turned.
    pub(super) fn in_reach(&self, down_m: f64) -> bool {
        down_m + self.depth_m + 2.0 * self.half_span_m > self.down_m
    }

    /// Force on one foot (NED, N), at a place and velocity in NED and stuck to a point of the floor; `None` in the air.
    pub(super) fn force(
        &self,
        at: Vector3<f64>,
        velocity: Vector3<f64>,
        stuck_to: Vector2<f64>,
    ) -> Option<Vector3<f64>> {
        let normal = self.normal(at.z, velocity.z)?;
        let pull = self.pull(at, velocity, stuck_to);
        let limit = self.friction * normal;
        let size = pull.norm();
        let sideways = if size > limit { pull * (limit / size) } else { pull };
        Some(Vector3::new(sideways.x, sideways.y, -normal))
    }

    /// Where a foot sticks after a step that ended here; `None` in the air.
    pub(super) fn stick(
        &self,
        at: Vector3<f64>,
        velocity: Vector3<f64>,
        stuck_to: Option<Vector2<f64>>,
    ) -> Option<Vector2<f64>> {
        let limit = self.friction * self.normal(at.z, velocity.z)?;
        let point = stuck_to.unwrap_or(at.xy());
        let pull = self.pull(at, velocity, point);
        let size = pull.norm();
        // sliding: the point follows so that the spring alone gives what friction can hold
        Some(if size > limit { at.xy() + pull * (limit / (size * self.stiffness_npm)) } else { point })
    }

    fn normal(&self, down_m: f64, sink_rate_mps: f64) -> Option<f64> {
        let sink = down_m - self.down_m;
        // the damper grows with the sink, so that touching down gives no jump in force
        let damping = self.damping_nspm * (sink / SAG_M).min(1.0);
        (sink > 0.0).then(|| (self.stiffness_npm * sink + damping * sink_rate_mps).max(0.0))
    }

    fn pull(&self, at: Vector3<f64>, velocity: Vector3<f64>, stuck_to: Vector2<f64>) -> Vector2<f64> {
        (stuck_to - at.xy()) * self.stiffness_npm - velocity.xy() * self.damping_nspm
    }
}
