//! What every design takes on the command line.

use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::DMatrix;
use serde_json::Value;
use std::path::PathBuf;

/// Options of every design.
#[derive(Debug, clap::Args)]
pub struct Shared {
    /// The paper's plant, or any vehicle preset or TOML file with its declared bounds [default: the paper's plant]
    #[arg(long, value_name = "PRESET|FILE")]
    pub plant: Option<String>,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// Write the first picture as SVG, or all of them on one HTML page
    #[arg(long, value_name = "FILE.svg|.html")]
    pub plot: Option<PathBuf>,
}

/// Convergence rates; for the observers that have one.
#[derive(Debug, clap::Args)]
pub struct Rates {
    /// Convergence rates, 1/s
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = positive)]
    pub alpha: Vec<f64>,
}

impl Rates {
    /// The rates asked for, else these.
    pub fn or(&self, otherwise: &[f64]) -> Vec<f64> {
        if self.alpha.is_empty() { otherwise.to_vec() } else { self.alpha.clone() }
    }
}

/// Parses a positive number.
pub fn positive(text: &str) -> Result<f64, String> {
    number(text, |x| x > 0.0 && x.is_finite(), "a positive number")
}

/// Parses a number from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    number(text, |x| (0.0..=1.0).contains(&x), "a number from 0 to 1")
}

fn number(text: &str, fits: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    text.trim().parse().ok().filter(|x| fits(*x)).ok_or_else(|| format!("expected {expected}"))
}

/// A progress bar on standard error, shown only on a terminal.
pub fn progress(steps: usize) -> ProgressBar {
    let bar = ProgressBar::new(steps as u64);
    if let Ok(style) = ProgressStyle::with_template("designing {bar:30} {pos}/{len} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// A matrix as JSON, row by row.
pub fn matrix(m: &DMatrix<f64>) -> Value {
    m.row_iter().map(|row| row.iter().copied().collect::<Vec<_>>()).collect::<Vec<_>>().into()
}

/// Three significant digits.
pub fn three(x: f64) -> String {
    let size = x.abs();
    let digits = if size > 0.0 && x.is_finite() { (2 - size.log10().floor() as i32).clamp(0, 6) as usize } else { 0 };
    format!("{x:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_at_any_size() {
        assert_eq!(
            [0.0123, 1.0, 45.67, 1234.5, 0.0, -2.345].map(three),
            ["0.0123", "1.00", "45.7", "1234", "0", "-2.35"]
        );
    }
}
