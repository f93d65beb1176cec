use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// Where a number is on an axis, and which numbers are written beside it.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Scale {
    Linear([f64; 2]),
    /// Both ends positive.
    Log([f64; 2]),
    /// Row `i` from the top is centred on −i.
    Rows(Vec<String>),
}

/// Larger numbers, and on a logarithmic scale smaller ones, would overflow on the way to pixels.
const LARGEST: f64 = 1e150;

fn fits(v: f64, log: bool) -> bool {
    v.abs() <= LARGEST && (!log || v >= 1.0 / LARGEST)
}

impl Scale {
    /// A scale that holds the numbers, with `room` (share of the whole) at both ends. Numbers that have no place on it
    /// do not count.
    pub fn around(values: impl Iterator<Item = f64>, log: bool, room: f64) -> Self {
        let ends = values
            .filter(|v| fits(*v, log))
            .fold(None, |ends: Option<[f64; 2]>, v| Some(ends.map_or([v, v], |[low, high]| [low.min(v), high.max(v)])));
        match (ends, log) {
            (None, true) => Self::Log([0.1, 1.0]),
            (None, false) => Self::Linear([0.0, 1.0]),
            (Some([low, high]), true) => {
                let factor = if high / low < 1.0 + 1e-9 { 10f64.sqrt() } else { (high / low).powf(room) };
                Self::Log([low / factor, high * factor])
            }
            (Some([low, high]), false) => {
                let size = high - low;
                // a flat line lies in the middle of a scale of its own size
                let flat = size <= 1e-9 * low.abs().max(high.abs()) || size == 0.0;
                let room = if flat { 0.5 * low.abs().max(if low == 0.0 { 1.0 } else { 0.0 }) } else { room * size };
                Self::Linear([low - room, high + room])
            }
        }
    }

    /// Ends given by the caller, or `around` the values when they make no scale.
    pub fn given(ends: [f64; 2], log: bool) -> Option<Self> {
        let [low, high] = ends;
        let sound = low < high && ends.iter().all(|v| fits(*v, log));
        sound.then_some(if log { Self::Log(ends) } else { Self::Linear(ends) })
    }

    pub fn ends(&self) -> [f64; 2] {
        match self {
            Self::Linear(ends) | Self::Log(ends) => *ends,
            Self::Rows(names) => [0.5 - names.len() as f64, 0.5],
        }
    }

    /// 0 at the lower end, 1 at the upper; `None` for a number without a place.
    pub fn share(&self, v: f64) -> Option<f64> {
        let [low, high] = self.ends();
        let share = match self {
            Self::Log(_) if v <= 0.0 => return None,
            Self::Log(_) => (v / low).ln() / (high / low).ln(),
            _ => (v - low) / (high - low),
        };
        share.is_finite().then_some(share)
    }

    /// Round numbers inside the scale, about `count` of them.
    fn ticks(&self, count: usize) -> Vec<f64> {
        match self {
            Self::Linear([low, high]) => {
                let step = step(*low, *high, count);
                let first = (low / step).ceil();
                let all = (0..=2 * count).map(|i| (first + i as f64) * step);
                all.take_while(|v| *v <= high + 1e-9 * step).collect()
            }
            Self::Log([low, high]) => {
                let decades = (high / low).log10();
                let within: &[f64] = if decades > 3.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
                let every = (decades / count.max(1) as f64).ceil().max(1.0) as i32;
                let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
                let all = powers
                    .filter(|p| p.rem_euclid(every) == 0)
                    .flat_map(|p| within.iter().map(move |m| m * 10f64.powi(p)));
                all.filter(|v| (*low..=*high).contains(v)).collect()
            }
            Self::Rows(names) => (0..names.len()).map(|i| -(i as f64)).collect(),
        }
    }
}

/// 1, 2 or 5 times a power of ten.
fn step(low: f64, high: f64, count: usize) -> f64 {
    let rough = (high - low) / count.max(1) as f64;
    let power = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough * (1.0 - 1e-9)).unwrap_or(rough)
}

/// Short, without the noise of binary fractions.
fn tidy(v: f64) -> String {
    if v != 0.0 && !(1e-4..1e6).contains(&v.abs()) {
        let text = format!("{v:e}");
        let (digits, power) = text.split_once('e').unwrap_or((&text, "0"));
        let factor = if digits == "1" { String::new() } else { format!("{}·", digits.replace('-', "−")) };
        return format!("{factor}10{}", power.chars().map(raised).collect::<String>());
    }
    let text = format!("{v:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.replace('-', "−") }
}

fn raised(c: char) -> char {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    c.to_digit(10).and_then(|d| DIGITS.get(d as usize).copied()).unwrap_or('⁻')
}

impl Ranged for Scale {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    /// Numbers outside the scale are drawn at its ends.
    fn map(&self, value: &f64, (from, to): (i32, i32)) -> i32 {
        let share = self.share(*value).unwrap_or(0.0).clamp(0.0, 1.0);
        from + (share * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        // one grid is enough: no light lines between the bold ones
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks(hint.bold_points()) }
    }

    fn range(&self) -> Range<f64> {
        let [low, high] = self.ends();
        low..high
    }
}

impl ValueFormatter<f64> for Scale {
    fn format_ext(&self, value: &f64) -> String {
        match self {
            Self::Rows(names) => names.get(-*value as usize).cloned().unwrap_or_default(),
            Self::Linear(ends) => {
                // rounded to what a grid can have, so that a sum of steps is as tidy as its terms
                let places = 5 - (ends[1] - ends[0]).log10().floor() as i32;
                let unit = 10f64.powi(places.clamp(-300, 300));
                tidy((value * unit).round() / unit)
            }
            Self::Log(_) => tidy(*value),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(Scale::Linear([-3.1, 8.2]).ticks(4), [0.0, 5.0]);
        assert_eq!(Scale::Linear([0.0, 60.0]).ticks(6), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        assert_eq!(Scale::Log([0.04, 3.0]).ticks(5), [0.05, 0.1, 0.2, 0.5, 1.0, 2.0]);
        assert_eq!(Scale::Log([1e-9, 1e3]).ticks(6), [1e-8, 1e-6, 1e-4, 1e-2, 1.0, 100.0]);
        let written = |v: f64| Scale::Linear([0.0, 1.0]).format_ext(&v);
        assert_eq!([written(0.1 + 0.2), written(-1e-9), written(-0.5)], ["0.3", "0", "−0.5"]);
        assert_eq!(Scale::Linear([-2.1, 2.1]).format_ext(&1.999_999_9), "2");
        assert_eq!([tidy(1e-6), tidy(-2.5e7)], ["10⁻⁶", "−2.5·10⁷"]);
    }

    #[test]
    fn scales_hold_their_numbers_and_survive_strange_ones() {
        let around = |values: &[f64], log| Scale::around(values.iter().copied(), log, 0.0).ends();
        assert_eq!(around(&[f64::NAN, 1.0, f64::INFINITY, 3.0], false), [1.0, 3.0]);
        assert_eq!(around(&[-1.0, 0.0, 10.0, 1000.0], true), [10.0, 1000.0]);
        for values in [&[][..], &[0.0], &[5.0], &[-2.0, -2.0], &[1e-300], &[1e12, 1e12], &[1e300, 1.0, -1e300]] {
            for log in [false, true] {
                let [low, high] = around(values, log);
                assert!(low < high && low.is_finite() && high.is_finite(), "{values:?} {log}: {low} {high}");
            }
        }
        assert_eq!(around(&[1e300, 1.0, 10.0], true), [1.0, 10.0]);
        assert_eq!(Scale::given([1.0, 1.0], false), None);
        assert_eq!(Scale::given([0.0, 1.0], true), None);
    }
}
