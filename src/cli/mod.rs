//! The command line: one file per subcommand, each with its arguments and a `run`.
//!
//! In: arguments. Out: text or JSON on standard output, errors and logs on standard error, and an exit code: 0 done,
//! 1 failed, 2 wrong usage or config. May import everything.

pub mod check;
mod config_args;
pub mod convert;
pub mod demo;
pub mod design;
pub mod evaluate;
pub mod identify;
mod logging;
mod output;
pub mod recover;
pub mod replay;
pub mod run;
pub mod sim;
pub mod tap;

pub use config_args::{ConfigArgs, VehicleArg};
pub use output::print;

use crate::config::ConfigError;
use crate::report::ReportError;
use crate::vehicle::VehicleError;
use clap::{Args, Parser, Subcommand};
use std::process::ExitCode;

/// What acts on a flying vehicle, with a bound on the error, from the MAVLink telemetry it already sends.
#[derive(Debug, Parser)]
#[command(name = "mavobserver", version, max_term_width = 100, after_help = EXIT_CODES)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    verbosity: Verbosity,
}

const EXIT_CODES: &str = "Exit codes: 0 done, 1 failed, 2 wrong usage or config.";

#[derive(Debug, Subcommand)]
enum Command {
    Run(run::RunArgs),
    Replay(replay::ReplayArgs),
    Convert(convert::ConvertArgs),
    Recover(recover::RecoverArgs),
    Check(check::CheckArgs),
    Tap(tap::TapArgs),
    Sim(sim::SimArgs),
    Evaluate(evaluate::EvaluateArgs),
    Demo(demo::DemoArgs),
    Design(design::DesignArgs),
    Identify(identify::IdentifyArgs),
}

/// How much is logged to standard error.
#[derive(Debug, Clone, Copy, Args)]
struct Verbosity {
    /// Log more; twice for everything
    #[arg(short, long, global = true, display_order = 900, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Log errors only
    #[arg(short, long, global = true, display_order = 901, conflicts_with = "verbose")]
    quiet: bool,
}

/// Why a command did not do what it was asked.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The user has to change the command line or a file.
    #[error("{0}")]
    Usage(String),
    /// The command was right, but could not be carried out.
    #[error("{0}")]
    Failed(String),
}

impl Failure {
    pub fn exit_code(&self) -> ExitCode {
        match self {
            Self::Usage(_) => ExitCode::from(2),
            Self::Failed(_) => ExitCode::from(1),
        }
    }
}

impl From<ConfigError> for Failure {
    fn from(e: ConfigError) -> Self {
        Self::Usage(e.to_string())
    }
}

impl From<VehicleError> for Failure {
    fn from(e: VehicleError) -> Self {
        Self::Usage(e.to_string())
    }
}

impl From<ReportError> for Failure {
    fn from(e: ReportError) -> Self {
        Self::Failed(e.to_string())
    }
}

/// Runs the command that the arguments name.
pub fn run(cli: Cli) -> Result<(), Failure> {
    logging::start(cli.verbosity);
    match cli.command {
        Command::Run(args) => run::run(args),
        Command::Replay(args) => replay::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Recover(args) => recover::run(&args),
        Command::Check(args) => check::run(args),
        Command::Tap(args) => tap::run(&args),
        Command::Sim(args) => sim::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Design(args) => design::run(&args),
        Command::Identify(args) => identify::run(&args),
    }
}
