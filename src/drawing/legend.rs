//! What colours and lengths of a picture mean.

use super::colors::Rgb;
use crate::model::Structure;
use crate::numerics::stats::percentile;

/// Lengths that the ends of the colour map stand for, mm. What lies beyond has the colour of the nearer end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Lower end.
    pub low_mm: f64,
    /// Upper end.
    pub high_mm: f64,
    /// Whether some values lie below, and above.
    pub is_exceeded: [bool; 2],
}

/// An entry of a legend.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// The colour map of a length.
    Map {
        /// What its ends stand for.
        range: Range,
        /// Which length it is.
        what: String,
    },
    /// Colours with what they stand for.
    Keys(Vec<Key>),
}

/// A colour and what it stands for.
#[derive(Clone, Debug, PartialEq)]
pub struct Key {
    /// The colour.
    pub color: Rgb,
    /// What it stands for.
    pub what: String,
    /// Whether it is one of lines; else of faces or dots.
    pub is_line: bool,
}

impl Range {
    /// Round numbers round the middle nine tenths of the thicknesses of structures: a few vectors that run astray must
    /// not take the colours from all others.
    #[must_use]
    pub fn of_thickness<'a>(structures: impl IntoIterator<Item = &'a Structure>) -> Self {
        let mut totals = Vec::new();
        for structure in structures {
            for sheet in structure.sheets() {
                for (total, is_seen) in sheet.total_mm().into_iter().zip(sheet.drawable()) {
                    if is_seen {
                        totals.push(total);
                    }
                }
            }
            for tube in structure.tubes() {
                totals.extend(tube.total_mm());
            }
        }
        Self::round(totals)
    }

    /// Round numbers round the middle nine tenths of values; 0 to 1 without any.
    #[must_use]
    pub fn round(mut values: Vec<f64>) -> Self {
        values.retain(|value| value.is_finite());
        values.sort_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (values.first(), values.last()) else {
            return Self { low_mm: 0.0, high_mm: 1.0, is_exceeded: [false; 2] };
        };
        let low = percentile(&values, 5).unwrap_or(least);
        let high = percentile(&values, 95).unwrap_or(most);
        let step = round_step((high - low).max(1e-3 * high.abs()).max(1e-9) / 4.0);
        let (low_mm, high_mm) = ((low / step).floor() * step, (high / step).ceil() * step);
        let high_mm = if high_mm > low_mm { high_mm } else { low_mm + step };
        Self { low_mm, high_mm, is_exceeded: [least < low_mm, most > high_mm] }
    }

    /// Where a length lies between the ends, from 0 to 1.
    #[must_use]
    pub fn share(&self, length_mm: f64) -> f64 {
        (length_mm - self.low_mm) / (self.high_mm - self.low_mm)
    }
}

/// The largest of 1, 2 and 5 times a power of ten that is not above a length; for steps of scales and scale bars.
#[must_use]
pub fn round_step(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    // A hair less: 0.1 is not the tenth part of 1 to the last digit.
    let most = length / power * (1.0 + 1e-9);
    let digit = [5.0, 2.0].into_iter().find(|digit| *digit <= most).unwrap_or(1.0);
    digit * power
}

/// A length of a scale in words, with no more digits than it has.
#[must_use]
pub fn told(length: f64) -> String {
    let told = format!("{length:.4}");
    told.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_round_and_say_what_lies_beyond() {
        let mut values: Vec<f64> = (0..101).map(|n| 4.0 + 0.08 * f64::from(n)).collect();
        values.extend([90.0, f64::NAN]);
        let range = Range::round(values);
        assert_eq!((range.low_mm, range.high_mm, range.is_exceeded), (4.0, 12.0, [false, true]));
        assert_eq!([range.share(4.0), range.share(8.0)], [0.0, 0.5]);
        let even = Range::round(vec![7.0; 9]);
        assert!(even.low_mm <= 7.0 && even.high_mm >= 7.0 && even.high_mm > even.low_mm, "{even:?}");
        assert_eq!(Range::round(Vec::new()).high_mm, 1.0);
    }

    #[test]
    fn steps_are_one_two_or_five() {
        let steps = [0.1, 0.3, 0.99, 1.0, 4.9, 7.0, 20.0, 333.0].map(round_step).map(told);
        assert_eq!(steps, ["0.1", "0.2", "0.5", "1", "2", "5", "20", "200"]);
    }
}
