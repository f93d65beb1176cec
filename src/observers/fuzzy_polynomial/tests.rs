//! The published table and gains.

use super::*;

fn made(method: Method, alpha: f64) -> Design {
    let d = design(&Plant::quanser(), method, alpha, Options::default()).unwrap();
    println!("{} {alpha}: {:.5} margin {:.1e} {:.3} s", method.name(), d.table_value(), d.margin, d.solve_s);
    d
}

fn compare(method: Method, tolerance: f64) {
    let published = paper::table_2(method);
    let all: Vec<f64> = paper::ALPHAS.iter().map(|&a| made(method, a).table_value()).collect();
    for ((alpha, value), published) in paper::ALPHAS.iter().zip(all).zip(published) {
        assert!((value / published - 1.0).abs() < tolerance, "{method:?} α = {alpha}: {value}, published {published}");
    }
}

#[test]
fn table_2_eight_gains() {
    compare(Method::EightGains, 5e-4);
}

#[test]
fn table_2_one_gain() {
    compare(Method::OneGain, 5e-4);
}

#[test]
fn table_2_one_gain_analysis() {
    compare(Method::OneGainAnalysis, 1e-3);
}

#[test]
fn table_2_sums_of_squares() {
    compare(Method::SumsOfSquares, 1e-3);
}
