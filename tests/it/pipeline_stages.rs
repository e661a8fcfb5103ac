//! Properties of single stages.

use std::collections::BTreeSet;

use medialrep::cancel::Never;
use medialrep::model::LatticeSize;
use medialrep::numerics::topology::{is_simple, neighborhood};
use medialrep::params::{Embedding, Landmarks, LatticeKind, Neighbors};
use medialrep::pipeline::chart::{Chart, Ends};
use medialrep::pipeline::lattice::map::SpaceFromPlane;
use medialrep::pipeline::medial::{MedialSurface, medial_surface};
use medialrep::pipeline::plane::embedding::{EmbeddingError, Method, flatten};
use medialrep::pipeline::plane::region::Region;
use medialrep::pipeline::sheets::{Joining, sheets};
use medialrep::pipeline::sides::sides;
use medialrep::pipeline::solid::Solid;
use medialrep::pipeline::solid::depth::Depth;
use medialrep::pipeline::surface::Surface;
use medialrep::space::{Grid, LabelVolume};
use nalgebra::{Point3, Rotation3};

use crate::help::phantoms::{context, deepened, defaults, painted, sample, turned, volume};

fn thinned(volume: &LabelVolume) -> (Solid, Depth, MedialSurface) {
    let (solid, depth) = deepened(volume);
    let surface = medial_surface(&solid, &depth, &context(&defaults())).expect("not cancelled");
    (solid, depth, surface)
}

fn set_of(surface: &MedialSurface, dims: [usize; 3]) -> Grid<bool> {
    let mut set = Grid::filled(dims, false);
    surface.points.iter().for_each(|p| set.as_mut_slice()[p.voxel] = true);
    set
}

/// Euler characteristic of the union of closed voxels: corners − edges + faces − cubes.
fn euler(set: &Grid<bool>) -> i64 {
    let mut cells = [BTreeSet::new(), BTreeSet::new(), BTreeSet::new(), BTreeSet::new()];
    for o in (0..set.as_slice().len()).filter(|&o| set.as_slice()[o]) {
        let [i, j, k] = set.index(o).map(|x| 2 * x + 1);
        for (x, y, z) in (0..27).map(|n| (i + n % 3 - 1, j + n / 3 % 3 - 1, k + n / 9 - 1)) {
            // A cell's dimension is its number of odd coordinates.
            cells[x % 2 + y % 2 + z % 2].insert([x, y, z]);
        }
    }
    let count = |d: usize| i64::try_from(cells[d].len()).expect("small");
    count(0) - count(1) + count(2) - count(3)
}

#[test]
fn thinning_keeps_the_topology_and_leaves_nothing_to_thin() {
    for name in ["leaf", "tee", "mobius"] {
        for rotation in [Rotation3::identity(), turned()] {
            let volume = sample(name).voxelise([1.5; 3], rotation).expect("fits");
            let (solid, _, surface) = thinned(&volume);
            let set = set_of(&surface, solid.inside.dims());
            assert_eq!(euler(&set), euler(&solid.inside), "{name}");
            let [nx, ny, _] = set.dims();
            let thick = surface.points.iter().filter(|p| {
                let bits = neighborhood(|n| u8::from(set.as_slice()[n]), p.voxel, nx, nx * ny);
                is_simple(bits) && bits.count_ones() > 22
            });
            assert_eq!(thick.count(), 0, "{name} has thick places");
        }
    }
}

#[test]
fn medial_points_are_equally_far_from_both_feet() {
    let (_, _, surface) = thinned(&volume("leaf"));
    let sure: Vec<_> = surface.points.iter().filter(|p| p.feet_cosine < -0.7).collect();
    assert!(sure.len() > 300);
    let uneven = |p: &medialrep::pipeline::medial::MedialPoint| {
        ((p.feet[0] - p.position).norm() - (p.feet[1] - p.position).norm()).abs()
    };
    let mean = sure.iter().map(|p| uneven(p)).sum::<f64>() / sure.len() as f64;
    assert!(mean < 0.05, "feet differ by {mean:.3} voxels in the mean");
}

#[test]
fn sides_lie_on_opposite_sides_and_are_one_piece() {
    let (solid, depth, surface) = thinned(&volume("twisted"));
    let params = defaults();
    let context = context(&params);
    let found = sheets(&surface, &solid, &depth, Joining::Alone, &context).unwrap();
    let sides = sides(&solid, &depth, &surface, &found, &context).expect("orientable");
    assert_eq!(sides.len(), 1);
    for (side, sign) in [(&sides[0].upper, 1.0), (&sides[0].lower, -1.0)] {
        assert_eq!(side.surface.largest_piece(&Never).unwrap().len(), side.surface.positions.len());
        for (p, &partner) in side.surface.positions.iter().zip(&side.partners) {
            let k = partner as usize;
            let height = (p - sides[0].medial.positions[k]).dot(&sides[0].normals[k]);
            assert!(sign * height > 0.0);
        }
    }
    assert!(sides[0].crest > 0);
}

/// A grid of points one apart, each touching the eight around it.
fn sheet_of(rows: u32, cols: u32, place: impl Fn(u32, u32) -> Point3<f64>) -> Surface {
    let mut surface = Surface::default();
    for i in 0..rows {
        for j in 0..cols {
            let near = |a: u32, most: u32| a.saturating_sub(1)..(a + 2).min(most);
            let list = near(i, rows).flat_map(|a| near(j, cols).map(move |b| (a, b)));
            surface.positions.push(place(i, j));
            surface.adjacency.push(list.filter(|&(a, b)| (a, b) != (i, j)).map(|(a, b)| a * cols + b).collect());
        }
    }
    surface
}

/// A strip of points folded back onto itself, its two halves 3 apart.
fn hairpin() -> Surface {
    let bend = |s: f64| match s {
        s if s < 30.0 => (s, 0.0),
        s if s < 33.0 => (30.0, s - 30.0),
        s => (63.0 - s, 3.0),
    };
    sheet_of(12, 63, |i, j| {
        let (x, z) = bend(f64::from(j));
        Point3::new(x, f64::from(i), z)
    })
}

fn isomap(neighbors: Neighbors, landmarks: Landmarks) -> Method {
    Method { embedding: Embedding::Isomap, neighbors, landmarks }
}

#[test]
fn no_edge_jumps_across_a_fold() {
    for neighbors in [Neighbors::Auto, Neighbors::Count(30), Neighbors::RadiusMm(4.0)] {
        let flat = flatten(&hairpin(), isomap(neighbors, Landmarks::Auto), 1.0, u64::MAX, &Never).expect("flat");
        let length = (flat.points[62] - flat.points[0]).norm();
        // Edges may cut the corners of the bend, which takes up to 6; a jump would take 50.
        assert!((54.0..64.0).contains(&length), "{neighbors:?}: 62 along the strip, {length:.1} in the plane");
        assert!(flat.embedded.expect("laid flat").residual_variance < 0.01);
    }
}

#[test]
fn a_flat_sheet_is_laid_flat_with_its_lengths() {
    let sheet = sheet_of(30, 40, |i, j| Point3::new(f64::from(j), f64::from(i), 0.0));
    let flat = flatten(&sheet, isomap(Neighbors::Count(50), Landmarks::All), 1.0, u64::MAX, &Never).expect("flat");
    let far = (1..sheet.positions.len()).filter(|&p| (sheet.positions[p] - sheet.positions[0]).norm() > 8.0);
    let errors: Vec<f64> = far
        .map(|p| (flat.points[p] - flat.points[0]).norm() / (sheet.positions[p] - sheet.positions[0]).norm() - 1.0)
        .collect();
    let worst = errors.iter().map(|e| e.abs()).fold(0.0, f64::max);
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    // Shortest paths over 50 neighbours are up to 1.3 % too long.
    assert!(worst < 0.05 && mean.abs() < 0.02, "lengths are off by {mean:.3} in the mean, {worst:.3} at most");
}

#[test]
fn degenerate_surfaces_are_typed_outcomes() {
    let line = |n: u32| Surface {
        positions: (0..n).map(|k| Point3::new(f64::from(k), 0.0, 0.0)).collect(),
        adjacency: (0..n).map(|k| (k.saturating_sub(1)..(k + 2).min(n)).filter(|&m| m != k).collect()).collect(),
    };
    let flat =
        |surface: &Surface| flatten(surface, isomap(Neighbors::Auto, Landmarks::Auto), 1.0, u64::MAX, &Never).err();
    assert_eq!(flat(&line(3)), Some(EmbeddingError::TooFewPoints { points: 3 }));
    assert_eq!(flat(&line(40)), Some(EmbeddingError::NoPlane));
}

/// Points of a half ring, 20 to 32 from its centre.
fn crescent() -> Vec<nalgebra::Point2<f64>> {
    let on = |r: f64| (0..=80).map(move |n| (r, std::f64::consts::PI * f64::from(n) / 80.0));
    let rings = (20..=32).flat_map(|r| on(f64::from(r)));
    rings.map(|(r, angle)| nalgebra::Point2::new(r * angle.cos(), r * angle.sin())).collect()
}

#[test]
fn a_lattice_stays_inside_a_crescent_and_does_not_fold() {
    let size = LatticeSize { rows: 8, cols: 20 };
    let region = Region::of(&crescent(), &Never).unwrap();
    let chart = Chart::of(&region, LatticeKind::Fitted, (Ends::OfTails, 0.0), &Never).unwrap().expect("a region");
    let found = chart.lattice(size, 0.05, &Never).unwrap();
    assert!(found.valid.iter().all(|v| *v), "a node lies in the hollow");
    let radii = found.nodes.iter().map(|n| n.coords.norm());
    assert!(radii.clone().all(|r| (19.0..33.0).contains(&r)), "{:?}", radii.collect::<Vec<_>>());
    let node = |i: usize, j: usize| found.nodes[i * size.cols + j];
    for (i, j) in (0..7).flat_map(|i| (0..19).map(move |j| (i, j))) {
        let turn = (node(i, j + 1) - node(i, j)).perp(&(node(i + 1, j) - node(i, j)));
        assert!(turn > 0.0, "the cell at ({i}, {j}) is turned over");
    }
}

#[test]
fn a_node_far_from_all_points_is_not_flung_off() {
    let flat = crescent();
    let positions: Vec<_> = flat.iter().map(|p| Point3::new(p.x, p.y, 0.02 * p.x * p.x)).collect();
    let map = SpaceFromPlane::new(&flat, &positions, &[]);
    for p in [nalgebra::Point2::new(0.0, 0.0), nalgebra::Point2::new(60.0, 60.0), nalgebra::Point2::new(-200.0, 5.0)] {
        let node = map.node(p).position;
        let nearest = positions.iter().map(|q| (q - node).norm()).fold(f64::INFINITY, f64::min);
        assert!(nearest < 2.0, "{p}: {nearest:.1} from the sheet");
    }
}

#[test]
fn an_even_thickness_is_thinned_to_one_layer() {
    let slab = |[i, j, k]: [usize; 3]| (6..46).contains(&i) && (6..40).contains(&j) && (6..14).contains(&k);
    let (solid, _, surface) = thinned(&painted([52, 46, 20], [1.0; 3], |at| u16::from(slab(at))));
    let middle = |p: &&medialrep::pipeline::medial::MedialPoint| {
        let from_edge = |x: f64, n: usize| x.min(n as f64 - 1.0 - x);
        let dims = solid.inside.dims();
        from_edge(p.position.x, dims[0]) > 12.0 && from_edge(p.position.y, dims[1]) > 12.0
    };
    let layers: BTreeSet<usize> =
        surface.points.iter().filter(middle).map(|p| solid.inside.index(p.voxel)[2]).collect();
    assert_eq!(layers.len(), 1, "the middle of eight layers is corrugated over {layers:?}");
}
