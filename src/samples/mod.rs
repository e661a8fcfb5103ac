//! Analytic shapes whose medial sheets are known: masks to try the program on, and the planted
//! answers of its tests.
//!
//! Every shape is a union of balls centred on known sheets, in world millimetres; it can be
//! voxelised at any spacing and orientation.

mod patch;

mod shapes;

mod voxelise;

use crate::numerics::points::Points;
use crate::space::WorldPoint;

pub use patch::{Ball, Patch};
pub use voxelise::VoxeliseError;

/// A band of balls of nearly the same radius, mm: the nearest centre need not be the nearest
/// ball, within a band it is to this accuracy at worst and exactly for constant radius.
const RADIUS_BAND_MM: f64 = 0.1;

/// Voxel spacing of a sample that is asked for without one, mm.
pub const SPACING_MM: f64 = 1.0;

/// Every sample's name and what it is.
pub fn list() -> impl Iterator<Item = (&'static str, &'static str)> {
    shapes::SHAPES.iter().map(|(name, about, _)| (*name, *about))
}

/// The sample of that name.
#[must_use]
pub fn by_name(name: &str) -> Option<Sample> {
    shapes::SHAPES.iter().find(|(known, _, _)| *known == name).map(shapes::build)
}

/// One or several solids with their labels.
pub struct Sample {
    name: &'static str,
    about: &'static str,
    solids: Vec<Solid>,
}

impl Sample {
    /// From a name, what it is in a few words, and its solids, each with a label of its own.
    #[must_use]
    pub fn new(name: &'static str, about: &'static str, solids: Vec<Solid>) -> Self {
        Self { name, about, solids }
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// What it is, in a few words.
    #[must_use]
    pub fn about(&self) -> &'static str {
        self.about
    }

    /// The objects, each with its label.
    #[must_use]
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// The objects alone.
    #[must_use]
    pub fn into_solids(self) -> Vec<Solid> {
        self.solids
    }

    /// Distance to the skin of the nearest solid, negative inside, mm.
    #[must_use]
    pub fn signed_mm(&self, point: WorldPoint) -> f64 {
        self.solids.iter().map(|solid| solid.signed_mm(point)).fold(f64::INFINITY, f64::min)
    }

    /// Distance to the nearest true medial sheet, mm.
    #[must_use]
    pub fn to_sheet_mm(&self, point: WorldPoint) -> f64 {
        self.solids.iter().map(|solid| solid.to_sheet_mm(point)).fold(f64::INFINITY, f64::min)
    }
}

/// One labelled object: a union of balls centred on its sheets.
pub struct Solid {
    label: u16,
    patches: Vec<Patch>,
    balls: Vec<Vec<Ball>>,
    sheet_trees: Vec<Points>,
    bands: Vec<Band>,
}

struct Band {
    tree: Points,
    balls: Vec<Ball>,
}

impl Solid {
    /// From its value in a label map, not 0, and its sheets.
    #[must_use]
    pub fn new(label: u16, patches: Vec<Patch>) -> Self {
        let balls: Vec<Vec<Ball>> = patches.iter().map(Patch::balls).collect();
        let sheet_trees = balls.iter().map(|part| tree_of(part.iter())).collect();
        let bands = bands(&balls);
        Self { label, patches, balls, sheet_trees, bands }
    }

    /// Its value in a label map.
    #[must_use]
    pub fn label(&self) -> u16 {
        self.label
    }

    /// How many single sheets it has; a ball and a tube have one degenerate sheet.
    #[must_use]
    pub fn sheets(&self) -> usize {
        self.patches.len()
    }

    /// The balls of all its sheets.
    pub fn balls(&self) -> impl Iterator<Item = &Ball> {
        self.balls.iter().flatten()
    }

    /// Distance to its skin, negative inside, mm.
    #[must_use]
    pub fn signed_mm(&self, point: WorldPoint) -> f64 {
        let to_band = |band: &Band| {
            let (index, distance) = nearest(&band.tree, &band.balls, point);
            distance - band.balls[index].radius_mm
        };
        self.bands.iter().map(to_band).fold(f64::INFINITY, f64::min)
    }

    /// Distance to its nearest true medial sheet, mm.
    #[must_use]
    pub fn to_sheet_mm(&self, point: WorldPoint) -> f64 {
        self.foot(point).1
    }

    /// Radius of the largest ball at the sheet point nearest to `point`, mm.
    #[must_use]
    pub fn radius_mm(&self, point: WorldPoint) -> f64 {
        self.foot(point).0
    }

    /// Radius at the nearest sheet point, and the distance to it.
    fn foot(&self, point: WorldPoint) -> (f64, f64) {
        let mut best = (0.0, f64::INFINITY);
        for ((patch, balls), tree) in self.patches.iter().zip(&self.balls).zip(&self.sheet_trees) {
            let at = patch.nearest(point, balls[nearest(tree, balls, point).0].at);
            let distance = (point - patch.position(at)).norm();
            if distance < best.1 {
                best = (patch.radius_mm(at), distance);
            }
        }
        best
    }
}

fn bands(balls: &[Vec<Ball>]) -> Vec<Band> {
    let mut sorted: Vec<&Ball> = balls.iter().flatten().collect();
    sorted.sort_by(|a, b| a.radius_mm.total_cmp(&b.radius_mm));
    let mut bands = Vec::new();
    let mut rest = sorted.as_slice();
    while let Some(first) = rest.first() {
        let count = rest.partition_point(|ball| ball.radius_mm < first.radius_mm + RADIUS_BAND_MM);
        let (band, after) = rest.split_at(count);
        bands.push(Band { tree: tree_of(band.iter().copied()), balls: band.iter().map(|ball| **ball).collect() });
        rest = after;
    }
    bands
}

fn tree_of<'a>(balls: impl Iterator<Item = &'a Ball>) -> Points {
    Points::new(&balls.map(|ball| ball.center).collect::<Vec<_>>())
}

/// The nearest point of a tree, and how far it is.
fn nearest(tree: &Points, balls: &[Ball], point: WorldPoint) -> (usize, f64) {
    let found = tree.nearest(point).expect("samples are not empty");
    (found, (balls[found].center - point).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Rotation3, Vector3};

    #[test]
    fn the_ellipsoid_knows_its_skin_and_its_sheet() {
        let sample = by_name("ellipsoid").unwrap();
        for (point, signed, sheet) in [
            ([0.0, 0.0, 8.0], 0.0, 8.0),
            ([0.0, 0.0, 3.0], -5.0, 3.0),
            ([30.0, 0.0, 0.0], 0.0, 64.0 / 30.0),
            ([0.0, 10.0, 0.0], -8.0 * (1.0_f64 - 100.0 / 336.0).sqrt(), 0.0),
        ] {
            let point = Point3::from(point);
            assert!((sample.signed_mm(point) - signed).abs() < 0.02, "{point}: {}", sample.signed_mm(point));
            assert!((sample.to_sheet_mm(point) - sheet).abs() < 1e-3, "{point}: {}", sample.to_sheet_mm(point));
        }
    }

    #[test]
    fn a_voxelised_sample_agrees_with_its_signed_distance() {
        let turn = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0)), 0.5);
        for (name, _) in list() {
            let sample = by_name(name).unwrap();
            let volume = sample.voxelise([1.9, 1.4, 2.3], turn).unwrap();
            assert!(!volume.labels().is_empty() || name == "thin", "{name} is empty");
            for offset in (0..volume.indices().as_slice().len()).step_by(97) {
                let [i, j, k] = volume.indices().index(offset).map(|n| n as f64);
                let signed = sample.signed_mm(volume.world_from_voxel().point(Point3::new(i, j, k)));
                let inside = volume.indices().as_slice()[offset] != 0;
                assert!(inside == (signed <= 0.0) || signed.abs() < 1e-9, "{name} at {offset}: {signed}");
            }
        }
    }

    #[test]
    fn points_of_a_sheet_are_on_it() {
        for (name, _) in list() {
            for solid in by_name(name).unwrap().solids() {
                for ball in solid.balls().step_by(431) {
                    assert!(solid.to_sheet_mm(ball.center) < 1e-6, "{name}");
                }
            }
        }
    }

    #[test]
    fn two_has_both_labels_apart() {
        let volume = by_name("two").unwrap().voxelise([1.0; 3], Rotation3::identity()).unwrap();
        assert_eq!(volume.labels().iter().map(|label| label.value).collect::<Vec<_>>(), [11, 2101]);
        assert!(volume.voxels_of(1) > 0 && volume.voxels_of(2) > 0);
    }
}
