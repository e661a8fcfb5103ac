//! A perceptual, colour-blind safe colour map.

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

/// The colour at a share from 0 to 1, in the linear light that glTF vertex colours are in; outside it is that of the
/// nearer end.
#[must_use]
pub fn viridis_linear(share: f64) -> [f64; 3] {
    viridis_srgb(share).map(linear)
}

fn viridis_srgb(share: f64) -> [f64; 3] {
    let at = share.clamp(0.0, 1.0) * 10.0;
    let Some(step) = (0..10_u8).rev().find(|step| f64::from(*step) <= at) else {
        // NaN: no colour of the map, so that it is seen.
        return [0.5; 3];
    };
    let (low, high) = (VIRIDIS[usize::from(step)], VIRIDIS[usize::from(step) + 1]);
    let between = at - f64::from(step);
    std::array::from_fn(|n| (low[n] + (high[n] - low[n]) * between) / 255.0)
}

/// The sRGB transfer function (IEC 61966-2-1).
fn linear(srgb: f64) -> f64 {
    if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// `#rrggbb`.
pub(super) fn hex_color([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}
