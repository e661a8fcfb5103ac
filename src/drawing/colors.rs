//! Colours that colour-blind people can tell apart: those of the page and of the meshes too.

/// Red, green and blue, sRGB.
pub type Rgb = [u8; 3];

/// Viridis at equal steps, sRGB 0–255 (van der Walt and Smith, 2015).
const VIRIDIS: [[f64; 3]; 11] = [
    [68.0, 1.0, 84.0],
    [72.0, 36.0, 117.0],
    [65.0, 68.0, 135.0],
    [53.0, 95.0, 141.0],
    [42.0, 120.0, 142.0],
    [33.0, 145.0, 140.0],
    [34.0, 168.0, 132.0],
    [68.0, 191.0, 112.0],
    [122.0, 209.0, 81.0],
    [189.0, 223.0, 38.0],
    [253.0, 231.0, 37.0],
];

/// Okabe and Ito's colours, which tell things of several kinds apart; last the yellow one, which is hardly seen on white.
const CATEGORIES: [Rgb; 7] =
    [[0, 114, 178], [230, 159, 0], [0, 158, 115], [204, 121, 167], [86, 180, 233], [213, 94, 0], [240, 228, 66]];

/// The colour at a share from 0 to 1 as shares of full sRGB; outside it is that of the nearer end. `None` of what is no
/// number.
#[must_use]
pub fn viridis_shares(share: f64) -> Option<[f64; 3]> {
    let at = share.clamp(0.0, 1.0) * 10.0;
    let step = (0..10_u8).rev().find(|step| f64::from(*step) <= at)?;
    let (low, high) = (VIRIDIS[usize::from(step)], VIRIDIS[usize::from(step) + 1]);
    let between = at - f64::from(step);
    Some(std::array::from_fn(|n| (low[n] + (high[n] - low[n]) * between) / 255.0))
}

/// What has no number: no colour of the map, so that it is seen.
pub const NO_THICKNESS: Rgb = [150; 3];

/// The same as a colour; grey for what is no number.
#[must_use]
pub fn viridis(share: f64) -> Rgb {
    viridis_shares(share).map_or(NO_THICKNESS, |shares| shares.map(|part| byte(255.0 * part)))
}

/// The colour of the thing of that number; they come again after seven.
#[must_use]
pub fn category(number: usize) -> Rgb {
    CATEGORIES[number % CATEGORIES.len()]
}

/// A share of the way from a colour to another.
#[must_use]
pub fn mixed(from: Rgb, to: Rgb, share: f64) -> Rgb {
    std::array::from_fn(|n| {
        let (from, to) = (f64::from(from[n]), f64::from(to[n]));
        byte(from + (to - from) * share.clamp(0.0, 1.0))
    })
}

/// `#rrggbb`.
#[must_use]
pub fn hex([red, green, blue]: Rgb) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// The nearest whole number that is a part of a colour.
fn byte(value: f64) -> u8 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "kept between 0 and 255; NaN is 0")]
    let byte = value.round().clamp(0.0, 255.0) as u8;
    byte
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_colour_map_ends_where_its_table_does_and_has_none_for_no_number() {
        assert_eq!([viridis(-1.0), viridis(0.0), viridis(0.5)], [[68, 1, 84], [68, 1, 84], [33, 145, 140]]);
        assert_eq!([viridis(1.0), viridis(7.0), viridis(f64::NAN)], [[253, 231, 37], [253, 231, 37], [150; 3]]);
    }

    #[test]
    fn colours_mix_and_are_written_as_css_has_them() {
        assert_eq!(mixed([0, 100, 255], [255, 100, 0], 0.5), [128, 100, 128]);
        assert_eq!(hex([1, 35, 255]), "#0123ff");
        assert_eq!(category(8), category(1));
    }
}
