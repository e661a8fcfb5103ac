//! A solid as cells that hold shares of it, for what is solved for all over it.

use nalgebra::Point3;

use super::ring::Cut;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, components};
use crate::numerics::field::{floor_index, id};
use crate::numerics::graph::Graph;
use crate::numerics::moments::Axes3;
use crate::numerics::parallel::each_number;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::space::Grid;

/// Cells at the most. Sections of 5 cells across a long tube need a tenth of them; with four times as many, the time that
/// solving takes grows sixfold.
const MOST_CELLS: usize = 30_000;
/// Share of a cell that must be inside. With a half, tubes of two voxels fall into pieces; with 0.1, walls of two tubes
/// that nearly touch meet.
const LEAST_SHARE: f64 = 0.3;
/// How far the nearest cell is looked for, cells: the skin lies within two.
const NEAREST_REACH: usize = 3;
/// No cell.
const NONE: u32 = u32::MAX;

/// Cells in a grid over a solid: those that have enough of it, in one piece by their faces.
#[derive(Clone)]
pub struct Cells {
    /// Share of each that is inside.
    pub shares: Vec<f64>,
    /// Centre of each, in work space.
    pub places: Vec<Point3<f64>>,
    /// Depth of each below the skin.
    pub depths: Vec<f64>,
    /// Edge of a cell in work space.
    pub edge: f64,
    number: Grid<u32>,
    index: Vec<[usize; 3]>,
    /// Place of the cell of index 0.
    origin: f64,
    /// Where a ring is opened.
    cut: Option<Cut>,
}

impl Cells {
    /// Those of a solid.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(solid: &Solid, depth: &Depth, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let k = depth.voxels_per_unit;
        let inside = solid.inside.as_slice().iter().filter(|is_inside| **is_inside).count();
        let stride = stride(inside);
        // One cell more on every side, so that none lies on the edge of the grid.
        let dims = solid.inside.dims().map(|count| count.div_ceil(stride) + 2);
        let edge = stride as f64 / k;
        // The middle of the voxels of a cell; the first cell lies before the grid.
        let origin = ((stride as f64 - 1.0) / 2.0 - stride as f64) / k;
        let shares = shares(solid, dims, stride, cancel)?;
        let is_kept = Grid::from_vec(dims, shares.iter().map(|share| *share > LEAST_SHARE).collect())
            .unwrap_or_else(|| Grid::filled(dims, false));
        let pieces = components(&is_kept, true, Connectivity::Faces6, cancel)?;
        let mut is_kept = is_kept;
        pieces.set_all_but(pieces.largest().as_slice(), &mut is_kept, false);
        let mut cells = Self {
            shares: Vec::new(),
            places: Vec::new(),
            depths: Vec::new(),
            edge,
            number: Grid::filled(dims, NONE),
            index: Vec::new(),
            origin,
            cut: None,
        };
        for (o, _) in is_kept.as_slice().iter().enumerate().filter(|(_, is)| **is) {
            let index = is_kept.index(o);
            cells.number.as_mut_slice()[o] = id(cells.index.len());
            cells.shares.push(shares[o].min(1.0));
            cells.places.push(Point3::from(index.map(|i| origin + edge * i as f64)));
            cells.index.push(index);
        }
        cells.depths = each_number(cells.places.len(), 256, |c| depth.at(cells.places[c]), cancel)?;
        Ok(cells)
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.index.len()
    }

    /// The same, opened by a cut.
    #[must_use]
    pub fn opened(&self, cut: Cut) -> Self {
        Self { cut: Some(cut), ..self.clone() }
    }

    /// Their middle, and the axes of their second moments about it.
    pub fn axes(&self) -> (Point3<f64>, Axes3) {
        Axes3::of_points(&self.places)
    }

    /// Where it is cut open.
    pub fn cut(&self) -> Option<&Cut> {
        self.cut.as_ref()
    }

    /// The cells on either bank of a cut: those with faces in it.
    pub fn banks(&self, cut: &Cut) -> [Vec<usize>; 2] {
        let mut banks = [Vec::new(), Vec::new()];
        for (cell, place) in self.places.iter().enumerate() {
            if self.beside(cell).any(|next| cut.parts(*place, self.places[next])) {
                banks[cut.bank(*place)].push(cell);
            }
        }
        banks
    }

    /// Whether a cut lies between two places.
    fn is_parted(&self, a: Point3<f64>, b: Point3<f64>) -> bool {
        self.cut.is_some_and(|cut| cut.parts(a, b))
    }

    /// The cells that a cell shares faces with.
    pub fn beside(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        let beside = (0..6).filter_map(move |side: usize| {
            let mut at = self.index[cell];
            at[side / 2] = if side.is_multiple_of(2) { at[side / 2] - 1 } else { at[side / 2] + 1 };
            self.at(at)
        });
        beside.filter(move |&next| !self.is_parted(self.places[cell], self.places[next]))
    }

    fn at(&self, index: [usize; 3]) -> Option<usize> {
        let number = self.number[index];
        (number != NONE).then_some(number as usize)
    }

    /// Cells no more than `reach` cells away from a place along each axis, on its side of a cut.
    pub fn near(&self, place: Point3<f64>, reach: usize, mut found: impl FnMut(usize)) {
        let dims = self.number.dims();
        let middle = [0, 1, 2].map(|a| floor_index((place[a] - self.origin) / self.edge + 0.5).min(dims[a] - 1));
        let low = middle.map(|x| x.saturating_sub(reach));
        let high = [0, 1, 2].map(|a| (middle[a] + reach).min(dims[a] - 1));
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                for i in low[0]..=high[0] {
                    let cell = self.at([i, j, k]).filter(|&cell| !self.is_parted(place, self.places[cell]));
                    cell.into_iter().for_each(&mut found);
                }
            }
        }
    }

    /// The cell nearest to a place, of those within a few; the first of several.
    pub fn nearest(&self, place: Point3<f64>) -> Option<usize> {
        let mut nearest: Option<(f64, usize)> = None;
        for reach in 1..=NEAREST_REACH {
            self.near(place, reach, |cell| {
                let apart = (self.places[cell] - place).norm_squared();
                if nearest.is_none_or(|nearest| apart < nearest.0) {
                    nearest = Some((apart, cell));
                }
            });
            if nearest.is_some() {
                break;
            }
        }
        nearest.map(|nearest| nearest.1)
    }

    /// Their graph: from each to all that touch it.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn graph(&self, cancel: &dyn Cancel) -> Result<Graph, Cancelled> {
        let mut lists = Vec::with_capacity(self.len());
        for cell in 0..self.len() {
            let mut list = Vec::new();
            self.near(self.places[cell], 1, |next| {
                if next != cell {
                    #[expect(clippy::cast_possible_truncation, reason = "a length of a few cells")]
                    list.push((id(next), (self.places[next] - self.places[cell]).norm() as f32));
                }
            });
            lists.push(list);
        }
        let order: Vec<u32> = (0..id(self.len())).collect();
        Graph::from_lists(&lists, &order, cancel)
    }

    /// The cell that lies deepest; the first of several.
    pub fn deepest(&self) -> usize {
        let mut deepest = 0;
        for (cell, depth) in self.depths.iter().enumerate() {
            if *depth > self.depths[deepest] {
                deepest = cell;
            }
        }
        deepest
    }
}

/// Working voxels along the edge of a cell.
fn stride(voxels: usize) -> usize {
    let mut stride = 1;
    while voxels / (stride * stride * stride) > MOST_CELLS {
        stride += 1;
    }
    stride
}

/// Share of every cell of a grid that is inside, in its order: the mean over its voxels.
fn shares(solid: &Solid, dims: [usize; 3], stride: usize, cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
    let whole = (stride * stride * stride) as f64;
    let of_row = |row: usize| {
        let (j, k) = (row % dims[1], row / dims[1]);
        let mut shares = vec![0.0; dims[0]];
        for (i, share) in shares.iter_mut().enumerate() {
            let first = [i, j, k].map(|x| (x * stride).checked_sub(stride));
            let [Some(x), Some(y), Some(z)] = first else { continue };
            *share = solid.share_of_block([x, y, z], stride) / whole;
        }
        shares
    };
    Ok(each_number(dims[1] * dims[2], 16, of_row, cancel)?.concat())
}
