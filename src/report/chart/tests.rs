use super::*;
use crate::report::Colour;
use std::f64::consts::TAU;

fn everything() -> Figure {
    let wave = |phase: f64| (0..5000).map(move |i| [f64::from(i) * 0.01, (f64::from(i) * 0.002 + phase).sin()]);
    let first = Panel::new("a < b & \"c\"", "m/s")
        .band("bound", Colour::Blue, wave(0.0).map(|[t, v]| [t, v - 0.3, v + 0.3]))
        .line("truth", Colour::Ink, wave(0.1))
        .line("estimate", Colour::Blue, wave(0.0))
        .dashed("limit", Colour::Red, [[0.0, 1.2], [50.0, 1.2]])
        .event(12.0, "gust")
        .event(12.5, "rotor 2 lost")
        .span(30.0, 40.0, "payload on", Colour::Orange);
    let second =
        Panel::new("Cost", "").log_y().line("J", Colour::Green, (1..50).map(|i| [f64::from(i), 10f64.powi(i % 7)]));
    let third = Panel::new("Faults", "").lane("true", Colour::Grey, [[5.0, 10.0], [20.0, 40.0]]).lane(
        "told",
        Colour::Red,
        [[5.4, 10.2], [21.0, 40.5]],
    );
    Figure::new("Everything").x("time", "s").panel(first).panel(second).panel(third)
}

#[test]
fn a_picture_holds_what_was_put_in_and_escapes_it() {
    let picture = everything().svg().unwrap();
    for text in [
        "a &lt; b &amp; &quot;c&quot;, m/s",
        "Everything",
        "time, s",
        "gust",
        "payload on",
        "limit",
        "told",
        "<polygon",
    ] {
        assert!(picture.contains(text), "{text}");
    }
    assert!(picture.starts_with("<svg") && picture.ends_with("</svg>\n"));
    // 10 000 points of lines and 10 000 ends of the band, thinned
    assert!(picture.len() < 150_000, "{}", picture.len());
    if let Ok(folder) = std::env::var("MAVOBSERVER_PICTURES") {
        std::fs::write(format!("{folder}/everything.svg"), picture).unwrap();
    }
}

#[test]
fn outlines_and_names_in_an_equal_scale() {
    let ring = (0..60).map(|i| TAU * f64::from(i) / 60.0).map(|a| [2.0 * a.cos(), a.sin()]);
    let panel = Panel::new("Ellipse", "N m")
        .outline("bound", Colour::Purple, ring)
        .named_points("designs", Colour::Orange, [([0.5, 0.5], "α = 1".to_owned()), ([-1.0, 0.1], "α = 2".to_owned())])
        .height(400)
        .equal();
    let figure = Figure::new("").x("force", "N").width(500).panel(panel);
    let layout = Layout::of(&figure);
    let [width, height] = [layout.x.ends(), layout.places[0].y.ends()].map(|e| e[1] - e[0]);
    assert!((width / height - (500.0 - 86.0) / 400.0).abs() < 1e-9);
    let picture = figure.svg().unwrap();
    assert!(picture.contains("α = 2") && picture.matches("<circle").count() == 3);
    if let Ok(folder) = std::env::var("MAVOBSERVER_PICTURES") {
        std::fs::write(format!("{folder}/ellipse.svg"), picture).unwrap();
    }
}

#[test]
fn emptiness_and_strange_numbers_are_drawn_too() {
    let strange =
        [[f64::NAN, 1.0], [0.0, f64::INFINITY], [f64::NEG_INFINITY, f64::NAN], [1.0, 0.0], [2.0, -1e300], [3.0, 1e300]];
    for log in [false, true] {
        let panel = Panel::new("", "").line("x", Colour::Ink, strange).points("x", Colour::Ink, strange).outline(
            "x",
            Colour::Ink,
            strange,
        );
        let panel = panel.band("x", Colour::Ink, [[0.0, f64::NAN, 1.0], [1.0, 2.0, 1.0]]).event(f64::NAN, "n").span(
            9.0,
            1.0,
            "s",
            Colour::Red,
        );
        let panel = if log { panel.log_y() } else { panel };
        let figure = Figure::new("strange")
            .panel(panel)
            .panel(Panel::new("nothing", "N"))
            .panel(Panel::new("", "").lane("l", Colour::Red, []));
        let figure = if log { figure.log_x() } else { figure };
        let picture = figure.svg().unwrap();
        assert!(!picture.contains("NaN") && !picture.contains("inf"));
    }
    assert!(Figure::new("nothing").svg().unwrap().ends_with("</svg>\n"));
}
