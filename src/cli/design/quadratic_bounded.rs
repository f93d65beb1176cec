use super::options::{Rates, Shared, matrix, positive, progress, share, three};
use super::sheet::{Compared, Sheet};
use crate::cli::Failure;
use crate::observers::quadratic_bounded::{
    ContinuousDesign, DesignError, Plant, TradeOff, choose_rates, declared_plant, design_continuous, front, paper,
    projected,
};
use crate::report::{Colour, Figure, Panel};
use crate::sdp::in_parallel;
use crate::vehicle;
use nalgebra::DMatrix;
use serde_json::{Map, Value, json};
use std::fmt::Write;

const EXAMPLES: &str = "Examples:
  mavobserver design quadratic-bounded
  mavobserver design quadratic-bounded --alpha 0.1,1,10 --json
  mavobserver design quadratic-bounded --plant px4-sih --mu 0.2,0.95";

/// Wrench with an ellipsoidal bound (Cayero, Rotondo, Morcego, Puig 2019)
///
/// Solves the paper's LMI for each convergence rate, checks it by eigenvalues outside the solver, and gives the volume of
/// the ellipsoid that holds the error of the wrench. The designs are the paper's, for continuous measurements; what
/// runs online is designed for sampled data when it starts.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    pub shared: Shared,
    #[command(flatten)]
    rates: Rates,
    /// Order of the disturbance model: which derivative of the wrench is bounded [default: 3 for the paper's plant, 1 for
    /// others]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=6))]
    r: Option<u8>,
    /// Trade-offs from 0 (fast) to 1 (tight): for each, the rate with the least cost is chosen
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = share)]
    mu: Vec<f64>,
    /// Fastest rate a trade-off considers, 1/s
    #[arg(long, value_name = "RATE", default_value_t = 20.0, value_parser = positive)]
    fastest: f64,
}

const PAPER_PLANT: &str = "cayero-hummingbird";

impl From<DesignError> for Failure {
    fn from(e: DesignError) -> Self {
        Self::Failed(e.to_string())
    }
}

/// What was asked for and what came of it.
struct Report<'a> {
    name: &'a str,
    order: u8,
    plant: Plant,
    rows: Vec<ContinuousDesign>,
    trade_off: Option<TradeOff>,
    /// (μ, design).
    selected: Vec<(f64, ContinuousDesign)>,
    /// (α, volume) for the pictures; may be empty.
    front: Vec<(f64, f64)>,
}

pub fn run(args: &Args) -> Result<Sheet, Failure> {
    let name = args.shared.plant.as_deref().unwrap_or(PAPER_PLANT);
    let (order, plant) = plant(name, args.r)?;
    let (alphas, mus) = match (args.rates.alpha.as_slice(), args.mu.as_slice()) {
        ([], []) => (vec![0.1, 0.17, 1.0, 2.0, 10.0], vec![0.95, 0.2]),
        (alphas, mus) => (alphas.to_vec(), mus.to_vec()),
    };
    let bar = progress(alphas.len() + mus.len());
    let design = |alpha: f64| {
        bar.set_message(format!("α = {alpha:.4} 1/s"));
        let made = design_continuous(&plant, alpha);
        bar.inc(1);
        made
    };
    let mut rows = alphas.iter().map(|&alpha| design(alpha)).collect::<Result<Vec<_>, _>>()?;
    let mut trade_off = None;
    let mut selected = Vec::new();
    if !mus.is_empty() {
        let (ends, rates) = choose_rates(&plant, args.fastest, &mus)?;
        trade_off = Some(ends);
        for (&mu, alpha) in mus.iter().zip(rates) {
            selected.push((mu, design(alpha)?));
        }
    }
    if rows.is_empty() {
        rows = selected.iter().map(|(_, d)| d.clone()).collect();
    }
    bar.finish_and_clear();
    let front = if args.shared.plot.is_some() { front(&plant, args.fastest, FRONT)? } else { Vec::new() };
    Ok(Report { name, order, plant, rows, trade_off, selected, front }.sheet())
}

/// Rates of a drawn front.
const FRONT: usize = 120;
/// Rates up to which the paper looks, 1/s.
const FASTEST: f64 = 20.0;

/// Volumes that an independent solution of (31) gives for the paper's plant; the paper itself only draws them.
const REFERENCE: [(f64, f64); 6] =
    [(0.05, 0.0329), (0.1, 0.01032), (0.17, 0.00726), (1.0, 0.7596), (2.0, 14.14), (10.0, 2659.9)];

/// The paper's section 4: Figs. 4 to 6.
pub fn published() -> Result<Sheet, Failure> {
    let order = paper::PAPER_ORDER;
    let plant = paper::hummingbird(order);
    let rates: Vec<f64> = REFERENCE.iter().map(|r| r.0).collect();
    let rows =
        in_parallel(&rates, |&alpha| design_continuous(&plant, alpha)).into_iter().collect::<Result<Vec<_>, _>>()?;
    let mus = [0.95, 0.2];
    let (ends, chosen) = choose_rates(&plant, FASTEST, &mus)?;
    let mut selected = Vec::new();
    for (mu, alpha) in mus.into_iter().zip(chosen) {
        selected.push((mu, design_continuous(&plant, alpha)?));
    }
    let front = front(&plant, FASTEST, FRONT)?;
    let compared = |what: String, ours, reference| Compared { what, ours, reference: Some(reference), tolerance: 0.01 };
    let mut table: Vec<Compared> =
        rows.iter().zip(REFERENCE).map(|(d, (alpha, v))| compared(format!("Vol({alpha})"), d.volume, v)).collect();
    table.push(compared("α of the smallest volume".into(), ends.smallest.0, 0.173));
    table.push(Compared { tolerance: 0.02, ..compared("α for μ = .95".into(), selected[0].1.alpha, 2.77) });
    table.push(Compared { tolerance: 0.02, ..compared("Vol for μ = .95".into(), selected[0].1.volume, 45.8) });
    table.push(compared("α for μ = .2".into(), selected[1].1.alpha, FASTEST));
    let report = Report {
        name: PAPER_PLANT,
        order: order as u8,
        plant: plant.clone(),
        rows,
        trade_off: Some(ends),
        selected,
        front,
    };
    Ok(Sheet { compared: table, ..report.sheet() })
}

/// The plant and its order.
fn plant(name: &str, order: Option<u8>) -> Result<(u8, Plant), Failure> {
    if name == PAPER_PLANT {
        let order = order.unwrap_or(paper::PAPER_ORDER as u8);
        return Ok((order, paper::hummingbird(usize::from(order))));
    }
    let vehicle = vehicle::resolve(name)?;
    match order {
        None | Some(1) => Ok((1, declared_plant(&vehicle))),
        Some(r) => Err(Failure::Usage(format!(
            "`{name}` declares how fast its wrench may change, but no higher derivative: r = {r} is for {PAPER_PLANT} only"
        ))),
    }
}

impl Report<'_> {
    fn sheet(&self) -> Sheet {
        let p = &self.plant;
        let n = p.a.nrows();
        let model = json!({
            "states": format!("momenta (3 linear, 3 spin), wrench, and its derivatives up to order {}", self.order - 1),
            "A": matrix(&p.a), "B": matrix(&DMatrix::identity(n, 6)), "C": matrix(&p.c), "E1": matrix(&p.e1),
            "W1": matrix(&p.w1), "W2": matrix(&p.w2), "Q1": matrix(&p.q1), "Q2": matrix(&p.q2),
        });
        let end = |(alpha, volume): (f64, f64)| json!({ "alpha": alpha, "volume": volume });
        let ends = self.trade_off.map(|t| json!({ "smallest": end(t.smallest), "fastest": end(t.fastest) }));
        let more = [("order", json!(self.order)), ("model", model), ("trade_off", json!(ends))];
        let chosen = |(mu, d): &(f64, ContinuousDesign)| {
            let mut row = self.row(d);
            row.insert("mu".into(), json!(mu));
            Value::Object(row)
        };
        Sheet {
            observer: "quadratic-bounded",
            plant: self.name.to_owned(),
            more: more.into_iter().map(|(k, v)| (k.to_owned(), v)).collect(),
            rows: self.rows.iter().map(|d| Value::Object(self.row(d))).collect(),
            selected: self.selected.iter().map(chosen).collect(),
            text: self.text(),
            paper: "Cayero, Rotondo, Morcego, Puig: Optimal state observation using quadratic boundedness: application to \
                    UAV disturbance estimation (2019)",
            figures: self.figures(),
            corrections: paper::CORRECTIONS,
            ..Sheet::default()
        }
    }

    /// Figs. 4 to 6 of the paper, and the ellipsoids.
    fn figures(&self) -> Vec<(Figure, String)> {
        let mut all = Vec::new();
        if let (Some(t), false) = (self.trade_off.or_else(|| TradeOff::of(&self.front)), self.front.is_empty()) {
            let rate = |title: &str| Figure::new(title).x("convergence rate α", "1/s").log_x();
            let at = self.rows.iter().chain(self.selected.iter().map(|s| &s.1));
            let volume = Panel::new("Volume of the ellipsoid of the wrench's error", "N³(N m)³")
                .log_y()
                .line("smallest at this rate", Colour::Blue, self.front.iter().map(|&(a, v)| [a, v]))
                .points("designs, verified", Colour::Orange, at.map(|d| [d.alpha, d.volume]));
            let cost = [0.05, 0.2, 0.5, 0.8, 0.95, 0.99].into_iter().enumerate().fold(
                Panel::new("Cost J_μ (eq. 25)", "").range_y(0.0, 1.0),
                |panel, (k, mu)| {
                    let line = self.front.iter().map(move |&(a, v)| [a, t.cost(mu, (a, v))]);
                    panel.line(format!("μ = {mu}"), Colour::nth(k + 1), line)
                },
            );
            all.push((
                rate("Volume and cost by convergence rate").panel(volume).panel(cost),
                "The paper's Figs. 4 and 5: what a faster observer costs.".to_owned(),
            ));
            let chosen: Vec<(f64, (f64, f64))> = (0..=100)
                .filter_map(|k| Some((f64::from(k) * 0.01, t.choose(f64::from(k) * 0.01, &self.front)?)))
                .collect();
            let rate = Panel::new("Chosen rate", "1/s").line("", Colour::Blue, chosen.iter().map(|c| [c.0, c.1.0]));
            let volume = Panel::new("Its volume", "N³(N m)³").log_y().line(
                "",
                Colour::Blue,
                chosen.iter().map(|c| [c.0, c.1.1]),
            );
            all.push((
                Figure::new("Choice by μ").x("μ: from fast to tight", "").panel(rate).panel(volume),
                "The paper's Fig. 6.".to_owned(),
            ));
        }
        let designs: Vec<&ContinuousDesign> = if self.selected.is_empty() {
            self.rows.iter().collect()
        } else {
            self.selected.iter().map(|s| &s.1).collect()
        };
        for (title, unit, [i, j]) in [("Force", "N", [0, 1]), ("Torque", "N m", [3, 4])] {
            let panel =
                designs.iter().enumerate().fold(Panel::new(title, unit).equal().height(320), |panel, (k, d)| {
                    let label = format!("α = {}", three(d.alpha));
                    panel.outline(label, Colour::nth(k + 1), shadow(d, i, j))
                });
            all.push((
                Figure::new("").x(format!("{title} along x"), unit).panel(panel.clone()),
                format!(
                    "Shadow of the error's ellipsoid on {} x and y: where it ends when all disturbances stay bounded.",
                    title.to_lowercase()
                ),
            ));
        }
        all
    }

    /// A and C are the plant's; the observer's own matrix is `closed_loop` = A + gain·C.
    fn row(&self, d: &ContinuousDesign) -> Map<String, Value> {
        let fields = [
            ("alpha", json!(d.alpha)),
            ("volume", json!(d.volume)),
            ("log_det", json!(d.log_det)),
            ("half_widths", json!(d.half_widths)),
            ("gain", matrix(&d.gain)),
            ("A", matrix(&self.plant.a)),
            ("C", matrix(&self.plant.c)),
            ("closed_loop", matrix(&(&self.plant.a + &d.gain * &self.plant.c))),
            ("P", matrix(&d.p)),
            // a design that fails its check is an error, not a row
            ("verified", json!(true)),
            ("margin", json!(d.margin)),
            ("solve_s", json!(d.solve_s)),
        ];
        fields.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn text(&self) -> String {
        let mut out = String::new();
        // writing to a String cannot fail
        let _ = self.write(&mut out);
        out.trim_end().to_owned()
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        let (n, outputs) = (self.plant.a.nrows(), self.plant.c.nrows());
        writeln!(out, "quadratic-bounded for {}: r = {}, {n} states, {outputs} outputs", self.name, self.order)?;
        writeln!(out, "V = eᵀPe ≤ 1 + (V₀ − 1)e^(−αt) while all disturbances stay in their ellipsoid\n")?;
        writeln!(out, "  α 1/s     volume    force ± N           torque ± N m            margin  solve s")?;
        let per_axis = |w: &[f64]| w.iter().map(|x| three(*x)).collect::<Vec<_>>().join(" ");
        for d in &self.rows {
            let (force, torque) = d.half_widths.split_at(d.half_widths.len().min(3));
            writeln!(
                out,
                "{:>7.4} {:>10.4e}  {:<19} {:<22} {:>7.0e}  {:>7.2}",
                d.alpha,
                d.volume,
                per_axis(force),
                per_axis(torque),
                d.margin,
                d.solve_s
            )?;
        }
        writeln!(out, "\nevery row satisfies inequality (7) by eigenvalues computed outside the solver")?;
        if let Some(t) = self.trade_off {
            let ((slow, least), (fast, most)) = (t.smallest, t.fastest);
            writeln!(out, "\nsmallest volume {least:.4e} at α = {slow:.3}; {most:.4e} at α = {fast:.3} (fastest)")?;
        }
        for (mu, d) in &self.selected {
            writeln!(out, "μ = {mu}: α = {:.4} 1/s, volume {:.4e}", d.alpha, d.volume)?;
        }
        Ok(())
    }
}

/// Outline of the ellipsoid of z seen along all axes but two.
fn shadow(d: &ContinuousDesign, i: usize, j: usize) -> Vec<[f64; 2]> {
    let pick = DMatrix::from_fn(2, d.p_z.ncols(), |r, c| if c == [i, j][r] { 1.0 } else { 0.0 });
    // {v: vᵀMv ≤ 1} is the image of the unit circle under L⁻ᵀ, M = L·Lᵀ
    let root = projected(&d.p_z, &pick).and_then(|m| m.cholesky()).and_then(|c| c.l().transpose().try_inverse());
    let Some(root) = root else { return Vec::new() };
    let point = |k: u32| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 90.0).sin_cos();
        [root[(0, 0)] * cos + root[(0, 1)] * sin, root[(1, 0)] * cos + root[(1, 1)] * sin]
    };
    (0..90).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_order_that_nothing_bounds_is_a_usage_error() {
        assert!(matches!(plant("px4-sih", Some(3)), Err(Failure::Usage(_))));
        assert_eq!(plant("px4-sih", None).unwrap().0, 1);
        assert_eq!(plant(PAPER_PLANT, None).unwrap().0, 3);
    }
}
