//! The plane of a sheet that ISOMAP cannot lay flat: an injective map of the sheet's mesh, in which no triangle is turned
//! over however far the sheet bends. The paper has none.
//!
//! 1. The points, with normals that agree along the sheet, are made a triangle mesh (`implicit`);
//! 2. of it the largest piece that is a surface is kept (`cleaned`); with its holes filled it is a disc, or there is no
//!    map (`disc`);
//! 3. that is laid on a circle (`tutte`), which turns nothing over;
//! 4. lengths are made as true as can be, in steps that turn nothing over either (`relax`);
//! 5. every point of the sheet gets its place from the triangle it lies by (`places`).
//!
//! A sheet with one hole is a ring, and has a strip of the plane that begins again after a length, its period (`rolled`).
//!
//! All of it is exact to a mesh of its own: Tutte's theorem holds for discs with a convex rim and positive weights, and the
//! steps are checked triangle by triangle. Lengths are voxels.

mod implicit;

mod cleaned;

mod disc;

mod tutte;

mod relax;

mod places;

mod rolled;

use nalgebra::Point2;

use self::disc::Disc;
use self::implicit::{Oriented, Triangles, surface_through};
use self::places::places_of;
use self::relax::Map;
pub use self::rolled::{Rolled, rolled};
use self::tutte::on_circle;
use super::embedding::on_axes;
use super::tangents::Tangents;
use crate::cancel::{Cancel, Cancelled};
use crate::model::Stretch;
use crate::pipeline::surface::Surface;

/// Share of the area that is left out at either end of the stretches that are told.
const OUTERMOST: f64 = 0.02;

/// A sheet laid flat by its mesh.
#[derive(Clone, Debug)]
pub struct Unrolled {
    /// Plane coordinates of every point, voxels; `None` of those that lie off the mesh.
    pub places: Vec<Option<Point2<f64>>>,
    /// What the plane does to lengths.
    pub stretch: Stretch,
}

/// Lays a sheet with two sides flat by its mesh; `None` where that is no disc, or its energy (1 where all lengths are kept)
/// falls below `least_energy`.
///
/// # Errors
/// When it is cancelled.
pub fn unrolled(surface: &Surface, least_energy: f64, cancel: &dyn Cancel) -> Result<Option<Unrolled>, Cancelled> {
    let Some(disc) = Disc::of(mesh_of(surface, cancel)?, cancel)? else { return Ok(None) };
    let Some(first) = on_circle(&disc, cancel)? else { return Ok(None) };
    let mut map = Map::new(&disc, first);
    if !map.relax(4.0 * least_energy, cancel)? {
        return Ok(None);
    }
    let stretch = stretch(&map, cancel)?;
    let plane = on_axes(&map.places);
    let corners: Vec<_> = disc.triangles.iter().map(|triangle| triangle.map(|v| plane[v as usize])).collect();
    let places = places_of(&surface.positions, &disc, &corners, cancel)?;
    Ok(Some(Unrolled { places, stretch }))
}

/// The mesh of a sheet with two sides.
fn mesh_of(surface: &Surface, cancel: &dyn Cancel) -> Result<Triangles, Cancelled> {
    let tangents = Tangents::of(surface, cancel)?;
    let mut points = Oriented::default();
    for (position, normal) in surface.positions.iter().zip(tangents.normals()) {
        if let Some(normal) = normal {
            points.positions.push(*position);
            points.normals.push(normal);
        }
    }
    surface_through(&points, cancel)
}

/// What a map does to lengths.
fn stretch(map: &Map<'_>, cancel: &dyn Cancel) -> Result<Stretch, Cancelled> {
    let (mut low, mut high) = (Vec::new(), Vec::new());
    for ([most, least], area) in map.stretches(cancel)? {
        low.push((least, area));
        high.push((-most, area));
    }
    let energy = map.energy(&map.places, cancel)? / 4.0;
    Ok(Stretch { energy, least: outermost(low), most: -outermost(high) })
}

/// The value up to which the share [`OUTERMOST`] of the area lies.
fn outermost(mut values: Vec<(f64, f64)>) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let whole: f64 = values.iter().map(|value| value.1).sum();
    let mut sum = 0.0;
    for (value, area) in &values {
        sum += area;
        if sum >= OUTERMOST * whole {
            return *value;
        }
    }
    1.0
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use nalgebra::Point3;
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::cancel::{Never, Stopped};
    use crate::numerics::field::id;

    const RADIUS: f64 = 14.0;

    /// Points about one apart on a bowl of an opening angle, with some noise, each touching those around it.
    fn bowl(angle: f64) -> Surface {
        let count = (4.0 * PI * RADIUS * RADIUS).round();
        let uneven = |n: f64, step: f64| (n * step).fract() - 0.5;
        let mut positions = Vec::new();
        let mut n = 0.0;
        while n < count {
            // Fibonacci's lattice on a ball.
            let height: f64 = 1.0 - (2.0 * n + 1.0) / count;
            let (turn, radius) = (TAU * n * 0.618_033_988_75, RADIUS + 0.3 * uneven(n, 0.754_877));
            let ring = (1.0 - height * height).sqrt();
            if height.acos() <= angle {
                positions.push(Point3::new(ring * turn.cos(), ring * turn.sin(), height) * radius);
            }
            n += 1.0;
        }
        let mut adjacency = Vec::new();
        for a in &positions {
            let near = |b: &Point3<f64>| b != a && (b - a).norm() < 1.8;
            adjacency.push((0..positions.len()).filter(|&b| near(&positions[b])).map(id).collect());
        }
        Surface { positions, adjacency }
    }

    fn unrolled_bowl(degrees: f64) -> (Surface, Unrolled) {
        let surface = bowl(degrees.to_radians());
        let found = unrolled(&surface, 0.0, &Never).expect("not stopped").expect("a disc");
        (surface, found)
    }

    #[test]
    fn a_bowl_is_unrolled_without_a_fold() {
        for (degrees, energy) in [(60.0, 1.03), (90.0, 1.07), (120.0, 1.2), (150.0, 1.5)] {
            let (surface, found) = unrolled_bowl(degrees);
            let places: Vec<Point2<f64>> = found.places.iter().copied().flatten().collect();
            assert_eq!(places.len(), surface.positions.len(), "{degrees}°: all points lie on the mesh");
            let tangents = Tangents::of(&surface, &Never).expect("not stopped");
            let distortion = tangents.distortion(&places).expect("judged");
            assert_eq!(distortion.turned_over, 0.0, "{degrees}°");
            assert!((1.0..energy).contains(&found.stretch.energy), "{degrees}°: {:?}", found.stretch);
        }
    }

    #[test]
    fn a_bowl_s_meridians_keep_their_lengths_and_its_parallels_their_order() {
        let (surface, found) = unrolled_bowl(90.0);
        let pole = surface.positions.iter().position(|p| p.z > 0.99 * RADIUS - 0.3).expect("a pole");
        let middle = found.places[pole].expect("on the mesh");
        for (p, place) in surface.positions.iter().zip(&found.places) {
            let along = p.coords.angle(&surface.positions[pole].coords) * RADIUS;
            let distance = (place.expect("on the mesh") - middle).norm();
            // Those of a hemisphere are shortened by an eighth at the most, so that its rim is not stretched by half.
            assert!((0.8 * along - 1.0..1.1 * along + 1.0).contains(&distance), "{distance:.2} for {along:.2}");
        }
    }

    #[test]
    fn what_is_flat_stays_as_it_is() {
        let at = |n: usize| Point3::new((n % 30) as f64, (n / 30) as f64, 0.2 * ((n as f64 * 0.618_034).fract() - 0.5));
        let positions: Vec<_> = (0..600).map(at).collect();
        let touches = |a: usize, b: usize| a != b && (positions[a] - positions[b]).norm() < 1.6;
        let adjacency = (0..600).map(|a| (0..600).filter(|&b| touches(a, b)).map(id).collect()).collect();
        let surface = Surface { positions: positions.clone(), adjacency };
        let found = unrolled(&surface, 0.0, &Never).expect("not stopped").expect("a disc");
        assert!(found.stretch.energy < 1.003, "{:?}", found.stretch);
        for (a, b) in [(0, 29), (0, 570), (0, 599), (300, 315), (29, 570)] {
            let [from, to] = [a, b].map(|n| found.places[n].expect("on the mesh"));
            let length = (positions[b] - positions[a]).norm();
            assert!(((to - from).norm() - length).abs() < 0.6, "{a} to {b}: {:.2} for {length:.2}", (to - from).norm());
        }
    }

    #[test]
    fn what_is_no_disc_has_no_map() {
        let closed = bowl(PI);
        assert!(unrolled(&closed, 0.0, &Never).expect("not stopped").is_none(), "a ball");
        assert!(unrolled(&Surface::default(), 0.0, &Never).expect("not stopped").is_none(), "nothing");
        let mut band = bowl(2.0);
        let keep: Vec<u32> = (0..band.positions.len()).filter(|&p| band.positions[p].z < 6.0).map(id).collect();
        band = band.part(&keep, &Never).expect("not stopped");
        assert!(unrolled(&band, 0.0, &Never).expect("not stopped").is_none(), "a band");
    }

    /// Points about one apart on a cone's wall of a length, with some noise, each touching those around it.
    fn ring(first_radius: f64, slope: f64, length: usize) -> Surface {
        let uneven = |n: usize, step: f64| (n as f64 * step).fract() - 0.5;
        let mut positions = Vec::new();
        for row in 0..length {
            let radius = first_radius + slope * row as f64;
            let count = (TAU * radius).round();
            let mut k = 0.0;
            while k < count {
                let (turn, radius) = (TAU * k / count, radius + 0.2 * uneven(positions.len(), 0.754_877));
                let height = row as f64 * (1.0 - slope * slope).sqrt();
                positions.push(Point3::new(radius * turn.cos(), radius * turn.sin(), height));
                k += 1.0;
            }
        }
        let near = |a: usize, b: usize| a != b && (positions[a] - positions[b]).norm() < 1.7;
        let adjacency = (0..positions.len()).map(|a| (0..positions.len()).filter(|&b| near(a, b)).map(id).collect());
        Surface { adjacency: adjacency.collect(), positions: positions.clone() }
    }

    #[test]
    fn a_sheet_with_one_hole_is_laid_in_a_strip_that_begins_again() {
        for (slope, energy) in [(0.0, 1.01), (0.5, 1.03), (0.9, 1.08)] {
            let surface = ring(9.0, slope, 14);
            let found = rolled(&surface, &Never).expect("not stopped").expect("a ring");
            let places: Vec<Point2<f64>> = found.places.iter().copied().flatten().collect();
            assert_eq!(places.len(), surface.positions.len(), "{slope}: all points lie on the mesh");
            let tangents = Tangents::of(&surface, &Never).expect("not stopped");
            let distortion = tangents.distortion_round(&places, Some(found.period)).expect("judged");
            assert_eq!(distortion.turned_over, 0.0, "{slope}");
            let middle = TAU * (9.0 + slope * 6.5);
            assert!((found.period / middle - 1.0).abs() < 0.05, "{slope}: {:.1} of {middle:.1}", found.period);
            assert!((1.0..energy).contains(&found.stretch.energy), "{slope}: {:?}", found.stretch);
        }
    }

    #[test]
    fn what_has_no_hole_is_laid_in_no_strip() {
        assert!(rolled(&bowl(1.6), &Never).expect("not stopped").is_none(), "a bowl");
        assert!(rolled(&bowl(PI), &Never).expect("not stopped").is_none(), "a ball");
        assert!(rolled(&Surface::default(), &Never).expect("not stopped").is_none(), "nothing");
        assert!(rolled(&ring(9.0, 0.0, 14), &Stopped).is_err());
    }

    #[test]
    fn maps_do_not_depend_on_the_threads_and_can_be_stopped() {
        let surface = bowl(1.6);
        let on = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| unrolled(&surface, 0.0, &Never)).expect("not stopped").expect("a disc").places
        };
        assert_eq!(on(1), on(3));
        assert!(unrolled(&surface, 0.0, &Stopped).is_err());
    }
}
