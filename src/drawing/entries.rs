//! Entries of a legend, drawn.

use super::colors::{Rgb, hex, viridis};
use super::legend::{Key, Legend, Range, told};
use super::svg::Svg;
use super::words::{LINE_PX, WORDS, text_px};

/// Width and height of the colour bar, pixels.
const BAR_PX: [f64; 2] = [150.0, 10.0];

/// One entry of a legend, which is not broken.
#[derive(Clone, Copy)]
pub(super) enum Entry<'a> {
    Map { range: Range, what: &'a str },
    Key { color: Rgb, what: &'a str, is_line: bool },
}

/// The entries of a legend.
pub(super) fn entries(legend: &Legend) -> Vec<Entry<'_>> {
    let mut entries = Vec::new();
    match legend {
        Legend::Map { range, what } => entries.push(Entry::Map { range: *range, what }),
        Legend::Keys(keys) => {
            for Key { color, what, is_line } in keys {
                entries.push(Entry::Key { color: *color, what, is_line: *is_line });
            }
        }
    }
    entries
}

impl Entry<'_> {
    /// Width, pixels.
    pub fn width(self) -> f64 {
        match self {
            Self::Map { range, what } => {
                let [low, high] = ends(range);
                text_px(what) + 8.0 + text_px(&low) + 6.0 + BAR_PX[0] + 6.0 + text_px(&high)
            }
            Self::Key { what, .. } => 24.0 + text_px(what),
        }
    }

    /// Draws it with its upper left corner there; its width.
    pub fn draw(self, svg: &mut Svg, [left, top]: [f64; 2]) -> f64 {
        let middle = top + LINE_PX / 2.0;
        let base = middle + 4.5;
        match self {
            Self::Map { range, what } => {
                const NAME: &str = "map";
                let [low, high] = ends(range);
                svg.words(what, [left, base], WORDS);
                let low_left = left + text_px(what) + 8.0;
                svg.words(&low, [low_left, base], WORDS);
                let bar_left = low_left + text_px(&low) + 6.0;
                let colors: Vec<Rgb> = (0..=10).map(|step| viridis(f64::from(step) / 10.0)).collect();
                svg.gradient(NAME, &colors);
                svg.rectangle([bar_left, middle - BAR_PX[1] / 2.0], BAR_PX, &format!("url(#{NAME})"));
                svg.words(&high, [bar_left + BAR_PX[0] + 6.0, base], WORDS);
            }
            Self::Key { color, what, is_line: true } => {
                svg.line([[left, middle], [left + 16.0, middle]], 2.5, &hex(color));
                svg.words(what, [left + 24.0, base], WORDS);
            }
            Self::Key { color, what, is_line: false } => {
                svg.rectangle([left, middle - 6.0], [16.0, 12.0], &hex(color));
                svg.words(what, [left + 24.0, base], WORDS);
            }
        }
        self.width()
    }
}

/// The ends of a range in words: with a sign where values lie beyond.
fn ends(range: Range) -> [String; 2] {
    let [below, above] = range.is_exceeded;
    let low = format!("{}{}", if below { "≤ " } else { "" }, told(range.low_mm));
    let high = format!("{}{} mm", if above { "≥ " } else { "" }, told(range.high_mm));
    [low, high]
}
