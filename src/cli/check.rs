mod links;
mod live;

use super::config_args::LoadErrors;
use super::{ConfigArgs, Failure, print};
use crate::config::{Config, ConfigError, Link, LinkUrl};
use crate::document::Issue;
use crate::observers::{BuildError, build};
use crate::vehicle::{Facts, Vehicle, VehicleError};
use serde_json::{Value, json};
use std::fmt::Write;
use std::time::Instant;

/// Check a config and vehicle models, and say what would run
///
/// Every problem is reported at once, with its place in the file and what to do about it. With a config the observers
/// are also designed for each vehicle, as a run would.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  mavobserver check -c flight.toml
  mavobserver check --vehicle px4-sih
  mavobserver check -c flight.toml --vehicle 2=my-quad.toml --json
  mavobserver check -c flight.toml --live

With --live the links are opened and the vehicles on them asked what a run would ask: firmware, parameters, streams. A
table tells every answer and what follows from it, `!` where something is amiss. At the end the vehicles are asked
to put everything back.

Exit codes: 0 valid, 1 nobody was heard on the links (--live), 2 problems found.")]
#[group(required = true, multiple = true, args = ["config", "vehicles", "links"])]
pub struct CheckArgs {
    #[command(flatten)]
    pub config: ConfigArgs,
    /// Link beside those of the config; repeatable
    #[arg(long = "link", value_name = "URL")]
    pub links: Vec<LinkUrl>,
    /// Open the links and pair with the vehicles on them, for so many seconds
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "25", value_parser = live::seconds)]
    pub live: Option<f64>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
}

/// Validates, designs and summarises.
pub fn run(args: CheckArgs) -> Result<(), Failure> {
    let runs = args.config.config.is_some() || !args.links.is_empty();
    let checked = args.config.load().map_err(|e| (issues(&e), Failure::from(e))).and_then(|(mut config, warnings)| {
        args.links.iter().for_each(|url| config.add_link(url.clone()));
        // a model alone is looked at; a config is what will run, so its designs must be possible
        let designs = if runs && args.live.is_none() { design(&config) } else { Ok(Vec::new()) };
        let designs = designs.map_err(|problems| {
            let issues = problems.iter().map(|p| json!({ "problem": p })).collect();
            (issues, Failure::Usage(problems.join("\n\n")))
        })?;
        Ok((config, warnings, designs))
    });
    match checked {
        Ok((config, warnings, _)) if args.live.is_some() => {
            warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
            live::run(config, args.live.unwrap_or_default(), args.json)
        }
        Ok((config, warnings, designs)) if args.json => print(&pretty(&report(&config, &warnings, &designs))),
        Ok((config, warnings, designs)) => print(&summary(&args, &config, &warnings, &designs)),
        Err((issues, failure)) => {
            if args.json {
                print(&pretty(&json!({ "ok": false, "issues": issues })))?;
            }
            Err(failure)
        }
    }
}

fn pretty(value: &Value) -> String {
    format!("{value:#}")
}

fn issues(errors: &LoadErrors) -> Vec<Value> {
    let placed = |issues: &crate::document::Issues| issues.iter().map(|i| json!(i)).collect::<Vec<_>>();
    let bare = |problem: String| vec![json!({ "problem": problem })];
    let config = errors.config.iter().flat_map(|e| match e {
        ConfigError::Invalid { issues, .. } => placed(issues),
        other => bare(other.to_string()),
    });
    let vehicles = errors.vehicles.iter().flat_map(|e| match e {
        VehicleError::Invalid { issues, .. } => placed(issues),
        other => bare(other.to_string()),
    });
    config.chain(vehicles).collect()
}

/// The vehicle models, each with the systems it is for.
fn models(config: &Config) -> Vec<(String, &Vehicle)> {
    let own = config.vehicles.by_system.iter().map(|(id, vehicle)| (format!("system {id}"), vehicle.as_ref()));
    let others = if config.vehicles.by_system.is_empty() { "every system" } else { "every other system" };
    own.chain(config.vehicles.default.iter().map(|v| (others.to_owned(), v.as_ref()))).collect()
}

fn report(config: &Config, warnings: &[Issue], designs: &[Value]) -> Value {
    let vehicles: Vec<_> = models(config)
        .into_iter()
        .map(|(systems, v)| {
            let facts = v.facts();
            json!({ "for": systems, "name": v.name, "cautions": cautions(&facts), "facts": facts })
        })
        .collect();
    let link =
        |link: &Link| json!({ "name": link.name, "url": link.url.to_string(), "now": links::caution(&link.url) });
    let links: Vec<_> = config.links.iter().map(link).collect();
    json!({
        "ok": true,
        "warnings": warnings,
        "links": links,
        "vehicles": vehicles,
        "designs": designs,
        "record": config.record.as_ref().map(|r| &r.directory),
    })
}

/// Designs every observer for every model, as a run would; what is infeasible or out of range is told here.
fn design(config: &Config) -> Result<Vec<Value>, Vec<String>> {
    let (mut designs, mut problems) = (Vec::new(), Vec::new());
    for (systems, vehicle) in models(config) {
        for setting in &config.observers {
            tracing::info!("designing {} for `{}`", setting.name, vehicle.name);
            let start = Instant::now();
            match build(&setting.name, vehicle, setting.options.clone()) {
                Ok(_) => designs.push(json!({
                    "observer": setting.name,
                    "for": systems,
                    "design_s": start.elapsed().as_secs_f64(),
                })),
                Err(e @ BuildError::Unsuited { .. }) if !setting.required => designs.push(json!({
                    "observer": setting.name,
                    "for": systems,
                    "left_out": e.to_string(),
                })),
                Err(e) => problems.push(format!("vehicle `{}`: {e}", vehicle.name)),
            }
        }
    }
    if problems.is_empty() { Ok(designs) } else { Err(problems) }
}

/// What a valid model cannot do.
fn cautions(facts: &Facts) -> Vec<String> {
    let mut cautions = Vec::new();
    if facts.hover_command.is_none() {
        cautions.push(format!(
            "it cannot hover: full thrust is {:.1} N, its weight {:.1} N",
            facts.max_thrust_n, facts.weight_n
        ));
    }
    if facts.wind_per_newton_mps.iter().take(2).any(Option::is_none) {
        cautions.push("no horizontal drag is given, so force says nothing about wind; see [drag]".to_owned());
    }
    cautions
}

fn summary(args: &CheckArgs, config: &Config, warnings: &[Issue], designs: &[Value]) -> String {
    let mut out = String::new();
    // writing to a String cannot fail
    let _ = write_summary(&mut out, args, config, warnings, designs);
    out.trim_end().to_owned()
}

fn write_summary(
    out: &mut String,
    args: &CheckArgs,
    config: &Config,
    warnings: &[Issue],
    designs: &[Value],
) -> std::fmt::Result {
    if let Some(path) = &args.config.config {
        writeln!(out, "{}: valid\n", path.display())?;
    }
    for warning in warnings {
        writeln!(out, "warning: {warning}\n")?;
    }
    for (systems, vehicle) in models(config) {
        write_vehicle(out, &systems, vehicle)?;
    }
    if config.vehicles == Default::default() {
        writeln!(out, "no vehicle model: give one with --vehicle or [vehicle]\n")?;
    }
    if args.config.config.is_none() && args.links.is_empty() {
        return Ok(());
    }
    writeln!(out, "observers")?;
    for d in designs {
        let seconds = d["design_s"].as_f64().unwrap_or_default();
        let (name, systems) = (d["observer"].as_str().unwrap_or_default(), d["for"].as_str().unwrap_or_default());
        match d["left_out"].as_str() {
            Some(reason) => writeln!(out, "  {name} for {systems}: left out, {reason}")?,
            None => writeln!(out, "  {name} for {systems}: designed and certified in {seconds:.1} s")?,
        }
    }
    writeln!(out)?;
    writeln!(out, "links")?;
    for link in &config.links {
        let url = link.url.to_string();
        let name = if link.name == url { String::new() } else { format!(" ({})", link.name) };
        writeln!(out, "  {url}{name}")?;
        if let Some(caution) = links::caution(&link.url) {
            writeln!(out, "    caution: {caution}")?;
        }
    }
    if config.links.is_empty() {
        writeln!(out, "  none: give one with --link or [[link]]")?;
    }
    match &config.record {
        Some(r) => writeln!(out, "\nrecords to {}", r.directory.display()),
        None => writeln!(out, "\nrecords nothing"),
    }
}

fn write_vehicle(out: &mut String, systems: &str, vehicle: &Vehicle) -> std::fmt::Result {
    let facts = vehicle.facts();
    let mass = vehicle.mass_kg;
    let per_axis = |values: [f64; 3], digits: usize| values.map(|x| format!("{x:.digits$}")).join(", ");
    writeln!(out, "vehicle `{}` for {systems}", vehicle.name)?;
    let range = if mass.range.lo() < mass.range.hi() {
        format!(" ({:.3} to {:.3})", mass.range.lo(), mass.range.hi())
    } else {
        String::new()
    };
    writeln!(out, "  mass            {:.3} kg{range}", mass.nominal)?;
    writeln!(out, "  rotors          {}, {:.1} N in all", vehicle.rotors.len(), facts.max_thrust_n)?;
    if let (Some(command), Some(output)) = (facts.hover_command, facts.hover_output) {
        let share = 100.0 * facts.hover_thrust_share;
        writeln!(out, "  hover           {share:.0} % of full thrust, command {command:.3} (output {output:.0})")?;
    }
    let torque = per_axis(facts.max_torque_nm, 2);
    writeln!(out, "  largest torque  {torque} N m about forward, right, down")?;
    let drag = per_axis(facts.drag_at_1_mps_n, 2);
    writeln!(out, "  drag at 1 m/s   {drag} N in hover")?;
    let wind = facts.wind_per_newton_mps.map(|w| w.map_or("unknown".to_owned(), |w| format!("{w:.2}"))).join(", ");
    writeln!(out, "  1 N of force    is {wind} m/s of wind in hover")?;
    for caution in cautions(&facts) {
        writeln!(out, "  caution: {caution}")?;
    }
    writeln!(out)
}
