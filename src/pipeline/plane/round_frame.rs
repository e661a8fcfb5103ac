//! The frame of a ring: where its columns begin, and which way they and its rows run. It is fixed by the world, as that of other
//! sheets (`frame`), so that the nodes of a follow-up lie where they lay.
//!
//! 1. The axis is the normal of the ellipse that the sheet goes round, its first harmonic: superior, anterior or lateral;
//! 2. columns begin where that ellipse is most superior, in a ring that lies level most anterior, and run round the axis
//!    counter-clockwise;
//! 3. rows lead towards what is superior, anterior or lateral in a band; in a washer, where they lead away from the hole all
//!    round, outward.

use std::f64::consts::{FRAC_PI_4, PI, TAU};

use nalgebra::{Point2, Vector2, Vector3};

use super::frame::{unit, world_direction};
use crate::model::{FrameFacts, FrameRule};
use crate::numerics::moments::{bounds, mean};
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;

/// Length of the mean direction of the rows up to which they have none in the world, and run outward: a band has 1, a washer 0.
const LEADS_NOWHERE: f64 = 0.3;

/// Turns a ring's strip into its frame, and says which it is.
pub(super) fn round_frame(
    (flat, period): (&[Point2<f64>], f64),
    sheet: &SheetSides,
    solid: &Solid,
) -> (Vec<Point2<f64>>, FrameFacts) {
    let ellipse = Ellipse::of(flat, period, sheet);
    let mut ambiguities = Vec::new();
    let mut sign_of = |name: &str, direction: Vector3<f64>| {
        let sense = solid.senses.of_direction(world_direction(direction, solid));
        ambiguities.extend(sense.ambiguity.map(|why| format!("{name} {why}")));
        sense.sign
    };
    let turning = sign_of("the axis that the columns run round", ellipse.normal());
    let outward = solid.superior_across(ellipse.normal() * turning);
    let start = ellipse.phase_towards(outward);
    let [low, high] = bounds(flat);
    let (middle, rows) = ((low.y + high.y) / 2.0, ellipse.rows);
    let leads = rows.norm() > LEADS_NOWHERE;
    let rows_sign = if leads { sign_of("the direction of the rows", rows) } else { ellipse.widening.signum() };
    let mut points = Vec::with_capacity(flat.len());
    for p in flat {
        let around = ((p.x / period - start / TAU) * turning).rem_euclid(1.0);
        points.push(Point2::new(around * period, (p.y - middle) * rows_sign));
    }
    let opposite = Opposite::of(&points, period, sheet);
    let sides = [period, high.y - low.y];
    let facts = FrameFacts {
        rule: FrameRule::RoundHole,
        cols_along: unit(world_direction(opposite.directions[0], solid)),
        rows_along: unit(world_direction(opposite.directions[1], solid)),
        upper_towards: unit(world_direction(opposite.normal, solid)),
        aspect: sides[0].max(sides[1]) / sides[0].min(sides[1]).max(1e-9),
        ambiguities,
    };
    (points, facts)
}

/// What a ring goes round: its first harmonic, c + a cos φ + b sin φ, and how its rows lead.
struct Ellipse {
    a: Vector3<f64>,
    b: Vector3<f64>,
    /// Slope of the positions across the strip, a mean over all of it.
    rows: Vector3<f64>,
    /// Whether it is wider where the second coordinate is larger, above 0, or where it is smaller.
    widening: f64,
}

impl Ellipse {
    fn of(flat: &[Point2<f64>], period: f64, sheet: &SheetSides) -> Self {
        let (centre, level) = (mean(&sheet.medial.positions), mean(flat).y);
        let (mut a, mut b, mut rows) = (Vector3::zeros(), Vector3::zeros(), Vector3::zeros());
        let (mut squares, mut widening) = (1e-9, 0.0);
        for (p, x) in flat.iter().zip(&sheet.medial.positions) {
            let (phase, way, height) = (TAU * p.x / period, x.coords - centre, p.y - level);
            a += way * phase.cos();
            b += way * phase.sin();
            rows += way * height;
            squares += height * height;
            widening += way.norm_squared() * height;
        }
        Self { a, b, rows: rows / squares, widening }
    }

    /// Unit normal, right-handed as the first coordinate grows.
    fn normal(&self) -> Vector3<f64> {
        self.a.cross(&self.b).try_normalize(1e-9).unwrap_or_else(Vector3::z)
    }

    /// Where it is farthest in a direction.
    fn phase_towards(&self, direction: Vector3<f64>) -> f64 {
        self.b.dot(&direction).atan2(self.a.dot(&direction))
    }
}

/// A ring's directions where it is half way round.
struct Opposite {
    /// Along the first and the second coordinate.
    directions: [Vector3<f64>; 2],
    normal: Vector3<f64>,
}

impl Opposite {
    /// Of the eighths of the strip on both sides of its middle.
    fn of(flat: &[Point2<f64>], period: f64, sheet: &SheetSides) -> Self {
        let is_near = |p: &Point2<f64>| (TAU * p.x / period - PI).abs() < FRAC_PI_4;
        let near: Vec<usize> = (0..flat.len()).filter(|&k| is_near(&flat[k])).collect();
        let places: Vec<Point2<f64>> = near.iter().map(|&k| flat[k]).collect();
        let positions: Vec<_> = near.iter().map(|&k| sheet.medial.positions[k]).collect();
        let (centre, middle) = (mean(&places), mean(&positions));
        let (mut directions, mut normal) = ([Vector3::zeros(); 2], Vector3::zeros());
        for &k in &near {
            let way: Vector2<f64> = flat[k].coords - centre;
            for (axis, direction) in directions.iter_mut().enumerate() {
                *direction += (sheet.medial.positions[k].coords - middle) * way[axis];
            }
            normal += sheet.normals[k];
        }
        Self { directions, normal }
    }
}
