//! A surface as the stages see it, from the medial surface on: points in work space that know which others they touch.

use nalgebra::Point3;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::flood::pieces;
use crate::numerics::parallel::{POINTS_PER_TASK, each};

/// Points of a surface, voxels of work space, with their 26-neighbours on it.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions.
    pub positions: Vec<Point3<f64>>,
    /// Touching points of each point, ascending.
    pub adjacency: Vec<Vec<u32>>,
}

impl Surface {
    /// The part of a larger surface, whose points touch by `adjacency`, that is made of `members` (ascending indices
    /// into it), which lie at `positions`.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(crate) fn part_of(
        adjacency: &[Vec<u32>],
        members: &[u32],
        positions: Vec<Point3<f64>>,
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let places = Places::of(members, adjacency.len());
        let list = |p: &u32| places.of_those(&adjacency[*p as usize]);
        Ok(Self { positions, adjacency: each(members, POINTS_PER_TASK, list, cancel)? })
    }

    /// The part made of some points (ascending).
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn part(&self, members: &[u32], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        Self::part_of(&self.adjacency, members, picked(&self.positions, members), cancel)
    }

    /// Indices of the largest connected piece (the first of equals), ascending.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn largest_piece(&self, cancel: &dyn Cancel) -> Result<Vec<u32>, Cancelled> {
        let mut largest = Vec::new();
        for piece in pieces(&self.adjacency, |_| true, cancel)? {
            if piece.len() > largest.len() {
                largest = piece;
            }
        }
        largest.sort_unstable();
        Ok(largest)
    }
}

/// Those of all values that have some numbers, in the order of the numbers.
pub(super) fn picked<T: Copy>(all: &[T], numbers: &[u32]) -> Vec<T> {
    numbers.iter().map(|&n| all[n as usize]).collect()
}

/// Where each of some points is in their list.
pub(super) struct Places(Vec<Option<u32>>);

impl Places {
    /// Of `members` of `whole` points.
    pub fn of(members: &[u32], whole: usize) -> Self {
        let mut places = vec![None; whole];
        for (k, &p) in members.iter().enumerate() {
            places[p as usize] = Some(id(k));
        }
        Self(places)
    }

    /// Places of those points that are members, in their order.
    pub(crate) fn of_those(&self, points: &[u32]) -> Vec<u32> {
        points.iter().filter_map(|&p| self.0[p as usize]).collect()
    }
}
