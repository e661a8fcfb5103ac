//! Numbers as they are written into text: six decimals, so a nanometre; what is no finite
//! number is `null`.

use nalgebra::{Point2, Point3, Vector3};
use serde::{Serialize, Serializer};

/// Six decimals, never −0.
pub(super) fn round(x: f64) -> f64 {
    let rounded = (x * 1e6).round() / 1e6;
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// A number rounded by [`round`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Rounded(pub f64);

impl Serialize for Rounded {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let value = round(self.0);
        if value.is_finite() { serializer.serialize_f64(value) } else { serializer.serialize_none() }
    }
}

/// What can be listed as numbers.
pub(super) trait Coordinates {
    /// The numbers.
    type List: Serialize;
    fn list(&self) -> Self::List;
}

impl Coordinates for f64 {
    type List = Rounded;
    fn list(&self) -> Rounded {
        Rounded(*self)
    }
}

impl Coordinates for Point2<f64> {
    type List = [Rounded; 2];
    fn list(&self) -> [Rounded; 2] {
        [Rounded(self.x), Rounded(self.y)]
    }
}

impl Coordinates for Point3<f64> {
    type List = [Rounded; 3];
    fn list(&self) -> [Rounded; 3] {
        self.coords.list()
    }
}

impl Coordinates for Vector3<f64> {
    type List = [Rounded; 3];
    fn list(&self) -> [Rounded; 3] {
        [Rounded(self.x), Rounded(self.y), Rounded(self.z)]
    }
}

/// A list of points, vectors or numbers, written one by one.
pub(super) struct List<'a, T>(pub &'a [T]);

impl<T: Coordinates> Serialize for List<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(Coordinates::list))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_finite() {
        let text = serde_json::to_string(&List(&[0.1 + 0.2, -1e-9, f64::NAN, f64::INFINITY, 12.0])).unwrap();
        assert_eq!(text, "[0.3,0.0,null,null,12.0]");
    }
}
