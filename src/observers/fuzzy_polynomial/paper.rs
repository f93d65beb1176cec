//! What the paper prints.

use super::design::Method;

/// Decay rates of Table 2, 1/s.
pub const ALPHAS: [f64; 6] = [1.5, 6.0, 10.0, 14.0, 18.0, 22.0];

/// A row of Table 2: 1000·√γ by decay rate.
pub fn table_2(method: Method) -> [f64; 6] {
    match method {
        Method::LinearDesign => [1.628, 6.45, 11.06, 15.89, 20.9, 26.09],
        Method::LinearAnalysis => [22.37, 39.44, 31.34, 30.64, 33.07, 36.93],
        Method::EightGains => [13.94, 30.64, 50.23, 73.95, 102.87, 138.65],
        Method::OneGain => [14.89, 32.63, 52.87, 77.35, 107.25, 144.46],
        Method::OneGainAnalysis => [9.708, 22.3, 35.3, 49.71, 65.65, 83.21],
        Method::SumsOfSquares => [5.986, 9.915, 14.36, 19.18, 24.26, 29.57],
    }
}

/// How the paper's text differs from what its numbers follow from.
pub const CORRECTIONS: &[&str] = &[
    "Table 2 lists 1000·√γ.",
    "(14) and (15) are 7×7, not 12×12; with (C.2) read as R²_max and eᵀPe, and γ for γ² in appendix C.",
    "R²_max = 7.5 fits the table to 3e−4; the printed 3(π/2)² = 7.402 to 4e−3.",
    "The gyroscopic entry is 4·K_v·V_max·J_r/I_xx·T_s = .0119446; the printed .012 costs 1.5e−3.",
    "(1) prints pitch's gyroscopic term with the sign and the inertia of roll.",
    "LM-D has neither σ nor τ; (16) is for designs only and inactive in SOS-2G.",
];
