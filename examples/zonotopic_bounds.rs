//! How well the zonotopic filter's intervals hold and how wide they are, guaranteed and as published, for every set of
//! outputs that a vehicle may send.
//!
//!     cargo run --release --example zonotopic_bounds              # 200 episodes of 1000 steps for each line
//!     cargo run --release --example zonotopic_bounds -- 1000 1000

#[path = "../tests/bounded/mod.rs"]
mod bounded;

use bounded::{INDOORS, MEASURED, OUTDOORS, fly};
use mavobserver::observers::zonotopic_ekf::Mode;
use std::time::Instant;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|a| a.parse::<usize>().ok());
    let mut next = |default| numbers.next().flatten().unwrap_or(default);
    let (episodes, length) = (next(200), next(1000));
    println!("Initial boxes of up to 0.3 rad; noise, rotors and air at the ends of their bounds; order 15.");
    println!("Width: mean half-width over 99.9 % error, the worst of three states, after 2 s of an episode.");
    println!(
        "{:10} {:9} {:30} {:>9} {:>10} {:>12} {:>6}  width of position, velocity, attitude, rate",
        "mode", "where", "measured", "steps", "inside", "contradicted", "lost"
    );
    for mode in [Mode::Guaranteed, Mode::Paper] {
        for (place, conditions) in [("outdoors", OUTDOORS), ("indoors", INDOORS)] {
            for measured in &MEASURED {
                let begin = Instant::now();
                let s = fly(&conditions, mode, measured, 0.3, episodes, length);
                let widths: Vec<String> = (0..4).map(|g| format!("{:5.2}", s.tightness(g))).collect();
                println!(
                    "{:10} {place:9} {:30} {:9} {:8.3} % {:12} {:6}  {}  ({:.1} µs a step, truth included)",
                    format!("{mode:?}").to_lowercase(),
                    measured.name,
                    s.steps,
                    100.0 * s.coverage(),
                    s.contradicted,
                    s.lost,
                    widths.join(" "),
                    1e6 * begin.elapsed().as_secs_f64() / s.steps as f64
                );
            }
        }
    }
}
