//! What a mesh of surface nets may have, and a surface has not: edges of four triangles, where two parts of it pass through
//! one cell, vertices at which two parts touch, and pieces.

use super::implicit::Triangles;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;

/// Rounds in which triangles are taken away that have one neighbour at the most: they make edges ragged, and Tutte's map
/// presses what hangs on by one of them to a point, from where no step leads out. Without, 9 of 12 repeats of a kidney with
/// its boundary moved are unrolled, with 2 rounds 10, with 8 or 20 11.
const EARS: usize = 8;
/// Rounds of cleaning at most. Each takes triangles away; two or three are the rule, and a mesh that needs more is none.
const ROUNDS: usize = 20;

/// Leaves the largest piece in which every edge has two triangles at the most and every vertex one fan. Whether that was
/// reached.
///
/// # Errors
/// When it is cancelled.
pub(super) fn is_cleaned(mesh: &mut Triangles, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    for _ in 0..EARS {
        cancel.check()?;
        let bad = ears(mesh);
        retain(mesh, &bad);
    }
    for _ in 0..ROUNDS {
        cancel.check()?;
        let before = mesh.triangles.len();
        let bad = at_shared_edges(mesh);
        retain(mesh, &bad);
        let bad = off_largest_piece(mesh);
        retain(mesh, &bad);
        let bad = at_vertices_of_many_fans(mesh);
        retain(mesh, &bad);
        if mesh.triangles.len() == before {
            return Ok(before > 0);
        }
    }
    Ok(false)
}

/// Which triangles have no more than one neighbour.
fn ears(mesh: &Triangles) -> Vec<bool> {
    let edges = directed_edges(mesh);
    let mut is_ear = Vec::with_capacity(mesh.triangles.len());
    for &[a, b, c] in &mesh.triangles {
        let mut neighbours = 0;
        for edge in [[b, a], [c, b], [a, c]] {
            neighbours += usize::from(triangle_at(&edges, edge).is_some());
        }
        is_ear.push(neighbours < 2);
    }
    is_ear
}

fn retain(mesh: &mut Triangles, is_bad: &[bool]) {
    let mut kept = Vec::with_capacity(mesh.triangles.len());
    for (triangle, is_bad) in mesh.triangles.iter().zip(is_bad) {
        if !is_bad {
            kept.push(*triangle);
        }
    }
    mesh.triangles = kept;
}

/// Directed edges with their triangles, ascending.
pub(super) fn directed_edges(mesh: &Triangles) -> Vec<([u32; 2], u32)> {
    let mut edges = Vec::with_capacity(3 * mesh.triangles.len());
    for (k, [a, b, c]) in mesh.triangles.iter().enumerate() {
        edges.extend([([*a, *b], id(k)), ([*b, *c], id(k)), ([*c, *a], id(k))]);
    }
    edges.sort_unstable();
    edges
}

/// The triangle at a directed edge.
pub(super) fn triangle_at(edges: &[([u32; 2], u32)], edge: [u32; 2]) -> Option<u32> {
    edges.binary_search_by_key(&edge, |entry| entry.0).ok().map(|k| edges[k].1)
}

/// Which triangles have a directed edge that another has too.
fn at_shared_edges(mesh: &Triangles) -> Vec<bool> {
    let mut is_bad = vec![false; mesh.triangles.len()];
    for pair in directed_edges(mesh).windows(2) {
        if pair[0].0 == pair[1].0 {
            is_bad[pair[0].1 as usize] = true;
            is_bad[pair[1].1 as usize] = true;
        }
    }
    is_bad
}

/// Which triangles are not of the largest piece that hangs together by edges.
fn off_largest_piece(mesh: &Triangles) -> Vec<bool> {
    let edges = directed_edges(mesh);
    let mut piece_of = vec![usize::MAX; mesh.triangles.len()];
    let mut sizes = Vec::new();
    for start in 0..mesh.triangles.len() {
        if piece_of[start] != usize::MAX {
            continue;
        }
        let (mut size, mut waiting) = (0usize, vec![start]);
        piece_of[start] = sizes.len();
        while let Some(k) = waiting.pop() {
            size += 1;
            let [a, b, c] = mesh.triangles[k];
            for edge in [[b, a], [c, b], [a, c]] {
                let Some(next) = triangle_at(&edges, edge) else { continue };
                if piece_of[next as usize] == usize::MAX {
                    piece_of[next as usize] = sizes.len();
                    waiting.push(next as usize);
                }
            }
        }
        sizes.push(size);
    }
    let mut largest = 0;
    for (piece, size) in sizes.iter().enumerate() {
        if *size > sizes[largest] {
            largest = piece;
        }
    }
    piece_of.iter().map(|piece| *piece != largest).collect()
}

/// Which triangles are at a vertex whose triangles are not one fan.
fn at_vertices_of_many_fans(mesh: &Triangles) -> Vec<bool> {
    let mut fans = vec![Vec::new(); mesh.positions.len()];
    for [a, b, c] in &mesh.triangles {
        fans[*a as usize].push([*b, *c]);
        fans[*b as usize].push([*c, *a]);
        fans[*c as usize].push([*a, *b]);
    }
    let is_pinched: Vec<bool> = fans.iter().map(|sides| !is_fan(sides)).collect();
    mesh.triangles.iter().map(|t| t.iter().any(|&v| is_pinched[v as usize])).collect()
}

/// Whether the far sides of the triangles at a vertex follow one another.
fn is_fan(sides: &[[u32; 2]]) -> bool {
    let Some(first) = sides.first() else { return true };
    let mut start = *first;
    for side in sides {
        if sides.iter().all(|other| other[1] != side[0]) {
            start = *side;
        }
    }
    let (mut side, mut count) = (start, 1);
    while let Some(next) = sides.iter().find(|other| other[0] == side[1]) {
        if *next == start || count > sides.len() {
            break;
        }
        side = *next;
        count += 1;
    }
    count == sides.len()
}
