//! Nested dissection (George, SIAM J. Numer. Anal. 10, 1973): an order of elimination for sparse
//! matrices whose rows are places in space that are joined to places near them.
//!
//! 1. the places are halved across their longest principal axis;
//! 2. rows of the upper half that are joined to the lower one *part* the two: they come last;
//! 3. what is left of the halves is treated alike.
//!
//! On a sheet of n places, each joined to those within r places, the parts that halve the whole are r
//! wide and √n long, and elimination costs about 20 √n³ r³ steps and 8 n r² log₂(√n / r) numbers, where
//! rows from one end to the other would cost n² r² and √n³ r.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::matrix::Sparse;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;

/// Rows of a part that is not halved further. From 16 to 200 the cost is much the same.
const LEAF: usize = 48;
/// Rows between two looks at `cancel`.
const LOOK_EVERY: usize = 4096;

/// An order of elimination, as a tree of parts.
#[derive(Clone, Debug)]
pub struct Dissection {
    /// Rows in the order of elimination.
    pub order: Vec<u32>,
    /// The part that is eliminated last.
    pub root: Part,
}

/// Rows that are eliminated together, after those of its children. No row of one child is joined to
/// one of the other.
#[derive(Clone, Debug)]
pub struct Part {
    /// Place in the order of its first row.
    pub from: usize,
    /// Place in the order behind its last row.
    pub to: usize,
    /// Rows of the part and of all below it.
    pub rows: usize,
    /// The halves that it parts.
    pub children: Option<Box<[Part; 2]>>,
}

impl Dissection {
    /// For a matrix whose rows lie at `places`. Where they lie changes the cost, not what is found.
    ///
    /// # Errors
    /// Those of `cancel`.
    pub fn of(matrix: &Sparse, places: &[Point3<f64>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let mut rows: Vec<u32> = (0..id(matrix.len())).collect();
        let mut halving = Halving { matrix, places, mark: vec![0; rows.len()], marks: 0, order: Vec::new(), cancel };
        let root = halving.part(&mut rows)?;
        Ok(Self { order: halving.order, root })
    }
}

struct Halving<'a> {
    matrix: &'a Sparse,
    places: &'a [Point3<f64>],
    /// The last half that each row was in the lower one of.
    mark: Vec<u32>,
    marks: u32,
    order: Vec<u32>,
    cancel: &'a dyn Cancel,
}

impl Halving<'_> {
    fn part(&mut self, rows: &mut [u32]) -> Result<Part, Cancelled> {
        self.cancel.check()?;
        if rows.len() <= LEAF {
            return Ok(self.ordered(rows, rows.len(), None));
        }
        self.sort_along(rows);
        let (low, high) = rows.split_at_mut(rows.len() / 2);
        self.marks += 1;
        low.iter().for_each(|&row| self.mark[row as usize] = self.marks);
        let mut between = Vec::new();
        let mut beyond = Vec::new();
        for (slice, rows) in high.chunks(LOOK_EVERY).enumerate() {
            if slice > 0 {
                self.cancel.check()?;
            }
            for &row in rows {
                let joined = self.matrix.row(row as usize).0;
                let is_between = joined.iter().any(|&n| self.mark[n as usize] == self.marks);
                if is_between { between.push(row) } else { beyond.push(row) }
            }
        }
        let all = low.len() + high.len();
        let halves = [self.part(low)?, self.part(&mut beyond)?];
        Ok(self.ordered(&between, all, Some(Box::new(halves))))
    }

    fn ordered(&mut self, rows: &[u32], all: usize, children: Option<Box<[Part; 2]>>) -> Part {
        let from = self.order.len();
        self.order.extend_from_slice(rows);
        Part { from, to: self.order.len(), rows: all, children }
    }

    /// Sorts rows along the direction in which their places are spread most.
    fn sort_along(&self, rows: &mut [u32]) {
        let place = |row: u32| self.places[row as usize].coords;
        let middle = rows.iter().map(|&row| place(row)).sum::<Vector3<f64>>() / rows.len() as f64;
        let mut spread = Matrix3::zeros();
        for &row in rows.iter() {
            let d = place(row) - middle;
            spread += d * d.transpose();
        }
        let eigen = SymmetricEigen::new(spread);
        let along = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        rows.sort_by_cached_key(|&row| Ordered(along.dot(&place(row)), row));
    }
}

/// A number with a total order, ties by row.
#[derive(PartialEq)]
struct Ordered(f64, u32);

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0).then(self.1.cmp(&other.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// Places on a grid, each joined to those within two steps.
    fn grid(rows: usize, cols: usize) -> (Sparse, Vec<Point3<f64>>) {
        let at = |n: usize| [n / cols, n % cols];
        let is_near = |a: usize, b: usize| at(a)[0].abs_diff(at(b)[0]).max(at(a)[1].abs_diff(at(b)[1])) <= 2;
        let row = |a: usize| (0..rows * cols).filter(|&b| is_near(a, b)).map(|b| (id(b), 1.0)).collect();
        let places = (0..rows * cols).map(|n| Point3::new(at(n)[0] as f64, at(n)[1] as f64, 0.0)).collect();
        (Sparse::from_rows((0..rows * cols).map(row).collect()), places)
    }

    /// No row of one child is joined to one of the other; ranges follow one another; sums are right.
    fn check(part: &Part, first: usize, order: &[u32], matrix: &Sparse) {
        assert_eq!(part.to, first + part.rows);
        let Some(children) = &part.children else {
            assert!(part.from == first && part.rows <= LEAF);
            return;
        };
        let [a, b] = children.as_ref();
        assert_eq!((a.to, b.to), (b.to - b.rows, part.from));
        check(a, first, order, matrix);
        check(b, a.to, order, matrix);
        let of_b = &order[a.to..b.to];
        for &row in &order[first..a.to] {
            assert!(!matrix.row(row as usize).0.iter().any(|column| of_b.contains(column)));
        }
    }

    #[test]
    fn halves_are_parted_and_every_row_comes_once() {
        let (matrix, places) = grid(19, 32);
        let found = Dissection::of(&matrix, &places, &Never).expect("not stopped");
        check(&found.root, 0, &found.order, &matrix);
        let mut rows = found.order.clone();
        rows.sort_unstable();
        assert_eq!(rows, (0..id(matrix.len())).collect::<Vec<_>>());
        // Two columns of 19 part the whole.
        assert_eq!(found.root.to - found.root.from, 38);
    }

    #[test]
    fn places_that_are_all_one_are_parted_too() {
        let (matrix, places) = grid(12, 12);
        let found = Dissection::of(&matrix, &vec![Point3::origin(); places.len()], &Never).expect("not stopped");
        check(&found.root, 0, &found.order, &matrix);
    }
}
