//! Colours as DICOM has them (CIELab) → red, green, blue.

/// Largest of the stored numbers.
const FULL: f64 = 65_535.0;
/// White of the colour space in which DICOM tells colours (PS3.3 C.10.7.1.1: D50), X, Y, Z.
const WHITE: [f64; 3] = [0.964_22, 1.0, 0.825_21];
/// From X, Y, Z with that white to linear red, green, blue of sRGB (Bradford adaptation to D65).
const RGB_FROM_XYZ: [[f64; 3]; 3] = [
    [3.133_856_1, -1.616_866_7, -0.490_614_6],
    [-0.978_768_4, 1.916_141_5, 0.033_454_0],
    [0.071_945_3, -0.228_991_4, 1.405_242_7],
];

/// The colour that three stored numbers mean; what sRGB does not have becomes the nearest that it has.
pub(super) fn rgb([lightness, a, b]: [u16; 3]) -> [u8; 3] {
    let lightness = 100.0 * f64::from(lightness) / FULL;
    let [a, b] = [a, b].map(|stored| 255.0 * f64::from(stored) / FULL - 128.0);
    let middle = (lightness + 16.0) / 116.0;
    let xyz = [middle + a / 500.0, middle, middle - b / 200.0];
    let mut colors = [0; 3];
    for (color, row) in colors.iter_mut().zip(RGB_FROM_XYZ) {
        let mut linear = 0.0;
        for axis in 0..3 {
            linear += row[axis] * WHITE[axis] * uncompressed(xyz[axis]);
        }
        *color = companded(linear);
    }
    colors
}

/// The inverse of the cube root that CIELab begins with, which is straight near black.
fn uncompressed(value: f64) -> f64 {
    if value > 6.0 / 29.0 { value.powi(3) } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (value - 4.0 / 29.0) }
}

/// Linear light to a stored value of sRGB.
fn companded(linear: f64) -> u8 {
    let value = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    let byte = (255.0 * value).round().clamp(0.0, 255.0) as u8;
    byte
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_those_of_the_standard_white() {
        for (lab, expected) in [
            ([54.29, 80.81, 69.89], [255, 0, 0]),
            ([29.57, 68.30, -112.03], [0, 0, 255]),
            ([100.0, 0.0, 0.0], [255, 255, 255]),
            ([53.585, 0.0, 0.0], [128, 128, 128]),
            ([0.0, 0.0, 0.0], [0, 0, 0]),
        ] {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "in the range of the scale")]
            let stored = [lab[0] / 100.0, (lab[1] + 128.0) / 255.0, (lab[2] + 128.0) / 255.0]
                .map(|share: f64| (share * FULL).round() as u16);
            let found = rgb(stored);
            let off = found.iter().zip(expected).map(|(found, wanted): (&u8, u8)| found.abs_diff(wanted)).max();
            assert!(off <= Some(1), "{lab:?}: {found:?}");
        }
    }
}
