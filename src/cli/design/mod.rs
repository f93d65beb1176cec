//! `mavobserver design`: an observer's synthesis, on the paper's plant or on a vehicle's.
//!
//! One file per observer, each with its `Args` and a `run` that gives a `Sheet`; one line per observer in the table of
//! subcommands and one in [`run`]. `options` holds what all of them take, `sheet` turns a sheet into text, JSON,
//! pictures and pages, `all` sets every paper's tables beside ours, `data` reads experiments.

mod all;
mod cascade_gnss_ins;
mod data;
mod fuzzy_polynomial;
mod options;
mod quadratic_bounded;
mod sheet;
mod unknown_input;

use super::Failure;

const EXAMPLES: &str = "Examples:
  mavobserver design quadratic-bounded
  mavobserver design quadratic-bounded --alpha 0.1,1,10 --json
  mavobserver design quadratic-bounded --plant px4-sih --mu 0.2,0.95
  mavobserver design fuzzy-polynomial --method all --plot front.html
  mavobserver design cascade-gnss-ins --gamma 50 --gamma-n 1.002
  mavobserver design unknown-input --alpha 1,5,20
  mavobserver design all --report report.html";

/// Design an observer and check the design
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct DesignArgs {
    #[command(subcommand)]
    observer: Observer,
}

/// Every observer that can be designed, one line each; `all` has a table of its own.
#[derive(Debug, clap::Subcommand)]
enum Observer {
    All(all::Args),
    QuadraticBounded(quadratic_bounded::Args),
    FuzzyPolynomial(fuzzy_polynomial::Args),
    CascadeGnssIns(cascade_gnss_ins::Args),
    UnknownInput(unknown_input::Args),
}

pub fn run(args: &DesignArgs) -> Result<(), Failure> {
    match &args.observer {
        Observer::All(a) => all::run(a),
        Observer::QuadraticBounded(a) => quadratic_bounded::run(a)?.deliver(&a.shared),
        Observer::FuzzyPolynomial(a) => fuzzy_polynomial::run(a)?.deliver(&a.shared),
        Observer::CascadeGnssIns(a) => cascade_gnss_ins::run(a)?.deliver(&a.shared),
        Observer::UnknownInput(a) => unknown_input::run(a)?.deliver(&a.shared),
    }
}
