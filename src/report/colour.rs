use plotters::style::RGBColor;

/// Colours that can be told apart on white and on dark paper, and in print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Colour {
    /// That of text: for the truth, or what everything else is held against.
    Ink,
    Blue,
    Orange,
    Green,
    Red,
    Purple,
    Teal,
    Grey,
}

impl Colour {
    const ALL: [Self; 8] =
        [Self::Ink, Self::Blue, Self::Orange, Self::Green, Self::Red, Self::Purple, Self::Teal, Self::Grey];

    /// The colour of the `index`-th of several things; begins anew when there are more things than colours.
    pub fn nth(index: usize) -> Self {
        const SERIES: [Colour; 6] =
            [Colour::Blue, Colour::Orange, Colour::Green, Colour::Purple, Colour::Red, Colour::Teal];
        SERIES.get(index % SERIES.len()).copied().unwrap_or(Self::Grey)
    }

    /// On white, and on dark paper.
    const fn shades(self) -> [Rgb; 2] {
        match self {
            Self::Ink => [[0x1F, 0x23, 0x28], [0xE6, 0xED, 0xF3]],
            Self::Blue => [[0x1F, 0x6F, 0xB5], [0x6C, 0xB6, 0xFF]],
            Self::Orange => [[0xC2, 0x5A, 0x12], [0xF0, 0x88, 0x3E]],
            Self::Green => [[0x2A, 0x80, 0x40], [0x56, 0xD3, 0x64]],
            Self::Red => [[0xC0, 0x30, 0x30], [0xFF, 0x7B, 0x72]],
            Self::Purple => [[0x7A, 0x4F, 0xC0], [0xC2, 0x97, 0xFF]],
            Self::Teal => [[0x0F, 0x7F, 0x86], [0x39, 0xC5, 0xCF]],
            Self::Grey => [[0x6E, 0x77, 0x81], [0x9A, 0xA4, 0xAF]],
        }
    }

    pub(super) fn rgb(self) -> RGBColor {
        to_plotters(self.shades()[0])
    }
}

type Rgb = [u8; 3];

const PAPER_SHADES: [Rgb; 2] = [[0xFF, 0xFF, 0xFF], [0x0D, 0x11, 0x17]];
const GRID_SHADES: [Rgb; 2] = [[0xE3, 0xE6, 0xEA], [0x30, 0x36, 0x3D]];
const LABEL_SHADES: [Rgb; 2] = [[0x57, 0x60, 0x6A], [0x9B, 0xA5, 0xB0]];

pub(super) const PAPER: RGBColor = to_plotters(PAPER_SHADES[0]);
pub(super) const GRID: RGBColor = to_plotters(GRID_SHADES[0]);
pub(super) const LABEL: RGBColor = to_plotters(LABEL_SHADES[0]);

const fn to_plotters([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

/// Style sheet that gives everything of the class `chart` its dark shade where the reader prefers dark paper. Paper
/// from a printer stays white.
pub(super) fn dark_style() -> String {
    let shades = Colour::ALL.iter().map(|c| c.shades()).chain([PAPER_SHADES, GRID_SHADES, LABEL_SHADES]);
    let rules: String = shades
        .map(|[light, dark]| {
            let (light, dark) = (hex(light), hex(dark));
            format!(".chart [stroke=\"{light}\"]{{stroke:{dark}}}.chart [fill=\"{light}\"]{{fill:{dark}}}")
        })
        .collect();
    format!("<style>@media screen and (prefers-color-scheme:dark){{{rules}}}</style>")
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// Relative luminance and contrast ratio as the Web Content Accessibility Guidelines 2.2 define them.
    fn contrast(a: Rgb, b: Rgb) -> f64 {
        let luminance = |c: Rgb| {
            let linear = c.map(|v| {
                let v = f64::from(v) / 255.0;
                if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
            });
            0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
        };
        let (a, b) = (luminance(a) + 0.05, luminance(b) + 0.05);
        a.max(b) / a.min(b)
    }

    #[test]
    fn every_colour_can_be_read_on_its_paper() {
        for shades in Colour::ALL.iter().map(|c| c.shades()).chain([LABEL_SHADES]) {
            for (shade, paper) in shades.into_iter().zip(PAPER_SHADES) {
                assert!(contrast(shade, paper) >= 4.4, "{} on {}", hex(shade), hex(paper));
            }
        }
    }

    #[test]
    fn no_two_colours_are_the_same_and_all_turn_dark() {
        let light: BTreeSet<_> = Colour::ALL.iter().map(|c| c.shades()[0]).collect();
        assert_eq!(light.len(), Colour::ALL.len());
        let style = dark_style();
        assert!(light.iter().all(|c| style.contains(&format!("[stroke=\"{}\"]", hex(*c)))));
        assert_eq!(Colour::nth(0), Colour::nth(6));
    }
}
