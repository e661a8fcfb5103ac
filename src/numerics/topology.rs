//! Digital topology of the 26-neighbourhood, (26, 6) connectivity: simple points (Malandain,
//! Bertrand, *Fast characterization of 3D simple points*, ICPR 1992) and surface end points
//! (Pudney, *Distance-ordered homotopic thinning*, CVIU 72, 1998).
//!
//! A neighbourhood is 27 bits: bit `(dx+1) + 3(dy+1) + 9(dz+1)`, bit 13 the centre.

use crate::space::Grid;

use super::parallel::each_number;
use crate::cancel::{Cancel, Cancelled};

/// The centre's bit number.
pub(crate) const CENTRE: u32 = 13;

const TABLES: Tables = Tables::new();

/// Neighbourhood of the voxel at `offset` of a grid with row stride `nx` and plane stride `nxy`, the
/// lowest bit of `cell` saying whether a voxel is in the set; it must not lie on the grid's edge.
#[must_use]
pub fn neighborhood(cell: impl Fn(usize) -> u8, offset: usize, nx: usize, nxy: usize) -> u32 {
    let mut bits = 0;
    let mut bit = 0;
    for z in [offset - nxy, offset, offset + nxy] {
        for y in [z - nx, z, z + nx] {
            for x in [y - 1, y, y + 1] {
                bits |= u32::from(cell(x) & 1) << bit;
                bit += 1;
            }
        }
    }
    bits
}

/// Offsets of the 27 voxels of a neighbourhood, ascending.
#[must_use]
pub(crate) fn cube(offset: usize, nx: usize, nxy: usize) -> [usize; 27] {
    let mut voxels = [0; 27];
    let mut bit = 0;
    for z in [offset - nxy, offset, offset + nxy] {
        for y in [z - nx, z, z + nx] {
            for x in [y - 1, y, y + 1] {
                voxels[bit] = x;
                bit += 1;
            }
        }
    }
    voxels
}

/// Offsets of the six voxels that share a face with one, ascending.
#[must_use]
pub fn beside(offset: usize, nx: usize, nxy: usize) -> [usize; 6] {
    [offset - nxy, offset - nx, offset - 1, offset + 1, offset + nx, offset + nxy]
}

/// Whether taking the centre away changes no topology: one 26-component of foreground around
/// it, and one 6-component of background in the 18-neighbourhood that touches it by a face.
#[must_use]
pub fn is_simple(bits: u32) -> bool {
    let foreground = bits & !(1 << CENTRE);
    if foreground == 0 {
        return false;
    }
    let background = !bits & TABLES.near18;
    let faces = background & TABLES.faces;
    if faces == 0 {
        return false;
    }
    grown(background, lowest(faces), &TABLES.touch6) & faces == faces
        && grown(foreground, lowest(foreground), &TABLES.touch26) == foreground
}

/// Whether the centre is the end of a surface: in one of the nine digital planes through it,
/// it has at most one neighbour.
#[must_use]
pub(crate) fn is_surface_end(bits: u32) -> bool {
    TABLES.planes.iter().any(|plane| (bits & plane).count_ones() < 2)
}

fn lowest(bits: u32) -> u32 {
    bits & bits.wrapping_neg()
}

/// What `seed` grows to inside `allowed` along `touch`.
fn grown(allowed: u32, seed: u32, touch: &[u32; 27]) -> u32 {
    let mut grown = seed;
    let mut front = seed;
    while front != 0 {
        let mut reach = 0;
        while front != 0 {
            reach |= touch[front.trailing_zeros() as usize];
            front &= front - 1;
        }
        front = reach & allowed & !grown;
        grown |= front;
    }
    grown
}

struct Tables {
    touch6: [u32; 27],
    touch26: [u32; 27],
    near18: u32,
    faces: u32,
    planes: [u32; 9],
}

impl Tables {
    const fn new() -> Self {
        let mut touch6 = [0; 27];
        let mut touch26 = [0; 27];
        let (mut near18, mut faces) = (0u32, 0u32);
        let mut a = 0;
        while a < 27 {
            let reach = norm1(place(a));
            if reach == 1 {
                faces |= 1 << a;
            }
            if reach == 1 || reach == 2 {
                near18 |= 1 << a;
            }
            let mut b = 0;
            while b < 27 {
                let d = minus(place(a), place(b));
                if norm1(d) == 1 {
                    touch6[a] |= 1 << b;
                }
                if a != b && norm_max(d) == 1 {
                    touch26[a] |= 1 << b;
                }
                b += 1;
            }
            a += 1;
        }
        Self { touch6, touch26, near18, faces, planes: planes() }
    }
}

/// The nine planes through the centre: three axial, six diagonal; without the centre.
const fn planes() -> [u32; 9] {
    const NORMALS: [[i32; 3]; 9] =
        [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]];
    let mut planes = [0u32; 9];
    let mut p = 0;
    while p < 9 {
        let mut b = 0;
        while b < 27 {
            let c = place(b);
            let n = NORMALS[p];
            if b != 13 && c[0] * n[0] + c[1] * n[1] + c[2] * n[2] == 0 {
                planes[p] |= 1 << b;
            }
            b += 1;
        }
        p += 1;
    }
    planes
}

#[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "bit numbers are below 27")]
const fn place(bit: usize) -> [i32; 3] {
    [(bit % 3) as i32 - 1, (bit / 3 % 3) as i32 - 1, (bit / 9) as i32 - 1]
}

const fn minus(a: [i32; 3], b: [i32; 3]) -> [i32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

const fn norm1(d: [i32; 3]) -> i32 {
    d[0].abs() + d[1].abs() + d[2].abs()
}

const fn norm_max(d: [i32; 3]) -> i32 {
    let mut m = d[0].abs();
    if d[1].abs() > m {
        m = d[1].abs();
    }
    if d[2].abs() > m {
        m = d[2].abs();
    }
    m
}

/// Euler number of a set of closed voxels (components − tunnels + cavities, in the sense of 26
/// neighbours): corners − edges + faces − voxels of their union.
///
/// # Errors
/// When it is cancelled.
pub fn euler_number(set: &Grid<bool>, cancel: &dyn Cancel) -> Result<i64, Cancelled> {
    let shares = euler_shares();
    let planes = set.dims()[2] + 1;
    Ok(each_number(planes, 1, |k| in_plane_of_corners(set, k, &shares), cancel)?.into_iter().sum())
}

/// Sum over the corners of a plane between voxels `k − 1` and `k`.
fn in_plane_of_corners(set: &Grid<bool>, k: usize, shares: &[i64; 256]) -> i64 {
    let [nx, ny, nz] = set.dims();
    let mut sum = 0;
    for j in 0..=ny {
        // The four rows that meet along the grid line of these corners.
        let mut rows: [&[bool]; 4] = [&[]; 4];
        for (b, row) in rows.iter_mut().enumerate() {
            let (j, k) = (j.wrapping_sub(b & 1), k.wrapping_sub(b >> 1));
            if j < ny && k < nz {
                *row = &set.as_slice()[nx * (j + ny * k)..nx * (j + ny * k + 1)];
            }
        }
        if rows.iter().any(|row| row.contains(&true)) {
            sum += along_corners(rows, nx, shares);
        }
    }
    sum
}

/// Sum over the corners along four rows, each empty or `nx` long.
fn along_corners(rows: [&[bool]; 4], nx: usize, shares: &[i64; 256]) -> i64 {
    let mut around = 0usize;
    let mut sum = 0;
    for i in 0..=nx {
        // Bit 2b: the voxel of row b at the corner; bit 2b + 1: the one before it.
        around = around << 1 & 0b1010_1010;
        for (b, row) in rows.iter().enumerate() {
            around |= usize::from(row.get(i).copied().unwrap_or(false)) << (2 * b);
        }
        sum += shares[around];
    }
    sum
}

/// What a corner adds for each set of the eight voxels around it: a corner is shared by the voxels 0
/// or 1 back along each axis, an edge along two, a face along one.
fn euler_shares() -> [i64; 256] {
    /// Bits of the axes, and the sign that the cell counts with.
    const CELLS: [(usize, i64); 8] = [(7, 1), (6, -1), (5, -1), (3, -1), (1, 1), (2, 1), (4, 1), (0, -1)];
    let mut shares = [0; 256];
    for (around, share) in shares.iter_mut().enumerate() {
        for (axes, sign) in CELLS {
            let touches = (0..8).any(|back| back & axes == back && around >> back & 1 == 1);
            *share += if touches { sign } else { 0 };
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(cells: &[[i32; 3]]) -> u32 {
        cells.iter().fold(1 << CENTRE, |b, c| b | 1 << ((c[0] + 1) + 3 * (c[1] + 1) + 9 * (c[2] + 1)))
    }

    #[test]
    fn simple_points_are_those_that_change_no_topology() {
        assert!(!is_simple(bits(&[])), "an isolated voxel is a component");
        assert!(is_simple(bits(&[[1, 0, 0]])), "the tip of a line is simple");
        assert!(!is_simple(bits(&[[1, 0, 0], [-1, 0, 0]])), "the middle of a line joins");
        assert!(is_simple(bits(&[[1, 0, 0], [1, 1, 0]])));
        assert!(!is_simple((1 << 27) - 1), "an inner voxel would leave a cavity");
        let plane: Vec<_> =
            (-1..=1).flat_map(|x| (-1..=1).map(move |y| [x, y, 0])).filter(|c| *c != [0, 0, 0]).collect();
        assert!(!is_simple(bits(&plane)), "the middle of a sheet would leave a hole");
    }

    #[test]
    fn the_rim_of_a_sheet_is_its_end_and_its_middle_is_not() {
        let half: Vec<_> = (-1..=1).flat_map(|x| (0..=1).map(move |y| [x, y, 0])).filter(|c| *c != [0, 0, 0]).collect();
        assert!(is_surface_end(bits(&half)));
        assert!(!is_surface_end((1 << 27) - 1));
    }
}
