use super::options::{Rates, Shared, matrix, positive, progress, share, three};
use super::sheet::Sheet;
use crate::cli::Failure;
use crate::observers::quadratic_bounded::{
    ContinuousDesign, DesignError, Plant, TradeOff, choose_rates, declared_plant, design_continuous, paper,
};
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
    Ok(Report { name, order, plant, rows, trade_off, selected }.sheet())
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
        }
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
