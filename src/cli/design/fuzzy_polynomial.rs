use super::data;
use super::options::{Rates, Shared, matrix, progress};
use super::sheet::{Compared, Sheet};
use crate::cli::Failure;
use crate::observers::fuzzy_polynomial::{
    Design, DesignError, FITTED_RADIUS2, Gain, Method, Options, PRINTED_RADIUS2, Plant, Record, front, paper, pareto,
    ranked, rig,
};
use crate::report::{Colour, Figure, Panel};
use crate::vehicle;
use nalgebra::DMatrix;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  mavobserver design fuzzy-polynomial
  mavobserver design fuzzy-polynomial --method SOS-2G --alpha 18 --json
  mavobserver design fuzzy-polynomial --plant px4-sih --sample-time 0.02 --method SOS-2G --alpha 3,6,10";

/// Angular speeds from angles and rotors (Pitarch, Sala 2014)
///
/// Solves the paper's linear matrix inequalities (Corollary 1) and sums of squares (Theorem 1) for each strategy and decay
/// rate, checks them outside the solver, and gives the bound on the error's gain in the unit of the paper's Table 2.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Args {
    #[command(flatten)]
    pub shared: Shared,
    #[command(flatten)]
    rates: Rates,
    /// Strategies: LM-D, LM-A, TS-8GD, TS-1GD, TS-1GA, SOS-2G, or all
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_value = "all", value_parser = method)]
    method: Vec<Methods>,
    /// Sample time, s [default: the paper's .005, 0.02 for vehicles]
    #[arg(long, value_name = "S", value_parser = super::options::positive)]
    sample_time: Option<f64>,
    /// Speeds in the region are at most this, rad/s [default: √7.5 for the paper's plant, 3 for vehicles]
    #[arg(long, value_name = "RAD/S", value_parser = super::options::positive)]
    speed: Option<f64>,
    /// The paper's printed region, R² = 3(π/2)², instead of the one its table follows from
    #[arg(long, conflicts_with = "speed")]
    printed_region: bool,
    /// Run every design on this experiment and choose the best: a flight (.tlog), or a CSV file with the columns t, phi,
    /// theta, psi, u1, u2, u3, momentum and, where the speeds are known, p, q, r
    #[arg(long, value_name = "LOG", conflicts_with = "experiment")]
    data: Option<PathBuf>,
    /// Run every design on the paper's experiment in software, as printed or with fast manoeuvres
    #[arg(long, value_name = "printed|fast")]
    experiment: Option<Trial>,
    /// Let the gains of SOS-2G depend linearly on the estimated speeds
    #[arg(long)]
    polynomial_gains: bool,
}

const PAPER_PLANT: &str = "quanser-3dof";

/// The experiment of section 5.2.1.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Trial {
    Printed,
    Fast,
}

/// Start of an experiment that is not scored, s: the observers start at rest.
const SETTLING_S: f64 = 2.0;

/// One name of `--method`.
#[derive(Debug, Clone, Copy)]
enum Methods {
    All,
    One(Method),
}

fn method(text: &str) -> Result<Methods, String> {
    if text.trim().eq_ignore_ascii_case("all") {
        return Ok(Methods::All);
    }
    Method::of_name(text.trim()).map(Methods::One).ok_or_else(|| {
        let known: Vec<&str> = Method::ALL.iter().map(|m| m.name()).collect();
        format!("expected all or one of {}", known.join(", "))
    })
}

impl From<DesignError> for Failure {
    fn from(e: DesignError) -> Self {
        Self::Failed(e.to_string())
    }
}

pub fn run(args: &Args) -> Result<Sheet, Failure> {
    let name = args.shared.plant.as_deref().unwrap_or(PAPER_PLANT);
    let plant = plant(name, args)?;
    let alphas = args.rates.or(&paper::ALPHAS);
    let mut methods: Vec<Method> = Vec::new();
    for m in &args.method {
        match m {
            Methods::All => methods.extend(Method::ALL),
            Methods::One(m) => methods.push(*m),
        }
    }
    methods.sort_unstable();
    methods.dedup();
    let options = Options { polynomial_gains: args.polynomial_gains };
    let bar = progress(methods.len() * alphas.len());
    let made = front(&plant, &methods, &alphas, options, |m, alpha| {
        bar.set_message(format!("{} α = {alpha} 1/s", m.name()));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let record = match (&args.data, args.experiment) {
        (Some(path), _) => Some(data::read(path, args.shared.plant.as_deref(), plant.dt_s)?),
        (None, Some(Trial::Printed)) => Some(rig::Experiment::printed().record(&plant)),
        (None, Some(Trial::Fast)) => Some(rig::Experiment::fast().record(&plant)),
        (None, None) => None,
    };
    let report = Report { name, ranking: ranking(&plant, &made, record.as_ref())?, plant, alphas, methods, made };
    if let [(_, _, Err(only))] = report.made.as_slice() {
        return Err(only.clone().into());
    }
    Ok(report.sheet())
}

/// Table 2.
pub fn published() -> Result<Sheet, Failure> {
    let (methods, alphas) = (Method::ALL.to_vec(), paper::ALPHAS.to_vec());
    let plant = Plant::quanser();
    let bar = progress(methods.len() * alphas.len());
    let made = front(&plant, &methods, &alphas, Options::default(), |_, _| bar.inc(1));
    bar.finish_and_clear();
    Ok(Report { name: PAPER_PLANT, plant, alphas, methods, made, ranking: Vec::new() }.sheet())
}

fn plant(name: &str, args: &Args) -> Result<Plant, Failure> {
    let mut plant = if name == PAPER_PLANT {
        let radius2 = if args.printed_region { PRINTED_RADIUS2 } else { FITTED_RADIUS2 };
        Plant { radius2, ..Plant::quanser() }
    } else {
        Plant::of_vehicle(&vehicle::resolve(name)?, args.sample_time.unwrap_or(0.02))
    };
    plant.dt_s = args.sample_time.unwrap_or(plant.dt_s);
    plant.radius2 = args.speed.map_or(plant.radius2, |v| v * v);
    plant.check().map_err(|e| Failure::Usage(format!("{name}: {e}")))?;
    Ok(plant)
}

/// Methodology II–V: (index of a design, its ISE), the best first.
fn ranking(plant: &Plant, made: &[Made], record: Option<&Record>) -> Result<Vec<(usize, f64)>, Failure> {
    let Some(record) = record else { return Ok(Vec::new()) };
    let designs = || made.iter().filter_map(|m| m.2.as_ref().ok());
    let place = |d: &Design| made.iter().position(|m| m.2.as_ref().is_ok_and(|o| std::ptr::eq(o, d))).unwrap_or(0);
    let ranked = ranked(plant, designs(), record, SETTLING_S).map_err(|e| Failure::Failed(e.to_string()))?;
    Ok(ranked.into_iter().map(|(d, ise)| (place(d), ise)).collect())
}

/// A cell of the table.
type Made = (Method, f64, Result<Design, DesignError>);

/// What was asked for and what came of it.
struct Report<'a> {
    name: &'a str,
    plant: Plant,
    alphas: Vec<f64>,
    methods: Vec<Method>,
    made: Vec<Made>,
    ranking: Vec<(usize, f64)>,
}

impl Report<'_> {
    fn sheet(&self) -> Sheet {
        let p = &self.plant;
        let state = |u: f64| DMatrix::from_fn(6, 6, |i, j| p.linear(u)[(i, j)]);
        let input = DMatrix::from_fn(6, 3, |i, j| if i == 2 * j + 1 { p.dt_s } else { 0.0 });
        let model = json!({
            "states": "angles (rad) and speeds (rad/s) by axis: φ, φ', θ, θ', ψ, ψ'; inputs are angular accelerations",
            "sample_time_s": p.dt_s, "A": [matrix(&state(1.0)), matrix(&state(-1.0))], "B": matrix(&input),
            "C": matrix(&Plant::outputs()), "coriolis": p.coriolis(), "Q": matrix(&(p.driven() / p.dt_s)),
            "R": matrix(&p.noise()), "D": matrix(&p.weights()), "speed_region_squared": p.radius2,
            "premise_speed_rads": p.premise_speed, "sigma": p.mismatch,
        });
        let judged: Vec<Design> = self.designs().filter(|d| d.method.is_judged_on_the_plant()).cloned().collect();
        let best = match self.ranking.first() {
            Some(&(k, _)) => vec![self.any_row(&self.made[k])],
            None => pareto(&judged).into_iter().map(|d| self.row(d)).collect(),
        };
        Sheet {
            observer: "fuzzy-polynomial",
            plant: self.name.to_owned(),
            more: [("model".to_owned(), model)].into_iter().collect(),
            rows: self.made.iter().map(|m| self.any_row(m)).collect(),
            selected: best,
            text: self.text(),
            paper: "Pitarch, Sala: Multicriteria fuzzy-polynomial observer design for a 3DoF nonlinear electromechanical \
                    platform (2014)",
            figures: vec![(
                self.figure(),
                "The front: lower is better, further right is faster. Dots are published.".into(),
            )],
            compared: self.compared(),
            corrections: paper::CORRECTIONS,
        }
    }

    fn figure(&self) -> Figure {
        let mut panel = Panel::new("Bound on the error's gain, 1000·√γ", "").log_y().height(320);
        for (k, &m) in self.methods.iter().enumerate() {
            let of = || self.designs().filter(move |d| d.method == m);
            panel = panel.line(m.name(), Colour::nth(k + 1), of().map(|d| [d.alpha, d.table_value()]));
            let published: Vec<[f64; 2]> = of().filter_map(|d| Some([d.alpha, self.published(m, d.alpha)?])).collect();
            if !published.is_empty() {
                panel = panel.points("", Colour::nth(k + 1), published);
            }
        }
        Figure::new(format!("Designs for {}", self.name)).x("decay rate α", "1/s").panel(panel)
    }

    /// Every cell that the paper prints; one without a design stands there as not a number, and so agrees with nothing.
    fn compared(&self) -> Vec<Compared> {
        let one = |(method, alpha, made): &Made| {
            let tolerance = match method {
                Method::LinearAnalysis => 0.03,
                Method::EightGains | Method::OneGain => 5e-4,
                _ => 1e-3,
            };
            let reference = Some(self.published(*method, *alpha)?);
            let what = format!("{}, α = {alpha}", method.name());
            Some(Compared { what, ours: made.as_ref().map_or(f64::NAN, Design::table_value), reference, tolerance })
        };
        self.made.iter().filter_map(one).collect()
    }

    fn designs(&self) -> impl Iterator<Item = &Design> {
        self.made.iter().filter_map(|(_, _, d)| d.as_ref().ok())
    }

    fn any_row(&self, (method, alpha, made): &Made) -> Value {
        match made {
            Ok(d) => self.row(d),
            // an empty cell of the table says why
            Err(e) => json!({ "method": method.name(), "alpha": alpha, "verified": false, "error": e.to_string() }),
        }
    }

    /// The ISE of a design on the experiment, rad²/s.
    fn ise(&self, d: &Design) -> Option<f64> {
        let of = |k: usize| self.made[k].2.as_ref().is_ok_and(|o| std::ptr::eq(o, d));
        self.ranking.iter().find(|(k, _)| of(*k)).map(|r| r.1)
    }

    fn row(&self, d: &Design) -> Value {
        let gain = |g: &Gain| {
            json!({
                "momentum": g.momentum, "premises": g.premises, "L": matrix(&g.constant),
                "L_by_speed": g.by_speed.iter().map(matrix).collect::<Vec<_>>(),
            })
        };
        let mut row = json!({
            "method": d.method.name(), "alpha": d.alpha, "value": d.table_value(),
            "gains": d.gains.iter().map(gain).collect::<Vec<_>>(), "P": matrix(&d.p),
            "verified": true, "margin": d.margin, "solve_s": d.solve_s,
        });
        if let Some(published) = self.published(d.method, d.alpha) {
            row["published"] = json!(published);
        }
        if let Some(ise) = self.ise(d) {
            row["ise"] = json!(ise);
        }
        row
    }

    /// The table's value, where the paper has one.
    fn published(&self, method: Method, alpha: f64) -> Option<f64> {
        let at = paper::ALPHAS.iter().position(|a| *a == alpha)?;
        (self.plant == Plant::quanser()).then(|| paper::table_2(method)[at])
    }

    fn text(&self) -> String {
        let mut out = String::new();
        // writing to a String cannot fail
        let _ = self.write(&mut out);
        out.trim_end().to_owned()
    }

    fn write(&self, out: &mut String) -> std::fmt::Result {
        writeln!(out, "fuzzy-polynomial for {}: 1000·√γ by strategy and decay rate α, 1/s\n", self.name)?;
        write!(out, "{:<8}", "α")?;
        self.alphas.iter().try_for_each(|a| write!(out, "{a:>9}"))?;
        writeln!(out)?;
        let mut refused = Vec::new();
        for &m in &self.methods {
            write!(out, "{:<8}", m.name())?;
            for (_, _, d) in self.made.iter().filter(|x| x.0 == m) {
                match d {
                    Ok(d) => write!(out, "{:>9.3}", d.table_value())?,
                    Err(e) => {
                        write!(out, "{:>9}", "—")?;
                        refused.push(e.to_string());
                    }
                }
            }
            writeln!(out)?;
            let printed: Vec<f64> = self.alphas.iter().filter_map(|&a| self.published(m, a)).collect();
            if printed.len() == self.alphas.len() {
                write!(out, "{:<8}", "  paper")?;
                printed.iter().try_for_each(|v| write!(out, "{v:>9}"))?;
                writeln!(out)?;
            }
        }
        if !self.ranking.is_empty() {
            writeln!(out, "\nintegral square error on the experiment, rad²/s: the best first")?;
            for (k, ise) in self.ranking.iter().take(10) {
                writeln!(out, "{:>12.4e}  {} at α = {}", ise, self.made[*k].0.name(), self.made[*k].1)?;
            }
        }
        refused.iter().try_for_each(|e| writeln!(out, "\n{e}"))?;
        let margin = self.designs().map(|d| d.margin).fold(f64::INFINITY, f64::min);
        let seconds: f64 = self.designs().map(|d| d.solve_s).sum();
        if margin.is_finite() {
            writeln!(
                out,
                "\nevery value holds by a check outside the solver (smallest margin {margin:.0e}); {seconds:.1} s in the solver"
            )?;
        }
        for d in self.designs().filter(|_| self.made.len() == 1) {
            for g in &d.gains {
                write!(out, "\ngain at rotor momentum {}", g.momentum)?;
                writeln!(
                    out,
                    "{}",
                    g.premises.map_or(String::new(), |p| format!(", premises {:.3} {:.3} rad/s", p[0], p[1]))
                )?;
                for row in g.constant.row_iter() {
                    writeln!(out, "{:>10.4} {:>10.4} {:>10.4}", row[0], row[1], row[2])?;
                }
            }
        }
        Ok(())
    }
}
