//! Triangles made a disc: one piece, two triangles at an edge, one fan at a vertex, one rim, no handle; or a ring, with two
//! rims.

use std::collections::BTreeMap;
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

/// Length of the rim of a ring's hole over that of its other one at the least: shorter ones are gaps of a mesh. Of a washer whose
/// hole takes [`HOLES_REFUSED`] of its area it is 0.36.
const LEAST_RIM: f64 = 0.25;

/// A mesh that is a disc, or a ring.
#[derive(Clone, Debug)]
pub(super) struct Disc {
    /// Vertices.
    pub positions: Vec<Point3<f64>>,
    /// Triangles, all turned one way: those of the sheet, then those that fill its holes.
    pub triangles: Vec<[u32; 3]>,
    /// How many of them are the sheet's.
    pub of_sheet: usize,
    /// Vertices of the rim, counter-clockwise as the triangles are; of a ring those of one rim after the other.
    pub rim: Vec<u32>,
    /// Vertices joined to each, ascending.
    pub joined: Vec<Vec<u32>>,
}

impl Disc {
    /// The largest piece of some triangles, its small holes filled; `None` where it is no disc.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(mesh: Triangles, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        Ok(Self::with_rims(mesh, 1, cancel)?.map(|(disc, _)| disc))
    }

    /// The same with two rims, and how many vertices the first of them has; `None` where it is no ring.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn ring(mesh: Triangles, cancel: &dyn Cancel) -> Result<Option<(Self, usize)>, Cancelled> {
        Self::with_rims(mesh, 2, cancel)
    }

    /// With so many rims, the longest of its loops; and the vertices of the longest.
    fn with_rims(mut mesh: Triangles, count: usize, cancel: &dyn Cancel) -> Result<Option<(Self, usize)>, Cancelled> {
        if !is_cleaned(&mut mesh, cancel)? {
            return Ok(None);
        }
        let mut loops = loops_of(&mesh);
        // The first of equals first.
        loops.sort_by(|a, b| length(b, &mesh.positions).total_cmp(&length(a, &mesh.positions)));
        if loops.len() < count {
            return Ok(None);
        }
        let holes = loops.split_off(count);
        let shortest = length(&loops[count - 1], &mesh.positions);
        if shortest < LEAST_RIM * length(&loops[0], &mesh.positions) {
            return Ok(None);
        }
        if count > 1 {
            split_chords(&mut mesh, &loops);
        }
        let of_sheet = mesh.triangles.len();
        let (area, mut in_holes) = (area(&mesh.positions, &mesh.triangles), 0.0);
        for hole in &holes {
            // As large as a circle of its length.
            in_holes += length(hole, &mesh.positions).powi(2) / (4.0 * PI);
            fill(hole, &mut mesh);
        }
        if in_holes > HOLES_REFUSED * (area + in_holes) {
            return Ok(None);
        }
        let mut disc = Self { of_sheet, ..Self::compact(&mesh, &loops.concat()) };
        if !disc.is_simple(count) {
            return Ok(None);
        }
        disc.smooth();
        Ok(Some((disc, loops[0].len())))
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

    /// Whether it has no handle: V − E + F = 2 less the number of its rims.
    fn is_simple(&self, rims: usize) -> bool {
        let edges = self.joined.iter().map(Vec::len).sum::<usize>() / 2;
        self.positions.len() + self.triangles.len() + rims == edges + 2
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

/// Puts a vertex in the middle of every edge inside that joins two of one rim: what lies beyond would be drawn to a line where the
/// rim is laid straight.
fn split_chords(mesh: &mut Triangles, rims: &[Vec<u32>]) {
    let mut rim_of = vec![usize::MAX; mesh.positions.len()];
    for (number, rim) in rims.iter().enumerate() {
        for &v in rim {
            rim_of[v as usize] = number;
        }
    }
    let edges = directed_edges(mesh);
    let is_chord = |a: u32, b: u32| {
        let is_inside = triangle_at(&edges, [a, b]).is_some() && triangle_at(&edges, [b, a]).is_some();
        let [one, other] = [a, b].map(|v| rim_of.get(v as usize));
        is_inside && one == other && one != Some(&usize::MAX)
    };
    let (mut middles, mut triangles) = (BTreeMap::new(), Vec::with_capacity(mesh.triangles.len()));
    let mut waiting = std::mem::take(&mut mesh.triangles);
    waiting.reverse();
    while let Some([a, b, c]) = waiting.pop() {
        let Some([a, b, c]) = [[a, b, c], [b, c, a], [c, a, b]].into_iter().find(|[a, b, _]| is_chord(*a, *b)) else {
            triangles.push([a, b, c]);
            continue;
        };
        let middle = *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let [from, to] = [a, b].map(|v| mesh.positions[v as usize].coords);
            mesh.positions.push(Point3::from((from + to) / 2.0));
            id(mesh.positions.len() - 1)
        });
        waiting.extend([[middle, b, c], [a, middle, c]]);
    }
    mesh.triangles = triangles;
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
