//! A surface as the stages after the sheets see it: points in work space that know which others
//! they touch.

use nalgebra::Point3;

/// Points of a surface, voxels of work space, with their 26-neighbours on it.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Positions.
    pub positions: Vec<Point3<f64>>,
    /// Touching points of each point, ascending.
    pub adjacency: Vec<Vec<u32>>,
}

impl Surface {
    /// The part of a larger surface made of `members` (ascending indices into it).
    #[must_use]
    pub fn part(positions: impl Fn(u32) -> Point3<f64>, touching: impl Fn(u32) -> Vec<u32>, members: &[u32]) -> Self {
        let local = |p: &u32| members.binary_search(p).ok().map(crate::numerics::field::id);
        let adjacency = members.iter().map(|&p| touching(p).iter().filter_map(local).collect()).collect();
        Self { positions: members.iter().map(|&p| positions(p)).collect(), adjacency }
    }

    /// Indices of the largest connected piece (the first of equals), ascending.
    #[must_use]
    pub fn largest_piece(&self) -> Vec<u32> {
        let mut seen = vec![false; self.positions.len()];
        let mut best = Vec::new();
        for start in 0..seen.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            let mut piece = vec![crate::numerics::field::id(start)];
            let mut next = 0;
            while next < piece.len() {
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
        best
    }
}
