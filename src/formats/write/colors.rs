//! The colours of the drawing room as glTF and JSON have them.

use crate::drawing::colors::{hex, viridis_shares};

/// The colour at a share from 0 to 1, in the linear light that glTF vertex colours are in; outside it is that of the
/// nearer end.
#[must_use]
pub fn viridis_linear(share: f64) -> [f64; 3] {
    // NaN: no colour of the map, so that it is seen.
    viridis_shares(share).unwrap_or([0.5; 3]).map(linear)
}

/// The sRGB transfer function (IEC 61966-2-1).
fn linear(srgb: f64) -> f64 {
    if srgb <= 0.040_45 { srgb / 12.92 } else { ((srgb + 0.055) / 1.055).powf(2.4) }
}

/// `#rrggbb`.
pub(super) fn hex_color(color: [u8; 3]) -> String {
    hex(color)
}
