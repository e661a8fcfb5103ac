//! A first map of a disc to the plane that turns no triangle over: the rim on a circle, every vertex inside at the mean
//! of those it is joined to (Tutte, *How to draw a graph*, 1963; Floater, CAGD 14, 1997).

use std::f64::consts::TAU;

use nalgebra::{DMatrix, Point2};

use super::disc::{Disc, area, length};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::sparse::{FactorError, Sparse, solved};

/// The places of the vertices, on a disc of the mesh's area; `None` where the equations have no answer, which no disc
/// is known to bring about.
///
/// # Errors
/// When it is cancelled.
pub(super) fn on_circle(disc: &Disc, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
    let mut places = vec![Point2::origin(); disc.positions.len()];
    let radius = (area(&disc.positions, &disc.triangles) / std::f64::consts::PI).sqrt();
    let whole = length(&disc.rim, &disc.positions);
    let mut walked = 0.0;
    for (k, &v) in disc.rim.iter().enumerate() {
        let angle = TAU * walked / whole;
        places[v as usize] = Point2::new(radius * angle.cos(), radius * angle.sin());
        let next = disc.rim[(k + 1) % disc.rim.len()];
        walked += (disc.positions[next as usize] - disc.positions[v as usize]).norm();
    }
    let is_rim = disc.is_rim();
    let inner: Vec<usize> = (0..places.len()).filter(|&v| !is_rim[v]).collect();
    let mut row_of = vec![None; places.len()];
    for (row, &v) in inner.iter().enumerate() {
        row_of[v] = Some(id(row));
    }
    let (mut rows, mut right) = (Vec::with_capacity(inner.len()), DMatrix::zeros(inner.len(), 2));
    for (row, &v) in inner.iter().enumerate() {
        cancel.check()?;
        let joined = &disc.joined[v];
        let mut entries = vec![(id(row), joined.len() as f64)];
        for &n in joined {
            match row_of[n as usize] {
                Some(column) => entries.push((column, -1.0)),
                None => {
                    right[(row, 0)] += places[n as usize].x;
                    right[(row, 1)] += places[n as usize].y;
                }
            }
        }
        entries.sort_unstable_by_key(|entry| entry.0);
        rows.push(entries);
    }
    let seats: Vec<_> = inner.iter().map(|&v| disc.positions[v]).collect();
    let found = match solved(&Sparse::from_rows(rows), &seats, &right, cancel) {
        Ok(found) => found,
        Err(FactorError::Cancelled(stop)) => return Err(stop),
        Err(FactorError::NotPositive) => return Ok(None),
    };
    for (row, &v) in inner.iter().enumerate() {
        places[v] = Point2::new(found[(row, 0)], found[(row, 1)]);
    }
    Ok(Some(places))
}
