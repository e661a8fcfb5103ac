//! Numbers as a sentence has them: three digits that mean something, be they of metres or of micrometres.

/// Digits that are told. With two, 0.0025 mm could not be told from 0.0024, a voxel of micro-CT from the next; more
/// than three are beyond what a mask knows.
const DIGITS: i32 = 3;

/// A number with three significant digits and without an exponent: `0.00246`, `1.30`, `12.3`, `1234`.
#[must_use]
pub fn significant(value: f64) -> String {
    let decimals = (DIGITS - 1 - exponent(value)).max(0);
    format!("{value:.*}", usize::try_from(decimals).unwrap_or(0))
}

/// The least number of three significant digits that is not below `value`, which is above 0.
#[must_use]
pub fn rounded_up(value: f64) -> f64 {
    let decimals = DIGITS - 1 - exponent(value);
    // Powers of ten up to 22 are exact, a tenth of anything is not.
    let up = if decimals >= 0 {
        let power = 10f64.powi(decimals);
        (value * power).ceil() / power
    } else {
        let power = 10f64.powi(-decimals);
        (value / power).ceil() * power
    };
    up.max(value)
}

/// Of the first digit, after rounding to as many as are told; 0 for 0 and for what is no number.
fn exponent(value: f64) -> i32 {
    format!("{value:.*e}", 2).rsplit('e').next().and_then(|digits| digits.parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_are_told_at_any_size() {
        let told = [0.002_455_86, 0.000_025, 1.3, 9.996, 12.34, 1234.4, -0.5, 0.0].map(significant);
        assert_eq!(told, ["0.00246", "0.0000250", "1.30", "10.0", "12.3", "1234", "-0.500", "0.00"]);
        assert_eq!(significant(f64::INFINITY), "inf");
    }

    #[test]
    fn a_number_rounded_up_is_not_below_and_is_told_as_it_is() {
        for value in [0.000_614, 0.002_455_86, 0.123_000_001, 1.0, 2.341, 99.95, 1234.4] {
            let up = rounded_up(value);
            assert!(up >= value && up <= 1.01 * value, "{value}: {up}");
            assert!(significant(up).parse::<f64>().is_ok_and(|told| told >= value), "{value}: {}", significant(up));
        }
    }
}
