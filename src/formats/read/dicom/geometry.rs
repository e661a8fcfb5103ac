//! Frames → slices of a volume. Where a frame lies along the normal says which slice it is; its number and its
//! dimension indices say nothing that can be trusted.

use nalgebra::Vector3;

use super::error::DicomFault;
use super::groups::{EDGE_MM, Plane};
use super::tag::{Tag, TagPath};
use crate::formats::read::error::ReadError;
use crate::space::{VolumeNotice, WorldFromVoxel, significant};

/// Share of a voxel's edge in the slice by which positions differ that are rounded. With less, rounding to hundredths
/// would make two slices of one; with more, slices of a hundredth of that edge would become one.
const ROUNDING: f64 = 0.01;
/// Share of the step by which slices may be off it. With less, positions that are rounded to tenths would be uneven;
/// with more, a missing tenth of a millimetre would be read as if it was there.
const UNEVEN: f64 = 0.02;
/// Share of a voxel's edge by which slices may be shifted sideways. A stack of 300 mm whose directions are rounded to
/// four decimals is off by 0.03 mm; with more, a gantry tilted by a degree would pass in a few slices.
const SIDEWAYS: f64 = 0.2;
/// Along which axis of the volume slices follow one another.
pub(super) const SLICES: usize = 2;

/// A frame as far as its place goes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    /// Centre of its first voxel, LPS, mm.
    pub position: Vector3<f64>,
    /// The segment that it shows; 0 where it shows all.
    pub segment: u16,
}

/// How frames make a volume, with an empty slice at both ends: what lies beyond those that are stored is not known.
#[derive(Debug)]
pub(super) struct Stack {
    /// Columns, rows, slices.
    pub dims: [usize; 3],
    pub world_from_voxel: WorldFromVoxel,
    /// By frame.
    pub slice_of: Vec<usize>,
}

/// Slices that have frames: where along the normal, which one of the volume, and one of its frames.
struct Slices {
    depth_mm: Vec<f64>,
    frame: Vec<usize>,
    /// By frame, which of them it is.
    of_frame: Vec<usize>,
}

/// A step that all slices fit.
struct Steps {
    step_mm: f64,
    /// Number of each slice that has frames, from 0.
    number: Vec<u64>,
}

impl Stack {
    /// # Errors
    /// When slices are uneven or shifted sideways, a single one has no thickness, or there are too many voxels.
    pub fn of(
        frames: &[Frame],
        plane: &Plane,
        [columns, rows]: [usize; 2],
        max_voxels: u64,
        notices: &mut Vec<VolumeNotice>,
    ) -> Result<Self, ReadError> {
        let slices = Slices::of(frames, plane);
        let steps = slices.steps(plane, notices)?;
        let last = steps.number.last().copied().unwrap_or(0);
        let voxels = columns as u128 * rows as u128 * (u128::from(last) + 3);
        let too_many = || DicomFault::TooManyVoxels { voxels, allowed: max_voxels }.at(TagPath::top(Tag::ROWS));
        if voxels > u128::from(max_voxels) {
            return Err(too_many());
        }
        let count = usize::try_from(last + 3).map_err(|_| too_many())?;
        let first = slices.frame.first().and_then(|frame| frames.get(*frame)).map_or(Vector3::zeros(), |f| f.position);
        check_upright(frames, plane, &slices, &steps, first)?;
        let mut slice_of = Vec::with_capacity(frames.len());
        for slice in slices.of_frame {
            slice_of.push(usize::try_from(steps.number[slice] + 1).map_err(|_| too_many())?);
        }
        let world_from_voxel = world_from_voxel(plane, steps.step_mm, first)?;
        Ok(Self { dims: [columns, rows, count], world_from_voxel, slice_of })
    }
}

impl Slices {
    fn of(frames: &[Frame], plane: &Plane) -> Self {
        let depth_of = |frame: usize| plane.normal.dot(&frames[frame].position);
        let mut order: Vec<usize> = (0..frames.len()).collect();
        order.sort_by(|a, b| depth_of(*a).total_cmp(&depth_of(*b)).then(a.cmp(b)));
        let mut slices = Self { depth_mm: Vec::new(), frame: Vec::new(), of_frame: vec![0; frames.len()] };
        for frame in order {
            let depth_mm = depth_of(frame);
            if slices.depth_mm.last().is_none_or(|last| depth_mm - last > rounding(plane)) {
                slices.depth_mm.push(depth_mm);
                slices.frame.push(frame);
            }
            slices.of_frame[frame] = slices.depth_mm.len() - 1;
        }
        slices
    }

    /// The step that the file tells where all slices fit it, else that of the nearest two.
    fn steps(&self, plane: &Plane, notices: &mut Vec<VolumeNotice>) -> Result<Steps, ReadError> {
        if self.depth_mm.len() < 2 {
            return Ok(Steps { step_mm: single(plane, notices)?, number: vec![0] });
        }
        let told = plane.measures.between;
        let least = self.depth_mm.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        if let Some(steps) = told.and_then(|step| self.fit(step, plane)) {
            if least > 1.5 * steps.step_mm {
                let step = significant(steps.step_mm);
                let message =
                    format!("slices are {step} mm apart by SpacingBetweenSlices, and no two neighbours are stored");
                notices.push(VolumeNotice { code: "slices_missing", message });
            }
            return Ok(steps);
        }
        let steps = self.fit(least, plane).ok_or_else(|| self.uneven(plane))?;
        if let Some(told) = told {
            let [told, found] = [told, steps.step_mm].map(significant);
            let message = format!("SpacingBetweenSlices is {told} mm, the slices lie {found} mm apart; that was taken");
            notices.push(VolumeNotice { code: "spacing_disagrees", message });
        }
        Ok(steps)
    }

    /// Numbers of slices by a step, which then becomes that of all of them together; `None` where they do not fit.
    fn fit(&self, step_mm: f64, plane: &Plane) -> Option<Steps> {
        let (first, last) = (self.depth_mm.first()?, self.depth_mm.last()?);
        let mut number = vec![0];
        let mut reached = 0.0;
        for pair in self.depth_mm.windows(2) {
            reached += ((pair[1] - pair[0]) / step_mm).round().max(1.0);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "whole and positive; saturates"
            )]
            number.push(reached as u64);
        }
        let mean_mm = (last - first) / reached;
        let allowed_mm = (UNEVEN * mean_mm).max(rounding(plane));
        let is_off = |(depth, number): (&f64, &u64)| (depth - first - *number as f64 * mean_mm).abs() > allowed_mm;
        let fits = (mean_mm - step_mm).abs() <= UNEVEN * step_mm && !self.depth_mm.iter().zip(&number).any(is_off);
        fits.then_some(Steps { step_mm: mean_mm, number })
    }

    /// The refusal of slices that fit no step: the one whose gap is farthest from the usual.
    fn uneven(&self, plane: &Plane) -> ReadError {
        let mut gaps: Vec<f64> = self.depth_mm.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let all = gaps.clone();
        gaps.sort_by(f64::total_cmp);
        let step_mm = gaps.get(gaps.len().saturating_sub(1) / 2).copied().unwrap_or(0.0).max(rounding(plane));
        let off = |gap: f64| (gap - (gap / step_mm).round().max(1.0) * step_mm).abs();
        let mut worst = (1, 0.0);
        for (slice, gap) in (1..).zip(all) {
            if off(gap) > worst.1 {
                worst = (slice, off(gap));
            }
        }
        let frame = self.frame.get(worst.0).map_or(1, |frame| frame + 1);
        DicomFault::Uneven { frame, off_mm: worst.1, step_mm }.at(position_of(frame))
    }
}

/// Step of a single slice.
fn single(plane: &Plane, notices: &mut Vec<VolumeNotice>) -> Result<f64, ReadError> {
    let (name, step_mm) = match (plane.measures.between, plane.measures.thickness) {
        (Some(step), _) => ("SpacingBetweenSlices", step),
        (None, Some(step)) => ("SliceThickness", step),
        (None, None) => return Err(DicomFault::NoDepth.at(TagPath::top(Tag::FRAME_GROUPS))),
    };
    let message = format!("there is one slice: its depth of {} mm is {name}", significant(step_mm));
    notices.push(VolumeNotice { code: "one_slice", message });
    Ok(step_mm)
}

/// Distance that rounding makes, mm.
fn rounding(plane: &Plane) -> f64 {
    ROUNDING * plane.measures.spacing[0].min(plane.measures.spacing[1])
}

/// Refuses slices that do not lie on one another.
fn check_upright(
    frames: &[Frame],
    plane: &Plane,
    slices: &Slices,
    steps: &Steps,
    first: Vector3<f64>,
) -> Result<(), ReadError> {
    let allowed_mm = SIDEWAYS * plane.measures.spacing[0].min(plane.measures.spacing[1]);
    for (number, frame) in frames.iter().enumerate() {
        let depth_mm = steps.number[slices.of_frame[number]] as f64 * steps.step_mm;
        let off = frame.position - first - plane.normal * depth_mm;
        let off_mm = (off - plane.normal * plane.normal.dot(&off)).norm();
        if off_mm > allowed_mm {
            return Err(DicomFault::Sheared { frame: number + 1, off_mm }.at(position_of(number + 1)));
        }
    }
    Ok(())
}

/// World positions are RAS, DICOM's are LPS. Voxel (0, 0, 0) is one step before the first frame.
fn world_from_voxel(plane: &Plane, step_mm: f64, first: Vector3<f64>) -> Result<WorldFromVoxel, ReadError> {
    const RAS_FROM_LPS: [f64; 3] = [-1.0, -1.0, 1.0];
    let bad = || {
        let fault = DicomFault::BadValue { name: "the distance of slices", allowed: "0.0001 to 1000 mm" };
        fault.at(TagPath::top(Tag::FRAME_GROUPS))
    };
    if !EDGE_MM.contains(&step_mm) {
        return Err(bad());
    }
    let [between_rows, between_columns] = plane.measures.spacing;
    let step = plane.normal * step_mm;
    let columns = [plane.along[0] * between_columns, plane.along[1] * between_rows, step, first - step];
    let rows = std::array::from_fn(|axis| columns.map(|column| RAS_FROM_LPS[axis] * column[axis]));
    WorldFromVoxel::from_rows(rows).map_err(|_| bad())
}

/// The way to the position of a frame, from 1.
fn position_of(frame: usize) -> TagPath {
    let item = u32::try_from(frame).unwrap_or(u32::MAX);
    TagPath::top(Tag::FRAME_GROUPS).item(item).join(Tag::PLANE_POSITION).item(1).join(Tag::POSITION)
}
