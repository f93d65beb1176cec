use super::plant::Plant;
use nalgebra::{DMatrix, DVector};

/// The nonlinear system Σ₁* of eq. (2) and the observer (16) that is known for it: `ẋ = f(w, x)`, `z = h(w, x)`,
/// `x̂˙ = f(w, x̂) + g(x̂, w, z)`. What is known over time enters through `t_s`. A cascade (Σ₁ of eq. 1a) ignores w.
pub trait Nonlinear {
    fn f(&self, t_s: f64, w: &DVector<f64>, x: &DVector<f64>) -> DVector<f64>;
    fn h(&self, t_s: f64, w: &DVector<f64>, x: &DVector<f64>) -> DVector<f64>;
    fn g(&self, t_s: f64, x: &DVector<f64>, w: &DVector<f64>, z: &DVector<f64>) -> DVector<f64>;
    /// ∂h/∂x.
    fn h_by_x(&self, t_s: f64, w: &DVector<f64>, x: &DVector<f64>) -> DMatrix<f64>;
    /// ∂h/∂w; zero in a cascade.
    fn h_by_w(&self, t_s: f64, w: &DVector<f64>, x: &DVector<f64>) -> DMatrix<f64>;
}

/// The observer for an interconnection: eqs. (17) and (18), of which (9) and (10) are the cascade's case.
///
/// For any system, in continuous time: to be integrated by whoever uses it, together with the measurements. The
/// navigation observer is this one written out, with samples.
#[derive(Debug, Clone)]
pub struct Interconnected<S> {
    pub system: S,
    pub plant: Plant,
    /// K = [K_w; K_z] of a [`Design`](super::Design) for the plant.
    pub gain: DMatrix<f64>,
}

/// Estimates, or their rates of change.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimates {
    pub w: DVector<f64>,
    /// ξ: what ẑ has beside h.
    pub xi: DVector<f64>,
    pub x: DVector<f64>,
}

impl<S: Nonlinear> Interconnected<S> {
    /// ẑ = h(ŵ, x̂) + ξ (17d).
    pub fn z(&self, t_s: f64, e: &Estimates) -> DVector<f64> {
        self.system.h(t_s, &e.w, &e.x) + &e.xi
    }

    /// The estimates' rates of change under the output `y`, from which the known part D_u·u has been taken, with B_u·u
    /// as `input`.
    ///
    /// # Panics
    /// When the shapes of plant, gain, system and vectors do not fit.
    pub fn rate(&self, t_s: f64, input: &DVector<f64>, y: &DVector<f64>, e: &Estimates) -> Estimates {
        let (n_w, p_z, _) = self.plant.sizes();
        let (k_w, k_z) = (self.gain.rows(0, n_w), self.gain.rows(n_w, p_z));
        let z = self.z(t_s, e);
        let innovation = y - &self.plant.c * &e.w - &self.plant.d_z * &z;
        let from_output = k_w * &innovation;
        let injection = self.system.g(t_s, &e.x, &e.w, &z);
        Estimates {
            w: &self.plant.a * &e.w + input + &self.plant.b_z * &z + &from_output,
            xi: k_z * &innovation
                - self.system.h_by_x(t_s, &e.w, &e.x) * &injection
                - self.system.h_by_w(t_s, &e.w, &e.x) * &from_output,
            x: self.system.f(t_s, &e.w, &e.x) + injection,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::design::{Goal, PoleRegion, design};
    use super::*;
    use nalgebra::{dmatrix, dvector};

    /// Example 1: Rajamani's system with Φ of Lipschitz constant 0.4, in a share `feedback` a function of w too.
    struct Example1 {
        feedback: f64,
    }

    impl Example1 {
        fn phi(&self, t: f64, w: &DVector<f64>, x: &DVector<f64>) -> DVector<f64> {
            dvector![0.2 * (x[0] + t).sin(), 0.2 * x[1].cos() + self.feedback * w[0].sin()]
        }
    }

    impl Nonlinear for Example1 {
        fn f(&self, t: f64, w: &DVector<f64>, x: &DVector<f64>) -> DVector<f64> {
            dmatrix![0.0, 1.0; 1.0, -1.0] * x + self.phi(t, w, x)
        }
        fn h(&self, _: f64, _: &DVector<f64>, x: &DVector<f64>) -> DVector<f64> {
            dvector![x[1]]
        }
        fn g(&self, _: f64, x: &DVector<f64>, _: &DVector<f64>, z: &DVector<f64>) -> DVector<f64> {
            dvector![69.6, 11.6] * (z[0] - x[1])
        }
        fn h_by_x(&self, _: f64, _: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
            dmatrix![0.0, 1.0]
        }
        fn h_by_w(&self, _: f64, _: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
            dmatrix![0.0, 0.0]
        }
    }

    /// Error of x̂ at the end, over that at the start.
    fn run(feedback: f64) -> f64 {
        let plant = Plant::example_1();
        // the fast observer of Σ₁ asks for a small γ; the radius keeps the step of this test small enough
        let region = PoleRegion { radius: Some(300.0), ..PoleRegion::default() };
        let gain = design(&plant, &Goal { region, ..Goal::new(0.05, 1e6) }).unwrap().gain;
        let observer = Interconnected { system: Example1 { feedback }, plant, gain };
        let plant = &observer.plant;
        let none = DVector::zeros(2);
        let (mut w, mut x) = (dvector![0.0, 0.0], dvector![1.0, -0.5]);
        let mut e = Estimates { w: none.clone(), xi: dvector![0.0], x: dvector![0.0, 0.0] };
        let first = (&x - &e.x).norm();
        let dt = 2e-4;
        for k in 0..40_000 {
            let t = f64::from(k) * dt;
            let y = &plant.c * &w;
            let rate = observer.rate(t, &none, &y, &e);
            let z = observer.system.h(t, &w, &x);
            let (w_rate, x_rate) = (&plant.a * &w + &plant.b_z * z, observer.system.f(t, &w, &x));
            w += w_rate * dt;
            x += x_rate * dt;
            e.w += rate.w * dt;
            e.xi += rate.xi * dt;
            e.x += rate.x * dt;
        }
        (&x - &e.x).norm() / first
    }

    #[test]
    fn example_1_converges_in_cascade_and_with_feedback() {
        for feedback in [0.0, 0.1] {
            let left = run(feedback);
            assert!(left < 0.05, "{left} of the error is left with feedback {feedback}");
        }
    }
}
