use super::certify::{Coverage, Frame, Growth, Node, Verdict};
use super::detect::unseen_motion;
use super::flow::Flow;
use super::plant::{PlantError, SampledPlant, half_widths, projected, volume};
use super::synthesis;
use super::tradeoff::TradeOff;
use crate::sdp::{Outcome, ProblemError, verify};
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
    #[error("more than {most} outputs: {found}")]
    TooManyOutputs { found: usize, most: usize },
    #[error("no observer converges at α = {alpha} 1/s: {why}")]
    Infeasible { alpha: f64, why: String },
    #[error("the bound at α = {alpha} 1/s can be made as small as one likes, a disturbance is missing: {why}")]
    Unbounded { alpha: f64, why: String },
    #[error("the solver gave no trustworthy design at α = {alpha} 1/s: {why}")]
    Inaccurate { alpha: f64, why: String },
    #[error("the design at α = {alpha} 1/s failed its check: {what} has margin {margin:.1e}")]
    NotVerified { alpha: f64, what: String, margin: f64 },
    #[error("the design at α = {alpha} 1/s does not hold at a step of {dt_s} s, between its nodes")]
    BetweenNodes { alpha: f64, dt_s: f64 },
}

impl DesignError {
    /// Why an outcome is no design of (A, C) at α.
    pub(super) fn refusal(a: &DMatrix<f64>, c: &DMatrix<f64>, alpha: f64, outcome: Outcome) -> Self {
        if let Some(why) = unseen_motion(a, c, alpha) {
            return Self::Infeasible { alpha, why };
        }
        match outcome {
            Outcome::Infeasible(why) => Self::Infeasible { alpha, why: why.to_string() },
            Outcome::Unbounded(why) => Self::Unbounded { alpha, why: why.to_string() },
            Outcome::Inaccurate { reason, .. } => Self::Inaccurate { alpha, why: reason },
            Outcome::Optimal(_) => Self::Inaccurate { alpha, why: "an optimum was refused".into() },
        }
    }
}

/// The independent check of a sampled design.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    pub coverage: Coverage,
    /// Smallest eigenvalue of N(δ) (see `certify`) over the step lengths, in coordinates in which P is the identity.
    pub margin: f64,
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
    /// The multipliers that prove it, by node: one per process block, then one per output block. They sum to `offset`.
    pub weights: Vec<Vec<f64>>,
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
    pub a: DMatrix<f64>,
    pub c: DMatrix<f64>,
    /// The nodes, s, rising.
    pub dt_s: Vec<f64>,
    /// L by node, n×p, with the paper's sign (A + LC).
    pub gains: Vec<DMatrix<f64>>,
    pub p: DMatrix<f64>,
    pub p_inv: DMatrix<f64>,
    /// √((P⁻¹)ᵢᵢ), the half-width of each state at V = 1.
    pub half_widths: Vec<f64>,
    /// (C·P⁻¹·Cᵀ)ⱼⱼ: the square of output j's half-width at V = 1, its own noise left out.
    pub output_spread: Vec<f64>,
    /// Volume and log det P_z of the ellipsoid of z = E₁x at V = 1.
    pub volume: f64,
    pub log_det: f64,
    pub certificate: Certificate,
    /// The multipliers that prove it, by node, as shares of 1 − e^{−αδ}.
    pub shares: Vec<Vec<f64>>,
    /// One for every proper subset of the outputs, indexed by its bit mask.
    pub partial: Vec<PartialStep>,
    /// Time in the solver, s; zero for a design from the cache.
    pub solve_s: f64,
}

impl SampledDesign {
    /// The longest step for which the design is certified, s.
    pub fn longest_step_s(&self) -> f64 {
        // a design has at least one node
        self.dt_s[self.dt_s.len() - 1]
    }

    /// The node below a step length and how far (0..1) it lies towards the next. Outside the nodes the nearest.
    fn locate(&self, dt_s: f64) -> (usize, usize, f64) {
        let last = self.dt_s.len() - 1;
        let next = self.dt_s.partition_point(|&x| x < dt_s).min(last);
        let k = next.saturating_sub(1);
        let span = self.dt_s[next] - self.dt_s[k];
        let s = if span > 0.0 { ((dt_s - self.dt_s[k]) / span).clamp(0.0, 1.0) } else { 0.0 };
        (k, next, s)
    }

    /// L(δ) into `gain`, n×p. The certificate covers steps from the first node to the last.
    pub fn gain_at(&self, dt_s: f64, gain: &mut DMatrix<f64>) {
        let (k, next, s) = self.locate(dt_s);
        mix(&self.gains[k], &self.gains[next], s, gain);
    }

    /// The gain of a step in which only the outputs of a bit mask came, as [`Self::gain_at`].
    pub fn partial_gain_at(&self, outputs: u32, dt_s: f64, gain: &mut DMatrix<f64>) {
        match self.partial.get(outputs as usize) {
            Some(step) => {
                let (k, next, s) = self.locate(dt_s);
                mix(&step.gains[k], &step.gains[next], s, gain);
            }
            None => self.gain_at(dt_s, gain),
        }
    }

    /// (growth, offset) with V⁺ ≤ growth·V + offset after a pure prediction over any time, s.
    ///
    /// Below the first node its values serve, beyond the last node the time is covered in several steps.
    pub fn prediction_growth(&self, dt_s: f64) -> (f64, f64) {
        let longest = self.longest_step_s();
        let (mut growth, mut offset) = (1.0, 0.0);
        // so long a gap has no bound that is of use to anyone, nor has one of unknown length
        if dt_s.is_nan() || dt_s > 1000.0 * longest {
            return (f64::INFINITY, f64::INFINITY);
        }
        let mut left = dt_s;
        while left > 0.0 {
            let (g, o) = self.partial_growth(0, left.min(longest));
            (growth, offset) = (g * growth, g * offset + o);
            left -= longest;
        }
        (growth, offset)
    }

    /// (growth, offset) of a step, no longer than the last node, in which only the outputs of a bit mask came.
    ///
    /// With all outputs it is the decay of the certificate.
    pub fn partial_growth(&self, outputs: u32, dt_s: f64) -> (f64, f64) {
        match self.partial.get(outputs as usize) {
            Some(step) => {
                let (k, next, s) = self.locate(dt_s);
                let between = |v: &[f64]| v[k] + s * (v[next] - v[k]);
                (between(&step.growth), between(&step.offset))
            }
            None => {
                let decay = (-self.alpha * dt_s).exp();
                (decay, 1.0 - decay)
            }
        }
    }
}

fn mix(a: &DMatrix<f64>, b: &DMatrix<f64>, s: f64, out: &mut DMatrix<f64>) {
    for ((out, a), b) in out.iter_mut().zip(a.iter()).zip(b.iter()) {
        *out = a + s * (b - a);
    }
}

/// `count` step lengths from `shortest` to `longest`, in equal ratios.
pub fn step_nodes(shortest_s: f64, longest_s: f64, count: usize) -> Vec<f64> {
    let at = |k: usize| match k {
        0 => shortest_s,
        _ if k + 1 == count => longest_s,
        _ => shortest_s * (longest_s / shortest_s).powf(k as f64 / (count - 1) as f64),
    };
    if count == 1 { vec![longest_s] } else { (0..count).map(at).collect() }
}

/// The most outputs a design takes: it holds a step for every subset of them.
const MOST_OUTPUTS: usize = 6;

/// A checked plant in the form the design works with.
#[derive(Debug)]
pub(super) struct Prepared<'a> {
    pub(super) plant: &'a SampledPlant,
    pub(super) flow: Flow,
    /// Unit-ball factors of the disturbances.
    pub(super) process: Vec<DMatrix<f64>>,
    pub(super) output: Vec<DMatrix<f64>>,
    pub(super) alpha: f64,
}

impl<'a> Prepared<'a> {
    pub(super) fn new(plant: &'a SampledPlant, alpha: f64, nodes: &[f64]) -> Result<Self, DesignError> {
        let (process, output) = plant.units()?;
        if !alpha.is_finite() || alpha <= 0.0 {
            return Err(DesignError::Rate(alpha));
        }
        let rising = nodes.windows(2).all(|w| w[0] < w[1]);
        if nodes.is_empty() || !rising || nodes.iter().any(|d| !d.is_finite() || *d <= 0.0) {
            return Err(DesignError::Steps);
        }
        let outputs = plant.c.nrows();
        if outputs > MOST_OUTPUTS {
            return Err(DesignError::TooManyOutputs { found: outputs, most: MOST_OUTPUTS });
        }
        Ok(Self { plant, flow: Flow::new(&plant.a), process, output, alpha })
    }

    pub(super) fn refusal(&self, outcome: Outcome) -> DesignError {
        DesignError::refusal(&self.plant.a, &self.plant.c, self.alpha, outcome)
    }

    fn not_verified(&self, what: &str, m: &DMatrix<f64>) -> DesignError {
        DesignError::NotVerified { alpha: self.alpha, what: what.into(), margin: verify::margin(m) }
    }

    pub(super) fn frame(&self, p: &DMatrix<f64>) -> Result<Frame<'_>, DesignError> {
        Frame::new(p, &self.flow, &self.plant.c, &self.process, &self.output).ok_or_else(|| self.not_verified("P", p))
    }

    /// The numbers of full masks: one for each proper subset of the outputs.
    pub(super) fn subsets(&self) -> std::ops::Range<u32> {
        0..(1 << self.plant.c.nrows()) - 1
    }
}

/// The numbers that make a design; everything else follows from them and is recomputed, and proven, from them.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Core {
    pub(super) nodes: Vec<f64>,
    pub(super) p: DMatrix<f64>,
    pub(super) gains: Vec<DMatrix<f64>>,
    pub(super) shares: Vec<Vec<f64>>,
    pub(super) partial: Vec<PartialStep>,
}

/// Proves the decay law of a core, whatever its origin.
pub(super) fn prove_decay(prepared: &Prepared<'_>, frame: &Frame<'_>, core: &Core) -> (Coverage, Verdict) {
    let nodes: Vec<Node> = core
        .nodes
        .iter()
        .zip(core.gains.iter().zip(&core.shares))
        .map(|(&dt_s, (l, w))| Node { dt_s, gain: frame.gain(l), growth: 1.0, weights: w.clone() })
        .collect();
    frame.prove(&nodes, Growth::Decay { alpha: prepared.alpha })
}

/// Proves what a partial step says about itself, over all step lengths from zero (prediction) or the first node on.
pub(super) fn prove_partial(frame: &Frame<'_>, nodes: &[f64], step: &PartialStep) -> (Coverage, Verdict) {
    let at = |k: usize, dt_s: f64| Node {
        dt_s,
        gain: frame.gain(&step.gains[k]),
        growth: step.growth[k],
        weights: step.weights[k].clone(),
    };
    let mut all: Vec<Node> = nodes.iter().enumerate().map(|(k, &dt)| at(k, dt)).collect();
    if step.outputs == 0 {
        all.insert(0, at(0, 0.0));
    }
    frame.prove(&all, Growth::Linear)
}

/// Proves a core in every part and completes it to a design.
pub(super) fn complete(prepared: &Prepared<'_>, core: Core, solve_s: f64) -> Result<SampledDesign, DesignError> {
    let alpha = prepared.alpha;
    let frame = prepared.frame(&core.p)?;
    let (coverage, margin) = match prove_decay(prepared, &frame, &core) {
        (coverage, Verdict::Proven { margin }) => (coverage, margin),
        (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) => {
            return Err(DesignError::BetweenNodes { alpha, dt_s });
        }
    };
    for step in &core.partial {
        if let (_, Verdict::Refuted { dt_s } | Verdict::Open { dt_s }) = prove_partial(&frame, &core.nodes, step) {
            return Err(DesignError::BetweenNodes { alpha, dt_s });
        }
    }
    let p_inv = frame.p_inverse();
    let plant = prepared.plant;
    let shadow = projected(&core.p, &plant.e1).and_then(|z| volume(&z));
    let (volume, log_det) = shadow.ok_or_else(|| prepared.not_verified("P_z", &core.p))?;
    Ok(SampledDesign {
        alpha,
        a: plant.a.clone(),
        c: plant.c.clone(),
        half_widths: half_widths(&p_inv),
        output_spread: (&plant.c * &p_inv * plant.c.transpose()).diagonal().iter().copied().collect(),
        p_inv,
        volume,
        log_det,
        certificate: Certificate { coverage, margin },
        dt_s: core.nodes,
        gains: core.gains,
        p: core.p,
        shares: core.shares,
        partial: core.partial,
        solve_s,
    })
}

/// Designs the sampled observer at a convergence rate α (1/s) for every step length from the first of `nodes` (s) to the
/// last: the smallest ellipsoid of z that all steps share, with a gain for each node. Where the interpolated gain does
/// not hold between two nodes, nodes are added.
///
/// # Errors
/// A plant or nodes that do not fit, no observer at this rate, or a design that did not survive its check.
pub fn design_sampled(plant: &SampledPlant, alpha: f64, nodes: &[f64]) -> Result<SampledDesign, DesignError> {
    let mut nodes = nodes.to_vec();
    let mut failure = None;
    // each round doubles the density of the nodes
    for _ in 0..3 {
        let prepared = Prepared::new(plant, alpha, &nodes)?;
        match synthesis::synthesise(&prepared, &nodes) {
            Ok((core, solve_s)) => return complete(&prepared, core, solve_s),
            Err(e @ DesignError::BetweenNodes { .. }) if nodes.len() > 1 => failure = Some(e),
            Err(e) => return Err(e),
        }
        let between = nodes.windows(2).map(|w| (w[0] * w[1]).sqrt());
        let mut denser: Vec<f64> = nodes.iter().copied().chain(between).collect();
        denser.sort_by(f64::total_cmp);
        nodes = denser;
    }
    Err(failure.unwrap_or(DesignError::Steps))
}

/// The rate of a list with the least J_μ (eq. 21) for the sampled observer, and every (α, volume) that has a design.
///
/// # Errors
/// That of the slowest rate when none of them has a design.
pub fn choose_rate(
    plant: &SampledPlant,
    rates: &[f64],
    nodes: &[f64],
    mu: f64,
) -> Result<(f64, Vec<(f64, f64)>), DesignError> {
    let mut front = Vec::new();
    let mut refused = DesignError::Rate(f64::NAN);
    for &alpha in rates {
        match synthesis::volume_at(&Prepared::new(plant, alpha, nodes)?, nodes) {
            Ok(volume) => front.push((alpha, volume)),
            Err(e) => refused = e,
        }
    }
    let chosen = TradeOff::of(&front).and_then(|t| t.choose(mu, &front)).ok_or(refused)?;
    Ok((chosen.0, front))
}

#[cfg(test)]
mod tests;
