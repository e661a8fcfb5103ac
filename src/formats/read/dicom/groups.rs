//! The functional groups: what frames say of themselves, and what is said of all of them.

use nalgebra::Vector3;

use super::error::DicomFault;
use super::tag::{Tag, TagPath};
use super::values::{Item, decimals};
use crate::formats::read::error::ReadError;

/// Voxel edges that make sense for anatomy, mm, as of NIfTI.
pub(super) const EDGE_MM: std::ops::RangeInclusive<f64> = 1e-4..=1e3;
/// How far rows and columns may be from unit vectors at right angles. Writers round to three decimals; with more, a
/// sheared grid would pass.
const SQUARE: f64 = 1e-3;
/// Difference of direction cosines that counts as none. With less, rounding would make two orientations of one; with
/// more, the far corner of a slice of 512 voxels would be off by a tenth of one.
const SAME_COSINE: f64 = 1e-4;
/// The same of voxel edges, as a share.
const SAME_EDGE: f64 = 1e-4;

/// Attributes of a frame, or of all.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Groups {
    position: Option<Vector3<f64>>,
    orientation: Option<[f64; 6]>,
    measures: Option<Measures>,
    pub segment: Option<u16>,
    pub is_on_slide: bool,
}

/// Distances in and between slices, mm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measures {
    /// Between rows, and between columns.
    pub spacing: [f64; 2],
    /// Between slices, if told.
    pub between: Option<f64>,
    pub thickness: Option<f64>,
}

/// The way that all frames lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Directions of rows and columns, LPS.
    pub along: [Vector3<f64>; 2],
    /// Across both, of length 1.
    pub normal: Vector3<f64>,
    pub measures: Measures,
    orientation: [f64; 6],
}

impl Groups {
    /// From an item of the shared or the frames' groups, to which `path` leads.
    ///
    /// # Errors
    /// When a value is senseless.
    pub fn read(item: &Item, path: &TagPath) -> Result<Self, ReadError> {
        let group = |tag| item.first(tag).map(|item| (item, path.clone().join(tag).item(1)));
        let position = match group(Tag::PLANE_POSITION) {
            Some((item, path)) => numbers(item, Tag::POSITION, POSITION, &path)?.map(Vector3::from),
            None => None,
        };
        let orientation = match group(Tag::PLANE_ORIENTATION) {
            Some((item, path)) => numbers(item, Tag::ORIENTATION, ORIENTATION, &path)?,
            None => None,
        };
        let measures = match group(Tag::PIXEL_MEASURES) {
            Some((item, path)) => Measures::read(item, &path)?,
            None => None,
        };
        let segment = group(Tag::SEGMENT_IDENTIFICATION).and_then(|(item, _)| item.shorts(Tag::REFERENCED_SEGMENT));
        let segment = segment.and_then(|numbers| numbers.first().copied());
        let is_on_slide = item.first(Tag::SLIDE_POSITION).is_some();
        Ok(Self { position, orientation, measures, segment, is_on_slide })
    }

    /// What a frame says of itself, else what is said of all, group by group.
    pub fn or(self, shared: &Self) -> Self {
        Self {
            position: self.position.or(shared.position),
            orientation: self.orientation.or(shared.orientation),
            measures: self.measures.or(shared.measures),
            segment: self.segment.or(shared.segment),
            is_on_slide: self.is_on_slide || shared.is_on_slide,
        }
    }

    /// Where the frame lies, LPS; else what is missing.
    pub fn place(&self) -> Result<(Vector3<f64>, [f64; 6], Measures), &'static str> {
        let position = self.position.ok_or("ImagePositionPatient")?;
        let orientation = self.orientation.ok_or("ImageOrientationPatient")?;
        Ok((position, orientation, self.measures.ok_or("PixelSpacing")?))
    }
}

impl Measures {
    fn read(item: &Item, path: &TagPath) -> Result<Option<Self>, ReadError> {
        let Some(spacing) = numbers(item, Tag::PIXEL_SPACING, SPACING, path)? else { return Ok(None) };
        if !spacing.iter().all(|edge| EDGE_MM.contains(edge)) {
            return Err(bad(SPACING, path.clone().join(Tag::PIXEL_SPACING)));
        }
        let length = |tag, told| -> Result<Option<f64>, ReadError> {
            let found = numbers::<1>(item, tag, told, path)?;
            // Some modalities count slices downwards; 0 means that it is not known.
            Ok(found.map(|[mm]| mm.abs()).filter(|mm| *mm > 0.0))
        };
        let between = length(Tag::SPACING_BETWEEN_SLICES, BETWEEN)?;
        Ok(Some(Self { spacing, between, thickness: length(Tag::SLICE_THICKNESS, THICKNESS)? }))
    }
}

impl Plane {
    /// Checks that rows and columns are unit vectors at right angles; `path` leads to them.
    ///
    /// # Errors
    /// When they are not.
    pub fn new(orientation: [f64; 6], measures: Measures, path: TagPath) -> Result<Self, ReadError> {
        let [a, b, c, d, e, f] = orientation;
        let along = [Vector3::new(a, b, c), Vector3::new(d, e, f)];
        let is_unit = |direction: &Vector3<f64>| (direction.norm() - 1.0).abs() <= SQUARE;
        if !along.iter().all(is_unit) || along[0].dot(&along[1]).abs() > SQUARE {
            return Err(bad(ORIENTATION, path));
        }
        Ok(Self { along, normal: along[0].cross(&along[1]).normalize(), measures, orientation })
    }

    /// What differs in a frame that lies another way.
    pub fn difference(&self, orientation: [f64; 6], measures: Measures) -> Option<&'static str> {
        let turned = self.orientation.iter().zip(orientation).any(|(a, b)| (a - b).abs() > SAME_COSINE);
        let mut edges = self.measures.spacing.iter().zip(measures.spacing);
        let resized = edges.any(|(a, b)| (a - b).abs() > SAME_EDGE * a);
        match (turned, resized) {
            (true, _) => Some(ORIENTATION.0),
            (_, true) => Some(SPACING.0),
            (false, false) => None,
        }
    }
}

/// Name of an element, and what it may be.
type Told = (&'static str, &'static str);
const POSITION: Told = ("ImagePositionPatient", "three numbers below 10000000 mm");
const ORIENTATION: Told = ("ImageOrientationPatient", "two unit vectors at right angles");
const SPACING: Told = ("PixelSpacing", "two numbers from 0.0001 to 1000 mm");
const BETWEEN: Told = ("SpacingBetweenSlices", "a number of millimetres");
const THICKNESS: Told = ("SliceThickness", "a number of millimetres");

fn bad((name, allowed): Told, path: TagPath) -> ReadError {
    DicomFault::BadValue { name, allowed }.at(path)
}

/// Numbers of an element in an item to which `path` leads; `None` where it is missing or empty.
fn numbers<const N: usize>(item: &Item, tag: Tag, told: Told, path: &TagPath) -> Result<Option<[f64; N]>, ReadError> {
    let Some(bytes) = item.bytes(tag).filter(|bytes| !bytes.iter().all(|byte| matches!(byte, b' ' | 0))) else {
        return Ok(None);
    };
    decimals(bytes).map(Some).ok_or_else(|| bad(told, path.clone().join(tag)))
}
