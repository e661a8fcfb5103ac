//! Triangles made a disc: one piece, two triangles at an edge, one fan at a vertex, one rim, no handle.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};

use super::cleaned::{directed_edges, is_cleaned, triangle_at};
use super::implicit::Triangles;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::pipeline::plane::region::HOLES_REFUSED;

/// How often vertices inside are moved to the mean of those around, so that no triangle is a sliver. With none another kidney
/// has 12 pairs of triangles that run through each other, not one; with 10 the bends of a kidney are flattened, and its
/// overlap is 0.929, not 0.940.
const SMOOTHINGS: usize = 3;

/// A mesh that is a disc.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    /// Vertices.
    pub positions: Vec<Point3<f64>>,
    /// Triangles, all turned one way: those of the sheet, then those that fill its holes.
    pub triangles: Vec<[u32; 3]>,
    /// How many of them are the sheet's.
    pub of_sheet: usize,
    /// Vertices of the rim, counter-clockwise as the triangles are.
    pub rim: Vec<u32>,
    /// Vertices joined to each, ascending.
    pub joined: Vec<Vec<u32>>,
}

impl Disc {
    /// The largest piece of some triangles, its small holes filled; `None` where it is no disc.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(mut mesh: Triangles, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        if !is_cleaned(&mut mesh, cancel)? {
            return Ok(None);
        }
        let mut loops = loops_of(&mesh);
        let Some(longest) = longest(&loops, &mesh.positions) else { return Ok(None) };
        let rim = loops.swap_remove(longest);
        let of_sheet = mesh.triangles.len();
        let (area, mut in_holes) = (area(&mesh.positions, &mesh.triangles), 0.0);
        for hole in &loops {
            // As large as a circle of its length.
            in_holes += length(hole, &mesh.positions).powi(2) / (4.0 * PI);
            fill(hole, &mut mesh);
        }
        if in_holes > HOLES_REFUSED * (area + in_holes) {
            return Ok(None);
        }
        let mut disc = Self { of_sheet, ..Self::compact(&mesh, &rim) };
        if !disc.is_simple() {
            return Ok(None);
        }
        disc.smooth();
        Ok(Some(disc))
    }

    /// Without vertices that no triangle has.
    fn compact(mesh: &Triangles, rim: &[u32]) -> Self {
        let mut numbers: Vec<u32> = mesh.triangles.as_flattened().to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        let number = |v: u32| id(numbers.partition_point(|&n| n < v));
        let triangles: Vec<_> = mesh.triangles.iter().map(|t| t.map(number)).collect();
        let mut joined = vec![Vec::new(); numbers.len()];
        for [a, b, c] in &triangles {
            joined[*a as usize].extend([*b, *c]);
            joined[*b as usize].extend([*c, *a]);
            joined[*c as usize].extend([*a, *b]);
        }
        for list in &mut joined {
            list.sort_unstable();
            list.dedup();
        }
        Self {
            positions: numbers.iter().map(|&n| mesh.positions[n as usize]).collect(),
            of_sheet: triangles.len(),
            triangles,
            rim: rim.iter().map(|&v| number(v)).collect(),
            joined,
        }
    }

    /// Whether it has no handle: V − E + F = 1.
    fn is_simple(&self) -> bool {
        let edges = self.joined.iter().map(Vec::len).sum::<usize>() / 2;
        self.positions.len() + self.triangles.len() == edges + 1
    }

    /// Vertices on the rim.
    pub fn is_rim(&self) -> Vec<bool> {
        let mut is_rim = vec![false; self.positions.len()];
        for &v in &self.rim {
            is_rim[v as usize] = true;
        }
        is_rim
    }

    fn smooth(&mut self) {
        let is_rim = self.is_rim();
        for _ in 0..SMOOTHINGS {
            let before = self.positions.clone();
            for (v, joined) in self.joined.iter().enumerate() {
                if !is_rim[v] {
                    let sum: Vector3<f64> = joined.iter().map(|&n| before[n as usize].coords).sum();
                    self.positions[v] = Point3::from(sum / joined.len() as f64);
                }
            }
        }
    }
}

/// The edges' loops, with the triangles to their left.
fn loops_of(mesh: &Triangles) -> Vec<Vec<u32>> {
    let edges = directed_edges(mesh);
    let mut next = vec![None; mesh.positions.len()];
    for ([a, b], _) in &edges {
        if triangle_at(&edges, [*b, *a]).is_none() {
            next[*a as usize] = Some(*b);
        }
    }
    let mut loops = Vec::new();
    for start in 0..next.len() {
        let (mut around, mut at) = (Vec::new(), start);
        while let Some(to) = next[at].take() {
            around.push(id(at));
            at = to as usize;
        }
        if !around.is_empty() {
            loops.push(around);
        }
    }
    loops
}

/// The number of the longest loop.
fn longest(loops: &[Vec<u32>], positions: &[Point3<f64>]) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (k, around) in loops.iter().enumerate() {
        let length = length(around, positions);
        if best.is_none_or(|(_, most)| length > most) {
            best = Some((k, length));
        }
    }
    best.map(|(k, _)| k)
}

/// Length of a loop, voxels.
pub(super) fn length(around: &[u32], positions: &[Point3<f64>]) -> f64 {
    let mut sum = 0.0;
    for (k, &v) in around.iter().enumerate() {
        let next = around[(k + 1) % around.len()];
        sum += (positions[next as usize] - positions[v as usize]).norm();
    }
    sum
}

/// Area of some triangles, square voxels.
pub(super) fn area(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    let mut sum = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| positions[v as usize]);
        sum += (b - a).cross(&(c - a)).norm() / 2.0;
    }
    sum
}

/// Fills a hole with triangles round a vertex in its middle.
fn fill(hole: &[u32], mesh: &mut Triangles) {
    let sum: Vector3<f64> = hole.iter().map(|&v| mesh.positions[v as usize].coords).sum();
    let middle = id(mesh.positions.len());
    mesh.positions.push(Point3::from(sum / hole.len() as f64));
    for (k, &v) in hole.iter().enumerate() {
        mesh.triangles.push([hole[(k + 1) % hole.len()], v, middle]);
    }
}
