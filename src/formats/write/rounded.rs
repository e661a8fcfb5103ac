//! Numbers as they are written into text: six decimals, so a nanometre; what is no finite
//! number is `null`.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Six decimals, never −0.
pub(crate) fn round(x: f64) -> f64 {
    let rounded = (x * 1e6).round() / 1e6;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// A number that is written rounded to six decimals. `null` is read as what is no number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rounded(pub f64);

impl Serialize for Rounded {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let value = round(self.0);
        if value.is_finite() { serializer.serialize_f64(value) } else { serializer.serialize_none() }
    }
}

impl<'de> Deserialize<'de> for Rounded {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(Self(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN)))
    }
}

impl From<f64> for Rounded {
    fn from(value: f64) -> Self {
        Self(value)
    }
}

/// Numbers one by one.
pub(super) fn numbers(values: &[f64]) -> Vec<Rounded> {
    values.iter().copied().map(Rounded).collect()
}

/// Numbers that may be absent.
pub(super) fn optional(values: &[Option<f64>]) -> Vec<Option<Rounded>> {
    values.iter().map(|value| value.map(Rounded)).collect()
}

/// Points of the plane as pairs.
pub(super) fn pairs(points: &[Point2<f64>]) -> Vec<[Rounded; 2]> {
    points.iter().map(|p| [Rounded(p.x), Rounded(p.y)]).collect()
}

/// Points in space as triples.
pub(super) fn triples(points: &[Point3<f64>]) -> Vec<[Rounded; 3]> {
    points.iter().map(|p| triple(p.coords)).collect()
}

/// A displacement as a triple.
pub(super) fn triple(v: Vector3<f64>) -> [Rounded; 3] {
    [Rounded(v.x), Rounded(v.y), Rounded(v.z)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_finite() {
        let text = serde_json::to_string(&numbers(&[0.1 + 0.2, -1e-9, f64::NAN, f64::INFINITY, 12.0])).unwrap();
        assert_eq!(text, "[0.3,0.0,null,null,12.0]");
    }

    #[test]
    fn what_was_written_is_read_and_written_again() {
        let text = "[0.3,null,12.0]";
        let read: Vec<Rounded> = serde_json::from_str(text).unwrap();
        assert!((read[0].0 - 0.3).abs() < 1e-15 && read[1].0.is_nan());
        assert_eq!(serde_json::to_string(&read).unwrap(), text);
    }
}
