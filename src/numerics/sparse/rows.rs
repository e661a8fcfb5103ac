//! Rows of a sparse matrix that is a sum of small blocks, one for each of some groups of points.

use crate::numerics::field::id;

/// In which groups each point is, and its place there.
#[derive(Clone, Debug)]
pub struct Memberships {
    starts: Vec<usize>,
    /// Pairs of a group and a place in it, point by point, the groups ascending.
    places: Vec<(u32, u32)>,
}

impl Memberships {
    /// Of as many points as there are groups, from the members of each.
    #[must_use]
    pub fn of(groups: &[Vec<u32>]) -> Self {
        let mut starts = vec![0; groups.len() + 1];
        for &member in groups.iter().flatten() {
            starts[member as usize + 1] += 1;
        }
        for k in 0..groups.len() {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut places = vec![(0, 0); starts[groups.len()]];
        for (group, members) in groups.iter().enumerate() {
            for (place, &member) in members.iter().enumerate() {
                places[next[member as usize]] = (id(group), id(place));
                next[member as usize] += 1;
            }
        }
        Self { starts, places }
    }

    /// The groups of a point, with its place in each.
    #[must_use]
    pub fn of_point(&self, point: usize) -> &[(u32, u32)] {
        &self.places[self.starts[point]..self.starts[point + 1]]
    }
}

/// The entries of a row while they are summed, used for one row after the other.
#[derive(Clone, Debug)]
pub struct RowSums {
    values: Vec<f64>,
    is_there: Vec<bool>,
    columns: Vec<u32>,
}

impl RowSums {
    /// For rows of so many columns.
    #[must_use]
    pub fn new(columns: usize) -> Self {
        Self { values: vec![0.0; columns], is_there: vec![false; columns], columns: Vec::new() }
    }

    /// Adds to an entry.
    pub fn add(&mut self, column: u32, value: f64) {
        self.values[column as usize] += value;
        if !std::mem::replace(&mut self.is_there[column as usize], true) {
            self.columns.push(column);
        }
    }

    /// The entries, ascending in the column; nothing is left.
    pub fn take(&mut self) -> Vec<(u32, f64)> {
        self.columns.sort_unstable();
        let mut row = Vec::with_capacity(self.columns.len());
        for column in self.columns.drain(..) {
            row.push((column, std::mem::take(&mut self.values[column as usize])));
            self.is_there[column as usize] = false;
        }
        row
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_of_a_point_is_found() {
        let found = Memberships::of(&[vec![1, 2], vec![], vec![0, 2], vec![2]]);
        assert_eq!(found.of_point(2), [(0, 1), (2, 1), (3, 0)]);
        assert!(found.of_point(3).is_empty());
    }

    #[test]
    fn a_row_is_summed_and_cleared() {
        let mut sums = RowSums::new(4);
        for (column, value) in [(3, 1.0), (1, 2.0), (3, 0.5)] {
            sums.add(column, value);
        }
        assert_eq!(sums.take(), [(1, 2.0), (3, 1.5)]);
        assert!(sums.take().is_empty());
    }
}
