//! A surface as the stages after the sheets see it: points in work space that know which others
//! they touch.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::numerics::field::id;

use crate::cancel::{Cancel, Cancelled};

/// Points of a surface, voxels of work space, with their 26-neighbours on it.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions.
    pub positions: Vec<Point3<f64>>,
    /// Touching points of each point, ascending.
    pub adjacency: Vec<Vec<u32>>,
}

impl Surface {
    /// The part of a larger surface of `whole` points made of `members` (ascending indices into it);
    /// `touching` adds the points that one touches to a list, ascending.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn made_of(
        members: &[u32],
        whole: usize,
        position: impl Fn(u32) -> Point3<f64>,
        touching: impl Fn(u32, &mut Vec<u32>) + Sync,
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let mut place = vec![u32::MAX; whole];
        members.iter().enumerate().for_each(|(k, &p)| place[p as usize] = id(k));
        let list_of = |&p: &u32| {
            cancel.check()?;
            let mut list = Vec::new();
            touching(p, &mut list);
            list.iter_mut().for_each(|n| *n = place[*n as usize]);
            list.retain(|n| *n != u32::MAX);
            Ok(list)
        };
        let adjacency = members.par_iter().with_min_len(256).map(list_of).collect::<Result<_, _>>()?;
        Ok(Self { positions: members.iter().map(|&p| position(p)).collect(), adjacency })
    }

    /// The part made of some points (ascending).
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn part(&self, members: &[u32], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let touching = |p: u32, list: &mut Vec<u32>| list.extend_from_slice(&self.adjacency[p as usize]);
        Self::made_of(members, self.positions.len(), |p| self.positions[p as usize], touching, cancel)
    }

    /// Indices of the largest connected piece (the first of equals), ascending.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn largest_piece(&self, cancel: &dyn Cancel) -> Result<Vec<u32>, Cancelled> {
        let mut seen = vec![false; self.positions.len()];
        let mut best = Vec::new();
        for start in 0..seen.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let mut piece = vec![id(start)];
            let mut next = 0;
            while next < piece.len() {
                cancel.check()?;
                for &n in &self.adjacency[piece[next] as usize] {
                    if !std::mem::replace(&mut seen[n as usize], true) {
                        piece.push(n);
                    }
                }
                next += 1;
            }
            if piece.len() > best.len() {
                best = piece;
            }
        }
        best.sort_unstable();
        Ok(best)
    }
}
