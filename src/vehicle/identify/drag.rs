//! Drag, where the wind is not known.
//!
//! In windows of a few seconds the wind is taken as constant and as one more unknown, so that what remains is how the
//! specific force across the thrust axis follows the *changes* of velocity: legs and gust responses. The law fitted is
//! `a = −linear·s·u − quadratic·u|u| + bias` on the body's lateral axes, `u = Rᵀ(v − w)` the velocity through the air
//! without vertical wind, and `s` either 1 or Σ√T over its mean (momentum drag of the rotors). Each window's wind is
//! eliminated from the normal equations (Schur complement); Levenberg–Marquardt steps, Cauchy's loss against gusts.

use super::bins::Bin;
use super::regress::solve;
use super::series::{median, quantile};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x6, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// Residuals are never taken to be smaller than this: telemetry's resolution, m/s².
const SCALE_FLOOR_MPS2: f64 = 0.01;
/// Residuals beyond this many scales lose weight.
const CAUCHY: f64 = 3.0;
/// Standard deviation of a constant accelerometer error, m/s².
const BIAS_SIGMA_MPS2: f64 = 0.05;
const STEPS: usize = 120;

/// Does the linear part of drag grow with the rotors' thrust?
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// With Σ√T: momentum drag of the rotors.
    Rotors,
    /// Not at all.
    Body,
}

/// Drag per mass on the body's forward and right axes.
#[derive(Debug, Clone)]
pub struct DragFit {
    pub form: Form,
    /// 1/s, at the mean Σ√T.
    pub linear: [f64; 2],
    /// 1/m.
    pub quadratic: [f64; 2],
    /// Of (linear, linear, quadratic, quadratic).
    pub covariance: SMatrix<f64, 4, 4>,
    /// Velocity of the air in each bin, NED, m/s.
    pub wind: Vec<Vector2<f64>>,
    /// The airspeed that 5 % of the bins exceed, m/s.
    pub airspeed_mps: f64,
    /// How far velocity moves within a window, m/s: what excites the fit.
    pub excursion_mps: f64,
    pub cost: f64,
}

impl DragFit {
    /// Deceleration at an airspeed `u`, m/s².
    pub fn at(&self, axis: usize, u: f64) -> f64 {
        self.linear[axis] * u + self.quadratic[axis] * u * u
    }

    /// Standard deviation of [`Self::at`].
    pub fn sigma_at(&self, axis: usize, u: f64) -> f64 {
        let mut g = nalgebra::Vector4::zeros();
        (g[axis], g[2 + axis]) = (u, u * u);
        (g.tr_mul(&(self.covariance * g)))[0].max(0.0).sqrt()
    }
}

/// What is varied in a fit.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    pub form: Form,
    /// One law for both axes.
    pub isotropic: bool,
    pub window_s: f64,
}

/// Fits the drag law; `None` where the bins do not determine it. `scale` fixes the residuals' scale (m/s²), so that
/// the costs of two fits can be compared; the scale found comes back.
pub fn fit(bins: &[Bin], layout: Layout, scale: Option<f64>) -> Option<(DragFit, f64)> {
    let problem = Problem::new(bins, layout)?;
    let mut theta = Vector6::new(0.3, 0.3, 0.02, 0.02, 0.0, 0.0);
    let mut wind = problem.starting_winds(&theta);
    let residuals = |theta: &Vector6<f64>, wind: &[Vector2<f64>]| problem.residual_scale(theta, wind);
    let mut sigma = scale.unwrap_or_else(|| residuals(&theta, &wind));
    let mut damping = 1e-3;
    let mut cost = problem.cost(&theta, &wind, sigma);
    for step in 0..STEPS {
        if scale.is_none() && step % 8 == 7 && step < STEPS / 2 {
            sigma = residuals(&theta, &wind);
            cost = problem.cost(&theta, &wind, sigma);
        }
        let normal = problem.normal(&theta, &wind, sigma);
        let before = cost;
        while damping < 1e8 {
            let (moved, winds) = problem.step(&normal, &theta, &wind, damping)?;
            let new = problem.cost(&moved, &winds, sigma);
            if new <= cost {
                (theta, wind, cost) = (moved, winds, new);
                damping = (damping / 5.0).max(1e-9);
                break;
            }
            damping *= 4.0;
        }
        if damping >= 1e8 || (step > STEPS / 2 && before - cost < 1e-9 * before) {
            break;
        }
    }
    let normal = problem.normal(&theta, &wind, sigma);
    let covariance = problem.sandwich(&normal)?;
    let of = |i: usize, j: usize| covariance[(i, j)];
    let wind: Vec<Vector2<f64>> = problem.window.iter().map(|j| wind[*j]).collect();
    let mut speeds: Vec<f64> = bins.iter().zip(&wind).map(|(b, w)| airspeed(b, w).xy().norm()).collect();
    let fit = DragFit {
        form: layout.form,
        linear: [theta[0], theta[1]],
        quadratic: [theta[2], theta[3]],
        covariance: SMatrix::from_fn(of),
        wind,
        airspeed_mps: quantile(&mut speeds, 0.95)?,
        excursion_mps: problem.excursion(),
        cost,
    };
    Some((fit, sigma))
}

/// Velocity through the air, body FRD, m/s.
pub fn airspeed(bin: &Bin, wind: &Vector2<f64>) -> Vector3<f64> {
    bin.rotation.tr_mul(&(bin.velocity_ned_mps - Vector3::new(wind.x, wind.y, 0.0)))
}

struct Problem<'a> {
    bins: &'a [Bin],
    /// Window of each bin.
    window: Vec<usize>,
    windows: usize,
    /// Factor of the linear part in each bin.
    swell: Vec<f64>,
    /// Maps the free parameters to (linear ×2, quadratic ×2, bias ×2).
    free: DMatrix<f64>,
}

/// Normal equations, those of the windows' winds apart.
struct Normal {
    theta: Matrix6<f64>,
    gradient: Vector6<f64>,
    wind: Vec<Matrix2<f64>>,
    cross: Vec<Matrix2x6<f64>>,
    wind_gradient: Vec<Vector2<f64>>,
    /// Of the law's parameters alone, window by window.
    window_gradient: Vec<Vector6<f64>>,
}

impl<'a> Problem<'a> {
    fn new(bins: &'a [Bin], layout: Layout) -> Option<Self> {
        let mut window = Vec::with_capacity(bins.len());
        let mut newest: Option<(usize, i64)> = None;
        let mut index = 0;
        let first = bins.first()?.t_s;
        for b in bins {
            let key = (b.span, ((b.t_s - first) / layout.window_s) as i64);
            if newest.is_some_and(|n| n != key) {
                index += 1;
            }
            newest = Some(key);
            window.push(index);
        }
        let mean = bins.iter().map(|b| b.sqrt_shape).sum::<f64>() / bins.len() as f64;
        let swell = bins.iter().map(|b| if layout.form == Form::Rotors { b.sqrt_shape / mean } else { 1.0 }).collect();
        let free = if layout.isotropic {
            DMatrix::from_row_slice(
                6,
                4,
                &[1., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.],
            )
        } else {
            DMatrix::identity(6, 6)
        };
        (bins.len() > 50 && mean > 0.0).then_some(Self { bins, window, windows: index + 1, swell, free })
    }

    /// The wind that each window's median force asks for.
    fn starting_winds(&self, theta: &Vector6<f64>) -> Vec<Vector2<f64>> {
        let mut seen = vec![[Vec::new(), Vec::new()]; self.windows];
        for ((b, j), s) in self.bins.iter().zip(&self.window).zip(&self.swell) {
            let u = [0, 1].map(|i| {
                let (f, l) = (b.accel_frd_mps2[i].abs(), theta[i] * s);
                -b.accel_frd_mps2[i].signum() * 2.0 * f / (l + (l * l + 4.0 * theta[2 + i] * f).sqrt()).max(1e-9)
            });
            let wind = b.velocity_ned_mps - b.rotation * Vector3::new(u[0], u[1], b.velocity_ned_mps.z);
            seen[*j][0].push(wind.x);
            seen[*j][1].push(wind.y);
        }
        let middle = |x: &mut Vec<f64>| median(x).unwrap_or_default();
        seen.iter_mut().map(|[n, e]| Vector2::new(middle(n), middle(e))).collect()
    }

    /// Residual of bin `i` on lateral axis `k`, its velocity through the air, and the slope of drag there.
    fn residual(&self, theta: &Vector6<f64>, wind: &[Vector2<f64>], i: usize, k: usize) -> (f64, f64, f64) {
        let (b, s) = (&self.bins[i], self.swell[i]);
        let u = airspeed(b, &wind[self.window[i]])[k];
        let (l, q) = (theta[k] * s, theta[2 + k]);
        (b.accel_frd_mps2[k] + l * u + q * u * u.abs() - theta[4 + k], u, l + 2.0 * q * u.abs())
    }

    fn residual_scale(&self, theta: &Vector6<f64>, wind: &[Vector2<f64>]) -> f64 {
        let mut sizes: Vec<f64> =
            (0..self.bins.len()).flat_map(|i| [0, 1].map(|k| self.residual(theta, wind, i, k).0.abs())).collect();
        (1.4826 * median(&mut sizes).unwrap_or_default()).max(SCALE_FLOOR_MPS2)
    }

    fn cost(&self, theta: &Vector6<f64>, wind: &[Vector2<f64>], sigma: f64) -> f64 {
        let loss = |r: f64| 0.5 * CAUCHY * CAUCHY * (r / (CAUCHY * sigma)).powi(2).ln_1p();
        let data: f64 = (0..self.bins.len())
            .map(|i| loss(self.residual(theta, wind, i, 0).0) + loss(self.residual(theta, wind, i, 1).0))
            .sum();
        data + 0.5 * (theta[4].powi(2) + theta[5].powi(2)) / BIAS_SIGMA_MPS2.powi(2)
    }

    fn normal(&self, theta: &Vector6<f64>, wind: &[Vector2<f64>], sigma: f64) -> Normal {
        let n = self.windows;
        let mut normal = Normal {
            theta: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            wind: vec![Matrix2::identity() * 1e-6; n],
            cross: vec![Matrix2x6::zeros(); n],
            wind_gradient: vec![Vector2::zeros(); n],
            window_gradient: vec![Vector6::zeros(); n],
        };
        for (i, b) in self.bins.iter().enumerate() {
            let j = self.window[i];
            for k in 0..2 {
                let (r, u, slope) = self.residual(theta, wind, i, k);
                let w = 1.0 / (1.0 + (r / (CAUCHY * sigma)).powi(2)) / (sigma * sigma);
                let mut by_theta = Vector6::zeros();
                by_theta[k] = -self.swell[i] * u;
                by_theta[2 + k] = -u * u.abs();
                by_theta[4 + k] = 1.0;
                let by_wind = Vector2::new(b.rotation[(0, k)], b.rotation[(1, k)]) * slope;
                normal.theta += by_theta * by_theta.transpose() * w;
                normal.wind[j] += by_wind * by_wind.transpose() * w;
                normal.cross[j] += by_wind * by_theta.transpose() * w;
                normal.wind_gradient[j] += by_wind * (w * r);
                normal.window_gradient[j] += by_theta * (w * r);
            }
        }
        normal.gradient = normal.window_gradient.iter().sum();
        for k in [4, 5] {
            normal.theta[(k, k)] += BIAS_SIGMA_MPS2.powi(-2);
            normal.gradient[k] -= theta[k] * BIAS_SIGMA_MPS2.powi(-2);
        }
        normal
    }

    /// One damped step; coefficients stay where drag brakes.
    fn step(
        &self,
        normal: &Normal,
        theta: &Vector6<f64>,
        wind: &[Vector2<f64>],
        damping: f64,
    ) -> Option<(Vector6<f64>, Vec<Vector2<f64>>)> {
        let inverse: Vec<Matrix2<f64>> =
            normal.wind.iter().map(|d| (d * (1.0 + damping)).try_inverse()).collect::<Option<_>>()?;
        let mut a = normal.theta + Matrix6::from_diagonal(&(normal.theta.diagonal() * damping));
        let mut g = normal.gradient;
        for ((d, e), h) in inverse.iter().zip(&normal.cross).zip(&normal.wind_gradient) {
            a -= e.tr_mul(&(d * e));
            g -= e.tr_mul(&(d * h));
        }
        let a = self.free.tr_mul(&DMatrix::from_column_slice(6, 6, a.as_slice())) * &self.free;
        let g = self.free.tr_mul(&DVector::from_column_slice(g.as_slice()));
        // a coefficient that nothing excites stays where it is
        let ridge = DMatrix::identity(a.nrows(), a.nrows()) * (1e-6 * a.diagonal().max());
        let moved = &self.free * solve(&(a + ridge), &g)?;
        let moved = Vector6::from_column_slice(moved.as_slice());
        let winds = (0..self.windows)
            .map(|j| wind[j] + inverse[j] * (normal.wind_gradient[j] - normal.cross[j] * moved))
            .collect();
        let mut next = theta + moved;
        for k in 0..4 {
            next[k] = next[k].max(0.0);
        }
        Some((next, winds))
    }

    /// Covariance from the scatter of the windows' gradients.
    fn sandwich(&self, normal: &Normal) -> Option<DMatrix<f64>> {
        let mut a = normal.theta;
        let mut scores = DMatrix::zeros(6, self.windows);
        for j in 0..self.windows {
            let (e, inverse) = (&normal.cross[j], normal.wind[j].try_inverse()?);
            a -= e.tr_mul(&(inverse * e));
            let score = normal.window_gradient[j] - e.tr_mul(&(inverse * normal.wind_gradient[j]));
            scores.column_mut(j).copy_from_slice(score.as_slice());
        }
        let free = &self.free;
        let a = free.tr_mul(&DMatrix::from_column_slice(6, 6, a.as_slice())) * free;
        let ridge = DMatrix::identity(a.nrows(), a.nrows()) * (1e-9 * a.diagonal().max());
        let bread = (a + ridge).try_inverse()?;
        let reduced = free.tr_mul(&scores);
        let meat = &reduced * reduced.transpose();
        let covariance = &bread * meat * &bread;
        Some(free * covariance * free.transpose())
    }

    fn excursion(&self) -> f64 {
        let mut range = vec![[f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY]; self.windows];
        for (b, j) in self.bins.iter().zip(&self.window) {
            let r = &mut range[*j];
            let v = b.velocity_ned_mps;
            *r = [r[0].min(v.x), r[1].max(v.x), r[2].min(v.y), r[3].max(v.y)];
        }
        let mut reach: Vec<f64> = range.iter().map(|r| (r[1] - r[0]).hypot(r[3] - r[2])).collect();
        quantile(&mut reach, 0.9).unwrap_or_default()
    }
}
