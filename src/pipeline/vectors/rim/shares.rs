//! Which part of the solid is a sheet's own: what lies nearer, in power distance, to one of its inscribed balls than to
//! those of all other sheets.

use nalgebra::{Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::balls::Balls;
use crate::pipeline::sides::SheetSides;

/// The shares of the sheets of a structure.
pub struct Shares {
    /// None when there is one sheet.
    balls: Balls,
    sheet_of: Vec<usize>,
}

/// The share of one sheet.
#[derive(Clone, Copy)]
pub struct Share<'a> {
    /// Those of all.
    pub shares: &'a Shares,
    /// The sheet.
    pub number: usize,
}

impl Shares {
    /// Of all sheets.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(sheets: &[SheetSides], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut balls, mut sheet_of) = (Vec::new(), Vec::new());
        if sheets.len() > 1 {
            for (number, sheet) in sheets.iter().enumerate() {
                balls.extend(sheet.medial.positions.iter().copied().zip(sheet.radii.iter().copied()));
                sheet_of.resize(balls.len(), number);
            }
        }
        Ok(Self { balls: Balls::new(&balls, cancel)?, sheet_of })
    }
}

impl Share<'_> {
    /// Whether a place is in it.
    fn has(self, place: Point3<f64>) -> bool {
        self.shares.balls.nearest(place).is_none_or(|ball| self.shares.sheet_of[ball] == self.number)
    }

    /// How far a straight way stays in it, from the first of two lengths up to the second.
    pub(super) fn own_length(self, from: Point3<f64>, direction: Vector3<f64>, [first, last]: [f64; 2]) -> f64 {
        /// Step, voxels: medial points, whose balls make the share, are not nearer to each other than one. With longer
        /// ones figures overlap by as much; shorter ones only take longer.
        const STEP: f64 = 0.5;
        let mut length = first;
        while length < last {
            let next = (length + STEP).min(last);
            if !self.has(from + direction * next) {
                break;
            }
            length = next;
        }
        length
    }
}
