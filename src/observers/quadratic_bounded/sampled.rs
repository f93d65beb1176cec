use super::certify::{Growth, Node, StepLaw, Verdict};
use super::flow::{Flow, Polynomials, square_root};
use super::plant::{PlantError, SampledPlant, half_widths, projected, volume};
use crate::sdp::{Affine, Outcome, Problem, ProblemError, Settings, verify};
use nalgebra::DMatrix;

/// Why there is no design.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DesignError {
    #[error(transparent)]
    Plant(#[from] PlantError),
    #[error(transparent)]
    Problem(#[from] ProblemError),
    #[error("the convergence rate must be positive and finite, not {0} 1/s")]
    Rate(f64),
    #[error("the step lengths must be positive, finite and rising")]
    Steps,
    #[error("no observer converges at α = {alpha} 1/s: {why}")]
    Infeasible { alpha: f64, why: String },
    #[error("the bound at α = {alpha} 1/s can be made as small as one likes: a noise block is missing ({why})")]
    Unbounded { alpha: f64, why: String },
    #[error("the solver gave no trustworthy design at α = {alpha} 1/s: {why}")]
    Inaccurate { alpha: f64, why: String },
    #[error("the design at α = {alpha} 1/s failed its check: {what} has margin {margin:.1e}")]
    NotVerified { alpha: f64, what: String, margin: f64 },
    #[error("between its nodes the design at α = {alpha} 1/s fails at a step of {dt_s} s: more nodes are needed")]
    BetweenNodes { alpha: f64, dt_s: f64 },
}

/// How far a statement about all step lengths has been checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coverage {
    /// Proven for every step length from the first node to the last.
    Proven,
    /// Checked at many step lengths between the nodes (A is not nilpotent, so there is no polynomial to enclose).
    CheckedOnAGrid,
}

/// The independent check of a sampled design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    pub coverage: Coverage,
    /// Smallest eigenvalue of N(δ) (see `certify`) over the step lengths, in coordinates in which P is the identity.
    pub margin: f64,
    /// Factor by which the solver's ellipsoid S = P⁻¹ was enlarged so that the bound also holds between the nodes.
    pub enlarged: f64,
}

/// What a step does when only some outputs arrive: V⁺ ≤ growth·V + offset at each node, and between two nodes with
/// gain, growth and offset interpolated linearly in the step length.
#[derive(Debug, Clone, PartialEq)]
pub struct PartialStep {
    /// Bit j is set when output j is used. Zero is a pure prediction.
    pub outputs: u32,
    /// Gains by node, n×p, with zero columns where the output is missing.
    pub gains: Vec<DMatrix<f64>>,
    pub growth: Vec<f64>,
    pub offset: Vec<f64>,
    pub coverage: Coverage,
}

/// A sampled observer in filter form: predict x⁻ = e^{Aδ}x̂ + (input), update x̂⁺ = x⁻ + L(δ)(C·x⁻ − y).
///
/// With V = eᵀPe, e = x − x̂: V⁺ ≤ e^{−αδ}·V + 1 − e^{−αδ} for every δ from the first node to the last, the gain interpolated
/// linearly in δ between the nodes; so V ≤ 1 stays, and V > 1 decays at the rate α (eq. 18 of the paper, for sampled
/// data). It holds for disturbances that move freely within their ellipsoids also between the samples.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledDesign {
    /// 1/s.
    pub alpha: f64,
    /// The nodes, s, rising.
    pub dt_s: Vec<f64>,
    /// L by node, n×p, with the paper's sign (A + LC).
    pub gains: Vec<DMatrix<f64>>,
    pub p: DMatrix<f64>,
    pub p_inv: DMatrix<f64>,
    /// √((P⁻¹)ᵢᵢ), the half-width of each state at V = 1.
    pub half_widths: Vec<f64>,
    /// Volume and log det P_z of the ellipsoid of z = E₁x at V = 1.
    pub volume: f64,
    pub log_det: f64,
    pub certificate: Certificate,
    /// One for every proper subset of the outputs, indexed by its bit mask.
    pub partial: Vec<PartialStep>,
    /// Time in the solver, s.
    pub solve_s: f64,
}

impl SampledDesign {
    /// The node at or below a step length and how far (0..1) it lies towards the next; `None` outside the nodes.
    pub fn locate(&self, dt_s: f64) -> Option<(usize, f64)> {
        let last = self.dt_s.len().checked_sub(1)?;
        if dt_s.is_nan() || dt_s < self.dt_s[0] || dt_s > self.dt_s[last] {
            return None;
        }
        let k = self.dt_s.partition_point(|&x| x <= dt_s).saturating_sub(1).min(last.saturating_sub(1));
        let span = self.dt_s[(k + 1).min(last)] - self.dt_s[k];
        Some((k, if span > 0.0 { (dt_s - self.dt_s[k]) / span } else { 0.0 }))
    }
}

/// `count` step lengths from `shortest` to `longest`, in equal ratios.
pub fn step_nodes(shortest_s: f64, longest_s: f64, count: usize) -> Vec<f64> {
    match count {
        0 => Vec::new(),
        1 => vec![longest_s],
        _ => {
            let ratio = longest_s / shortest_s;
            let inner = |k| shortest_s * ratio.powf(k as f64 / (count - 1) as f64);
            (0..count)
                .map(|k| if k == 0 { shortest_s } else if k == count - 1 { longest_s } else { inner(k) })
                .collect()
        }
    }
}

/// The plant in the form the design works with.
struct Prepared<'a> {
    plant: &'a SampledPlant,
    flow: Flow,
    process: Vec<DMatrix<f64>>,
    measurement: Vec<DMatrix<f64>>,
    alpha: f64,
}

/// What the semidefinite program gave.
struct Solved {
    p: DMatrix<f64>,
    gains: Vec<DMatrix<f64>>,
    /// Shares of λ by node, process blocks first.
    weights: Vec<Vec<f64>>,
    seconds: f64,
}

impl<'a> Prepared<'a> {
    fn new(plant: &'a SampledPlant, alpha: f64, dt_nodes: &[f64]) -> Result<Self, DesignError> {
        let (process, measurement) = plant.units()?;
        if !alpha.is_finite() || alpha <= 0.0 {
            return Err(DesignError::Rate(alpha));
        }
        let rising = dt_nodes.windows(2).all(|w| w[0] < w[1]);
        if dt_nodes.is_empty() || !rising || dt_nodes.iter().any(|d| !d.is_finite() || *d <= 0.0) {
            return Err(DesignError::Steps);
        }
        Ok(Self { plant, flow: Flow::new(&plant.a), process, measurement, alpha })
    }

    /// Largest det X with X ⪯ P_z subject to the step inequality at every node, with one P for all.
    ///
    /// At a node with λ = 1 − e^{−αδ}, Y = PL, Gᵢ from [`Flow::spread`], and multipliers τᵢ, σⱼ ≥ 0 with Στ + Σσ ≤ λ (the
    /// S-procedure with one ellipsoid per block):
    /// ```text
    /// [ (1−λ)P        0           0          ((P+YC)A_d)ᵀ ]
    /// [   0         τᵢ·I          0          ((P+YC)Gᵢ)ᵀ  ]  ⪰ 0
    /// [   0           0         σⱼ·I           (YVⱼ)ᵀ     ]
    /// [ (P+YC)A_d  (P+YC)Gᵢ      YVⱼ             P        ]
    /// ```
    fn solve(&self, dt_nodes: &[f64]) -> Result<Solved, DesignError> {
        let (n, outputs) = (self.plant.a.nrows(), self.plant.c.nrows());
        let e1 = &self.plant.e1;
        let mut problem = Problem::new();
        let p = problem.symmetric(n);
        let x = problem.symmetric(e1.nrows());
        problem.positive("P ⪰ E₁ᵀXE₁", &p - &e1.transpose() * &x * e1);
        problem.maximize_log_det(1.0, &x);
        // z alone would leave P free, even singular, in the other states: they count a little
        problem.maximize_log_det(OTHER_STATES, &p);
        let mut unknowns = Vec::new();
        for (k, &dt) in dt_nodes.iter().enumerate() {
            let lambda = -(-self.alpha * dt).exp_m1();
            let y = problem.matrix(n, outputs);
            let corrected = &p + &y * &self.plant.c;
            let mut columns = vec![(&corrected * &self.flow.transition(dt), (1.0 - lambda) * &p)];
            let mut weights = Vec::new();
            let process = self.process.iter().map(|w| &corrected * &square_root(&self.flow.spread(w, dt)));
            let measurement = self.measurement.iter().map(|v| &y * v);
            for effect in process.chain(measurement) {
                let weight = problem.scalar();
                let size = effect.shape().1;
                columns.push((effect, times_identity(&weight, size)));
                weights.push(weight);
            }
            let (sum, inequality) = step_inequality(columns, &p, &weights);
            problem.positive(format!("step of {dt} s"), inequality);
            problem.positive(format!("weights at {dt} s"), Affine::constant(DMatrix::from_element(1, 1, lambda)) - sum);
            unknowns.push((k, y, weights, lambda));
        }
        let solution = match problem.solve(&Settings::default())? {
            Outcome::Optimal(s) => s,
            Outcome::Infeasible(why) => return Err(DesignError::Infeasible { alpha: self.alpha, why: why.to_string() }),
            Outcome::Unbounded(why) => return Err(DesignError::Unbounded { alpha: self.alpha, why: why.to_string() }),
            Outcome::Inaccurate { reason, .. } => {
                return Err(DesignError::Inaccurate { alpha: self.alpha, why: reason });
            }
        };
        let p = solution.value(&p);
        let factor = p.clone().cholesky().ok_or_else(|| self.not_verified("P", &p))?;
        let gains = unknowns.iter().map(|(_, y, _, _)| factor.solve(&solution.value(y))).collect();
        let weights = unknowns
            .iter()
            .map(|(_, _, w, lambda)| {
                let shares: Vec<f64> = w.iter().map(|w| (solution.value(w)[(0, 0)] / lambda).max(1e-12)).collect();
                let sum: f64 = shares.iter().sum();
                shares.iter().map(|s| s / sum).collect()
            })
            .collect();
        Ok(Solved { p, gains, weights, seconds: solution.seconds })
    }

    fn not_verified(&self, what: &str, m: &DMatrix<f64>) -> DesignError {
        DesignError::NotVerified { alpha: self.alpha, what: what.into(), margin: verify::margin(m) }
    }
}

/// weight·I of a size.
fn times_identity(weight: &Affine, size: usize) -> Affine {
    let rows: Vec<Vec<Affine>> = (0..size)
        .map(|i| (0..=i).map(|j| if i == j { weight.clone() } else { Affine::zeros(1, 1) }).collect())
        .collect();
    Affine::symmetric_block(&rows)
}

/// The step inequality from (effect, diagonal block) pairs and the corner P, and the sum of the weights.
fn step_inequality(columns: Vec<(Affine, Affine)>, corner: &Affine, weights: &[Affine]) -> (Affine, Affine) {
    let mut rows: Vec<Vec<Affine>> = Vec::new();
    for (i, (_, diagonal)) in columns.iter().enumerate() {
        let mut row: Vec<Affine> =
            columns[..i].iter().map(|(_, d)| Affine::zeros(diagonal.shape().0, d.shape().0)).collect();
        row.push(diagonal.clone());
        rows.push(row);
    }
    let mut last: Vec<Affine> = columns.into_iter().map(|(effect, _)| effect).collect();
    last.push(corner.clone());
    rows.push(last);
    let sum = weights.iter().fold(Affine::zeros(1, 1), |s, w| s + w);
    (sum, Affine::symmetric_block(&rows))
}

/// Designs the sampled observer at a convergence rate α (1/s) for every step length from the first of `dt_nodes` (s) to
/// the last: the smallest ellipsoid of z that all steps share.
///
/// # Errors
/// A plant or nodes that do not fit, no observer at this rate, or a design that did not survive its check.
pub fn design_sampled(plant: &SampledPlant, alpha: f64, dt_nodes: &[f64]) -> Result<SampledDesign, DesignError> {
    let prepared = Prepared::new(plant, alpha, dt_nodes)?;
    let solved = prepared.solve(dt_nodes)?;
    let certified = enlarge_until_certified(&prepared, &solved, dt_nodes)?;
    finish(&prepared, solved, certified, dt_nodes)
}

/// Coordinates R·e with P = RᵀR, the plant in them, and the certificate.
struct Certified {
    p: DMatrix<f64>,
    p_inv: DMatrix<f64>,
    r: DMatrix<f64>,
    c: DMatrix<f64>,
    certificate: Certificate,
}

/// Enlarges the ellipsoid S = P⁻¹ step by step until the decay law holds at every step length.
///
/// Enlarging S by κ leaves the contraction part of the inequality as it is and shrinks the noise part by κ; so it
/// makes room wherever noise acts.
fn enlarge_until_certified(
    prepared: &Prepared<'_>,
    solved: &Solved,
    dt_nodes: &[f64],
) -> Result<Certified, DesignError> {
    let mut failed_at = dt_nodes[0];
    for enlarged in [1.0 + 1e-6, 1.0 + 1e-5, 1.0 + 1e-4, 1.001, 1.003, 1.01, 1.03, 1.1] {
        let p = &solved.p / enlarged;
        let Some(factor) = p.clone().cholesky() else { return Err(prepared.not_verified("P", &p)) };
        let r = factor.l().transpose();
        let r_inv = super::plant::over(&DMatrix::identity(p.nrows(), p.nrows()), &r);
        let c = &prepared.plant.c * &r_inv;
        let nodes: Vec<Node> = dt_nodes
            .iter()
            .zip(&solved.gains)
            .zip(&solved.weights)
            .map(|((&dt_s, l), w)| Node { dt_s, gain: &r * l, growth: 1.0, weights: w.clone() })
            .collect();
        let law = Law { prepared, r: &r, r_inv: &r_inv, c: &c, growth: Growth::Decay { alpha: prepared.alpha } };
        match law.check(&nodes, 1.0) {
            (coverage, Verdict::Proven { margin }) => {
                let certificate = Certificate { coverage, margin, enlarged };
                return Ok(Certified { p_inv: &r_inv * r_inv.transpose(), p, r, c, certificate });
            }
            (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) => failed_at = dt_s,
        }
    }
    Err(DesignError::BetweenNodes { alpha: prepared.alpha, dt_s: failed_at })
}

/// A step law in given coordinates, checked by enclosures where A is nilpotent and on a grid elsewhere.
struct Law<'a> {
    prepared: &'a Prepared<'a>,
    r: &'a DMatrix<f64>,
    r_inv: &'a DMatrix<f64>,
    c: &'a DMatrix<f64>,
    growth: Growth,
}

/// Weight of log det P beside log det X: what the bound on z may lose for the sake of the other states.
const OTHER_STATES: f64 = 0.01;

/// Points between two nodes at which a design without polynomials is checked.
const GRID: usize = 32;

impl Law<'_> {
    fn check(&self, nodes: &[Node], slack: f64) -> (Coverage, Verdict) {
        let exact = self.prepared.flow.polynomials(self.r, self.r_inv, &self.prepared.process);
        match exact {
            Some(motion) => (Coverage::Proven, self.step_law(&motion, slack).prove(nodes)),
            None => (Coverage::CheckedOnAGrid, self.check_on_grid(nodes, slack)),
        }
    }

    fn step_law<'b>(&'b self, motion: &'b Polynomials, slack: f64) -> StepLaw<'b> {
        StepLaw {
            motion,
            c: self.c,
            measurement: &self.prepared.measurement,
            process_blocks: self.prepared.process.len(),
            growth: self.growth,
            slack,
        }
    }

    fn check_on_grid(&self, nodes: &[Node], slack: f64) -> Verdict {
        let mut margin = f64::INFINITY;
        let pairs = nodes.windows(2).map(|w| (&w[0], &w[1]));
        for (a, b) in pairs.chain(nodes.last().map(|n| (n, n))) {
            for k in 0..=GRID {
                let s = k as f64 / GRID as f64;
                let dt_s = a.dt_s + s * (b.dt_s - a.dt_s);
                let lowest = verify::smallest_eigenvalue(&self.at(a, b, s, dt_s, slack));
                if lowest.is_nan() || lowest <= 1e-10 {
                    return Verdict::Refuted { dt_s };
                }
                margin = margin.min(lowest);
            }
        }
        Verdict::Proven { margin }
    }

    /// N at one step length, by the matrix exponential.
    fn at(&self, a: &Node, b: &Node, s: f64, dt_s: f64, slack: f64) -> DMatrix<f64> {
        let n = self.r.nrows();
        let gain = &a.gain * (1.0 - s) + &b.gain * s;
        let m = DMatrix::identity(n, n) + &gain * self.c;
        let f = &m * self.r * self.prepared.flow.transition(dt_s) * self.r_inv;
        let (growth, unit) = match self.growth {
            Growth::Decay { alpha } => ((-alpha * dt_s).exp(), -(-alpha * dt_s).exp_m1()),
            Growth::Linear => ((a.growth * (1.0 - s) + b.growth * s) * slack, 1.0),
        };
        let mut out = DMatrix::identity(n, n) - &f * f.transpose() / growth;
        for (i, (x, y)) in a.weights.iter().zip(&b.weights).enumerate() {
            let weight = (x * (1.0 - s) + y * s) * unit * slack;
            let term = match i.checked_sub(self.prepared.process.len()) {
                None => {
                    let mr = &m * self.r;
                    &mr * self.prepared.flow.spread(&self.prepared.process[i], dt_s) * mr.transpose()
                }
                Some(j) => {
                    let lv = &gain * &self.prepared.measurement[j];
                    &lv * lv.transpose()
                }
            };
            out -= term / weight;
        }
        out
    }
}

fn finish(
    prepared: &Prepared<'_>,
    solved: Solved,
    certified: Certified,
    dt_nodes: &[f64],
) -> Result<SampledDesign, DesignError> {
    let Certified { p, p_inv, certificate, .. } = &certified;
    let shadow = projected(p, &prepared.plant.e1);
    let (volume, log_det) = shadow.and_then(|z| volume(&z)).ok_or_else(|| prepared.not_verified("P_z", p))?;
    let outputs = prepared.plant.c.nrows();
    let mut solve_s = solved.seconds;
    let mut partial = Vec::new();
    for mask in 0..(1u32 << outputs) - 1 {
        partial.push(partial_step(prepared, &certified, dt_nodes, mask, &mut solve_s)?);
    }
    Ok(SampledDesign {
        alpha: prepared.alpha,
        dt_s: dt_nodes.to_vec(),
        gains: solved.gains,
        half_widths: half_widths(p_inv),
        p: p.clone(),
        p_inv: p_inv.clone(),
        volume,
        log_det,
        certificate: *certificate,
        partial,
        solve_s,
    })
}

/// The best step with the outputs in `mask`: for the given P, the gain that makes the bound at V = 1, growth + offset,
/// smallest at every node.
fn partial_step(
    prepared: &Prepared<'_>,
    certified: &Certified,
    dt_nodes: &[f64],
    mask: u32,
    solve_s: &mut f64,
) -> Result<PartialStep, DesignError> {
    let n = certified.r.nrows();
    let outputs = prepared.plant.c.nrows();
    let r_inv = super::plant::over(&DMatrix::identity(n, n), &certified.r);
    let used: Vec<usize> = (0..outputs).filter(|j| mask & (1 << j) != 0).collect();
    let mut nodes = Vec::new();
    for &dt in dt_nodes {
        // in the coordinates R·e, where P is the identity
        let mut problem = Problem::new();
        let growth = problem.scalar();
        let mut gain = Affine::zeros(n, outputs);
        if !used.is_empty() {
            let free = problem.matrix(n, used.len());
            let place = DMatrix::from_fn(used.len(), outputs, |i, j| if used[i] == j { 1.0 } else { 0.0 });
            gain = free * &place;
        }
        let corrected = Affine::identity(n) + &gain * &certified.c;
        let motion = &certified.r * prepared.flow.transition(dt) * &r_inv;
        let mut columns = vec![(&corrected * &motion, times_identity(&growth, n))];
        let mut weights = Vec::new();
        let process =
            prepared.process.iter().map(|w| &corrected * &(&certified.r * square_root(&prepared.flow.spread(w, dt))));
        let measurement = prepared.measurement.iter().map(|v| &gain * v);
        for effect in process.chain(measurement) {
            let weight = problem.scalar();
            let size = effect.shape().1;
            columns.push((effect, times_identity(&weight, size)));
            weights.push(weight);
        }
        let (sum, inequality) = step_inequality(columns, &Affine::identity(n), &weights);
        problem.positive(format!("step of {dt} s"), inequality);
        problem.minimize(&sum + &growth);
        // near-optimal is enough here: the proof below decides
        let solution = match problem.solve(&Settings { passes: 1, ..Settings::default() })? {
            Outcome::Optimal(s) | Outcome::Inaccurate { best: Some(s), .. } => s,
            Outcome::Infeasible(why) => {
                return Err(DesignError::Infeasible { alpha: prepared.alpha, why: why.to_string() });
            }
            Outcome::Unbounded(why) => {
                return Err(DesignError::Unbounded { alpha: prepared.alpha, why: why.to_string() });
            }
            Outcome::Inaccurate { reason, .. } => {
                return Err(DesignError::Inaccurate { alpha: prepared.alpha, why: reason });
            }
        };
        *solve_s += solution.seconds;
        nodes.push(Node {
            dt_s: dt,
            gain: solution.value(&gain),
            growth: solution.value(&growth)[(0, 0)],
            weights: weights.iter().map(|w| solution.value(w)[(0, 0)].max(1e-12)).collect(),
        });
    }
    let law = Law { prepared, r: &certified.r, r_inv: &r_inv, c: &certified.c, growth: Growth::Linear };
    let mut failed_at = dt_nodes[0];
    for slack in [1.0 + 1e-6, 1.0 + 1e-4, 1.001, 1.003, 1.01, 1.03, 1.1] {
        match law.check(&nodes, slack) {
            (coverage, Verdict::Proven { .. }) => {
                return Ok(PartialStep {
                    outputs: mask,
                    gains: nodes.iter().map(|k| &r_inv * &k.gain).collect(),
                    growth: nodes.iter().map(|k| k.growth * slack).collect(),
                    offset: nodes.iter().map(|k| k.weights.iter().sum::<f64>() * slack).collect(),
                    coverage,
                });
            }
            (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) => failed_at = dt_s,
        }
    }
    Err(DesignError::BetweenNodes { alpha: prepared.alpha, dt_s: failed_at })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observers::quadratic_bounded::NoiseBlock;
    use nalgebra::dmatrix;

    /// One axis of the online observer: ṗ = u + d + w, ḋ = η; p and d measured.
    fn axis() -> SampledPlant {
        SampledPlant {
            a: dmatrix![0.0, 1.0; 0.0, 0.0],
            process: vec![NoiseBlock::scalar(2, 0, 0.5), NoiseBlock::scalar(2, 1, 10.0)],
            c: dmatrix![1.0, 0.0; 0.0, 1.0],
            measurement: vec![NoiseBlock::scalar(2, 0, 0.3), NoiseBlock::scalar(2, 1, 1.5)],
            e1: dmatrix![0.0, 1.0],
        }
    }

    #[test]
    fn an_axis_is_designed_and_proven() {
        for alpha in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0] {
            let started = std::time::Instant::now();
            match design_sampled(&axis(), alpha, &step_nodes(0.004, 0.1, 8)) {
                Ok(d) => {
                    println!(
                        "α {alpha}: {:?} {:?} solve {:.4} all {:?}",
                        d.half_widths, d.certificate, d.solve_s, started.elapsed()
                    );
                    println!("   L {:?} .. {:?}", d.gains[0].as_slice(), d.gains[7].as_slice());
                    for p in &d.partial {
                        println!("   {:02b} g {:.4?} o {:.4?}", p.outputs, p.growth, p.offset);
                    }
                }
                Err(e) => println!("α {alpha}: {e} {:?}", started.elapsed()),
            }
        }
    }
}
