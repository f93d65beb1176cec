//! Time series as an SVG picture: panels under each other, each with its lines and bands. Text stays text.

use std::fmt::Write;

/// One panel: what is drawn over time.
pub(super) struct Panel {
    pub title: String,
    pub unit: &'static str,
    /// Lower and upper end over time; drawn behind the lines.
    pub band: Vec<[f64; 3]>,
    pub lines: Vec<Line>,
}

pub(super) struct Line {
    pub label: &'static str,
    pub colour: &'static str,
    /// Time and value.
    pub points: Vec<[f64; 2]>,
}

const WIDTH: f64 = 960.0;
const PANEL: f64 = 150.0;
const GAP: f64 = 34.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 16.0;
const TOP: f64 = 48.0;
/// Points beyond this many are thinned out: more than one a pixel shows nothing.
const POINTS: usize = 900;

/// The picture, with a heading and the time axis in seconds at the bottom.
pub(super) fn svg(heading: &str, panels: &[Panel]) -> String {
    let height = TOP + panels.len() as f64 * (PANEL + GAP) + 24.0;
    let times = panels.iter().flat_map(|p| p.lines.iter().flat_map(|l| l.points.iter().map(|q| q[0])));
    let (start, end) = span(times);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"system-ui, sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n<text x=\"{LEFT}\" y=\"24\" \
         font-size=\"16\">{}</text>\n",
        escape(heading)
    );
    for (i, panel) in panels.iter().enumerate() {
        let top = TOP + i as f64 * (PANEL + GAP);
        panel.draw(&mut out, top, start, end, i + 1 == panels.len());
    }
    out.push_str("</svg>\n");
    out
}

/// Maps values to the pixels of a panel.
struct Axes {
    x: [f64; 2],
    y: [f64; 2],
    top: f64,
}

impl Axes {
    fn x(&self, t: f64) -> f64 {
        LEFT + (t - self.x[0]) / (self.x[1] - self.x[0]) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, v: f64) -> f64 {
        let v = v.clamp(self.y[0], self.y[1]);
        self.top + PANEL - (v - self.y[0]) / (self.y[1] - self.y[0]) * PANEL
    }
}

impl Panel {
    fn draw(&self, out: &mut String, top: f64, start: f64, end: f64, last: bool) {
        // the lines set the scale, with room for the band as far as it is of their size
        let (low, high) = span(self.lines.iter().flat_map(|l| l.points.iter().map(|q| q[1])));
        let margin = 0.5 * (high - low);
        let band = self.band.iter().flat_map(|b| [b[1], b[2]]).map(|v| v.clamp(low - margin, high + margin));
        let (low, high) = span(band.chain([low, high]));
        let axes = Axes { x: [start, end], y: [low, high], top };
        // writing to a String cannot fail
        let _ = writeln!(out, "<text x=\"{LEFT}\" y=\"{}\">{}, {}</text>", top - 6.0, escape(&self.title), self.unit);
        self.grid(out, &axes, last);
        self.draw_band(out, &axes);
        for (i, line) in self.lines.iter().enumerate() {
            let points: String =
                thinned(&line.points).map(|p| format!("{:.1},{:.1} ", axes.x(p[0]), axes.y(p[1]))).collect();
            let x = WIDTH - RIGHT - 90.0 * (self.lines.len() - i) as f64;
            let _ = write!(
                out,
                "<polyline points=\"{points}\" fill=\"none\" stroke=\"{0}\" stroke-width=\"1.4\"/>\n\
                 <text x=\"{x}\" y=\"{1}\" fill=\"{0}\">{2}</text>\n",
                line.colour,
                top - 6.0,
                line.label
            );
        }
    }

    fn draw_band(&self, out: &mut String, axes: &Axes) {
        if self.band.is_empty() {
            return;
        }
        let upper = thinned(&self.band).map(|b| format!("{:.1},{:.1} ", axes.x(b[0]), axes.y(b[2])));
        let lower: Vec<_> = thinned(&self.band).map(|b| format!("{:.1},{:.1} ", axes.x(b[0]), axes.y(b[1]))).collect();
        let points: String = upper.chain(lower.into_iter().rev()).collect();
        let _ = writeln!(out, "<polygon points=\"{points}\" fill=\"#2b6cb0\" fill-opacity=\"0.15\"/>");
    }

    fn grid(&self, out: &mut String, axes: &Axes, last: bool) {
        let (right, bottom) = (WIDTH - RIGHT, axes.top + PANEL);
        for v in ticks(axes.y[0], axes.y[1], 4.0) {
            let y = axes.y(v);
            let _ = writeln!(
                out,
                "<line x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{right}\" y2=\"{y:.1}\" stroke=\"#ddd\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"#555\">{}</text>",
                LEFT - 6.0,
                y + 4.0,
                tidy(v)
            );
        }
        for t in ticks(axes.x[0], axes.x[1], 10.0) {
            let x = axes.x(t);
            let _ =
                write!(out, "<line x1=\"{x:.1}\" y1=\"{}\" x2=\"{x:.1}\" y2=\"{bottom}\" stroke=\"#eee\"/>", axes.top);
            if last {
                let _ = write!(
                    out,
                    "<text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#555\">{} s</text>",
                    bottom + 16.0,
                    tidy(t)
                );
            }
            out.push('\n');
        }
    }
}

/// Smallest and largest value, never the same.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) =
        values.filter(|v| v.is_finite()).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = if high - low > 1e-9 { 0.0 } else { 0.5 };
    (low - room, high + room)
}

/// Round numbers between two values, about `count` of them.
fn ticks(low: f64, high: f64, count: f64) -> impl Iterator<Item = f64> {
    let rough = (high - low) / count;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
    let first = (low / step).ceil();
    (0..=(2.0 * count) as u32).map(move |i| (first + f64::from(i)) * step).take_while(move |v| *v <= high + 1e-9)
}

/// Without trailing zeros, and without the noise of binary fractions.
fn tidy(v: f64) -> String {
    let text = format!("{v:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn thinned<const N: usize>(points: &[[f64; N]]) -> impl Iterator<Item = &[f64; N]> {
    points.iter().step_by(points.len().div_ceil(POINTS).max(1))
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(-3.1, 8.2, 4.0).collect::<Vec<_>>(), [0.0, 5.0]);
        assert_eq!(ticks(0.0, 60.0, 10.0).collect::<Vec<_>>(), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        assert_eq!([tidy(0.30000000000000004), tidy(-0.0001), tidy(20.0)], ["0.3", "0", "20"]);
    }

    #[test]
    fn a_picture_holds_its_lines_and_survives_emptiness() {
        let line = Line { label: "truth", colour: "#222", points: (0..5000).map(|i| [f64::from(i), 1.0]).collect() };
        let panel = Panel {
            title: "a < b".into(),
            unit: "m/s",
            band: vec![[0.0, 0.5, 1.5], [5e3, 0.5, 1.5]],
            lines: vec![line],
        };
        let picture = svg("heading", &[panel]);
        assert!(picture.contains("a &lt; b") && picture.contains("<polygon") && picture.matches(',').count() < 2_500);
        assert!(svg("nothing", &[]).ends_with("</svg>\n"));
        assert!(!picture.contains("NaN") && !picture.contains("inf"));
    }
}
