//! The smooth wall through the nodes of a tube, as a finer one: closed lines around, lines from tip to tip along, by the same
//! cubic steps as the patches of a sheet.

use nalgebra::Point3;

use super::lattice::LatticeSize;
use super::patches::{BENDS, Knot, MOST, PIECES, least_crossing, refined};
use super::tube::TubeShell;
use crate::cancel::{Cancel, Cancelled};

/// Nodes of a closed line that come again at either end, so that it bends at its seam as everywhere else.
const OVERLAP: usize = 3;

/// A finer tube through the nodes of another.
#[derive(Clone, Debug)]
pub struct TubePatches {
    size: LatticeSize,
    centres: Vec<Point3<f64>>,
    wall: Vec<Point3<f64>>,
    tips: [Point3<f64>; 2],
}

impl<'a> From<&'a TubePatches> for TubeShell<'a> {
    fn from(patches: &'a TubePatches) -> Self {
        Self { size: patches.size, centres: &patches.centres, wall: &patches.wall, tips: patches.tips }
    }
}

impl TubePatches {
    /// Those of a tube, and how many pairs of triangles of their closed surface run through each other; `None` without a
    /// closed surface.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(shell: TubeShell<'_>, cancel: &dyn Cancel) -> Result<(Self, Option<usize>), Cancelled> {
        least_crossing(|bend| Self::bent(shell, bend), |patches| TubeShell::from(patches).closed(), cancel)
    }

    /// Those with their bends as they are, whether or not they run through each other.
    #[must_use]
    pub fn unchecked(shell: TubeShell<'_>) -> Self {
        Self::bent(shell, BENDS[0])
    }

    fn bent(shell: TubeShell<'_>, bend: f64) -> Self {
        let LatticeSize { rows, cols } = shell.size;
        let cuts = PIECES.div_ceil(rows.max(cols).max(1)).clamp(1, MOST);
        // Along every row, from tip to tip; beyond a tip it goes on along the row opposite, so that caps are round there. A ring
        // goes on from its last column to its second.
        let is_ring = shell.is_ring();
        let fine_cols = if is_ring { (cols - 1) * cuts + 1 } else { (cols + 1) * cuts - 1 };
        let fine = LatticeSize { rows: rows * cuts, cols: fine_cols };
        let ahead = usize::from(!is_ring);
        let mut along = Vec::with_capacity(rows);
        for row in 0..rows {
            let opposite = (row + rows / 2) % rows;
            let own = &shell.wall[row * cols..(row + 1) * cols];
            let [before, after] = if is_ring {
                [vec![own[cols - 2]], vec![own[1]]]
            } else {
                [
                    vec![shell.wall[opposite * cols], shell.tips[0]],
                    vec![shell.tips[1], shell.wall[opposite * cols + cols - 1]],
                ]
            };
            let knots: Vec<Knot> = before.iter().chain(own).chain(&after).map(|place| (*place, true)).collect();
            let line = refined(&knots, cuts, bend);
            along.push(line[cuts..line.len() - cuts].to_vec());
        }
        let mut wall = vec![Point3::origin(); fine.rows * fine.cols];
        for col in 0..fine.cols {
            let ring: Vec<Knot> = along.iter().map(|line| line[col + ahead]).collect();
            for (row, (point, _)) in closed_line(&ring, cuts, bend).into_iter().enumerate() {
                wall[row * fine.cols + col] = point;
            }
        }
        let mut centres: Vec<Knot> = shell.centres.iter().map(|centre| (*centre, true)).collect();
        if !is_ring {
            centres.insert(0, (shell.centres[0], true));
            centres.push((shell.centres[cols - 1], true));
        }
        // Straight, as wedges are: a centre that stands still in a cap must not swing.
        let centres = refined(&centres, cuts, 0.0)[ahead..][..fine.cols].iter().map(|(centre, _)| *centre).collect();
        Self { size: fine, centres, wall, tips: shell.tips }
    }
}

/// The knots of a closed line and those between them, the first not again.
fn closed_line(ring: &[Knot], cuts: usize, bend: f64) -> Vec<Knot> {
    let count = ring.len();
    let padded: Vec<Knot> = (0..count + 2 * OVERLAP).map(|n| ring[(n + count * OVERLAP - OVERLAP) % count]).collect();
    refined(&padded, cuts, bend)[OVERLAP * cuts..(OVERLAP + count) * cuts].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;
    use crate::numerics::triangles::volume;

    /// A ball of radius 1 as a tube of one centre.
    fn ball(rows: usize, cols: usize) -> (Vec<Point3<f64>>, Vec<Point3<f64>>) {
        let mut wall = Vec::new();
        for i in 0..rows {
            for j in 0..cols {
                let around = i as f64 * std::f64::consts::TAU / rows as f64;
                let along = (j + 1) as f64 * std::f64::consts::PI / (cols + 1) as f64;
                wall.push(Point3::new(along.sin() * around.cos(), along.sin() * around.sin(), -along.cos()));
            }
        }
        (vec![Point3::origin(); cols], wall)
    }

    #[test]
    fn the_patches_of_a_ball_have_its_volume_and_pass_through_its_nodes() {
        let (centres, wall) = ball(12, 8);
        let tips = [Point3::new(0.0, 0.0, -1.0), Point3::new(0.0, 0.0, 1.0)];
        let shell = TubeShell { size: LatticeSize { rows: 12, cols: 8 }, centres: &centres, wall: &wall, tips };
        let (patches, crossings) = TubePatches::of(shell, &Never).expect("not cancelled");
        assert_eq!(crossings, Some(0));
        let fine = TubeShell::from(&patches);
        for node in &wall {
            assert!(fine.wall.iter().any(|p| (p - node).norm() < 1e-12), "{node} is lost");
        }
        let mesh = fine.closed().expect("closed");
        let ratio = volume(&mesh.positions, &mesh.triangles) / (4.0 / 3.0 * std::f64::consts::PI);
        assert!((0.97..1.0).contains(&ratio), "volume {ratio:.3} of the ball's");
    }
}
