//! A scene laid flat: projected, shaded, and the far before the near.

use nalgebra::Vector3;

use super::colors::{Rgb, mixed};
use super::scene::{Item, Mark, Scene};
use super::view::View;
use crate::space::WorldPoint;

/// Where light comes from: from the left, above, and the eye.
const LIGHT: [f64; 3] = [-0.35, 0.55, 0.76];
/// How much of its colour a face keeps that light does not reach.
const SHADE: f64 = 0.55;
/// How much of its colour the farthest dot loses.
const HAZE: f64 = 0.5;
/// Steps of distance that dots are put in: within a step they are drawn as they were added, which leaves those of a kind
/// together. With ten, steps show as stripes.
const STEPS: f64 = 32.0;
const BLACK: Rgb = [0; 3];
const WHITE: Rgb = [255; 3];

/// A thing in the plane of a picture, mm to the right and upwards.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Drawn {
    pub form: Form,
    pub color: Rgb,
    pub opacity: f64,
    /// How near it is to the eye, mm.
    nearness: f64,
}

/// The form of a thing in the plane.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Form {
    Face { corners: Vec<[f64; 2]>, edge: Option<Rgb> },
    Line { ends: [[f64; 2]; 2], width_px: f64 },
    Dot { at: [f64; 2], radius_px: f64 },
}

impl Form {
    /// Its points.
    pub fn points(&self) -> &[[f64; 2]] {
        match self {
            Self::Face { corners, .. } => corners,
            Self::Line { ends, .. } => ends,
            Self::Dot { at, .. } => std::slice::from_ref(at),
        }
    }
}

/// All things of a scene that are finite, in the order in which they are to be drawn.
pub(super) fn drawn(scene: &Scene, view: &View) -> Vec<Drawn> {
    let mut all: Vec<Drawn> = scene.items.iter().filter_map(|item| laid_flat(item, view)).collect();
    fade_far_dots(&mut all);
    // Stable: of equally near things the one that was added later lies over the other.
    all.sort_by(|a, b| a.nearness.total_cmp(&b.nearness));
    all
}

/// The smallest and the largest coordinates; `None` of nothing.
pub(super) fn bounds(all: &[Drawn]) -> Option<[[f64; 2]; 2]> {
    let mut bounds: Option<[[f64; 2]; 2]> = None;
    for point in all.iter().flat_map(|drawn| drawn.form.points()) {
        let [low, high] = bounds.get_or_insert([*point; 2]);
        for axis in 0..2 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    bounds
}

/// One thing; `None` of what is not finite or has too few corners.
fn laid_flat(item: &Item, view: &View) -> Option<Drawn> {
    let Item { mark, color, opacity } = item;
    let points: &[WorldPoint] = match mark {
        Mark::Face { corners, .. } => corners,
        Mark::Line { ends, .. } => ends,
        Mark::Dot { at, .. } => std::slice::from_ref(at),
    };
    let projected: Vec<[f64; 3]> = points.iter().map(|point| view.project(*point)).collect();
    if projected.is_empty() || !projected.iter().flatten().all(|x| x.is_finite()) {
        return None;
    }
    let nearness = projected.iter().map(|[_, _, near]| near).sum::<f64>() / projected.len() as f64;
    let places: Vec<[f64; 2]> = projected.iter().map(|&[x, y, _]| [x, y]).collect();
    let (form, color) = match mark {
        Mark::Face { .. } if places.len() < 3 => return None,
        Mark::Face { edge, .. } => (Form::Face { corners: places, edge: *edge }, shaded(*color, &projected)),
        Mark::Line { width_px, .. } => (Form::Line { ends: [places[0], places[1]], width_px: *width_px }, *color),
        Mark::Dot { radius_px, .. } => (Form::Dot { at: places[0], radius_px: *radius_px }, *color),
    };
    Some(Drawn { form, color, opacity: *opacity, nearness })
}

/// The colour of a face in the light, whichever way it faces.
fn shaded(color: Rgb, corners: &[[f64; 3]]) -> Rgb {
    // Newell's normal: right for corners that are not in one plane too.
    let mut normal = Vector3::zeros();
    for (n, here) in corners.iter().enumerate() {
        let next = corners[(n + 1) % corners.len()];
        normal += Vector3::from(*here).cross(&Vector3::from(next));
    }
    lit(color, normal)
}

/// A colour in the light, whichever way its surface faces.
pub(super) fn lit(color: Rgb, normal: Vector3<f64>) -> Rgb {
    let Some(normal) = normal.try_normalize(1e-12) else { return color };
    let to_eye = if normal.z < 0.0 { -normal } else { normal };
    let light = to_eye.dot(&Vector3::from(LIGHT)).max(0.0);
    mixed(BLACK, color, SHADE + (1.0 - SHADE) * light)
}

/// Puts dots into steps of distance and makes them paler from step to step, so that a cloud of them has a depth.
fn fade_far_dots(all: &mut [Drawn]) {
    let is_dot = |drawn: &&mut Drawn| matches!(drawn.form, Form::Dot { .. });
    let (mut far, mut near) = (f64::INFINITY, f64::NEG_INFINITY);
    for dot in all.iter_mut().filter(is_dot) {
        (far, near) = (far.min(dot.nearness), near.max(dot.nearness));
    }
    for dot in all.iter_mut().filter(is_dot) {
        let distance = (STEPS * (near - dot.nearness) / (near - far).max(1e-9)).round() / STEPS;
        dot.color = mixed(dot.color, WHITE, HAZE * distance);
        dot.nearness = near - distance * (near - far);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::WorldVector;

    fn from_above() -> View {
        View::new(WorldVector::z(), WorldVector::y()).expect("two directions")
    }

    /// A square at a height, leaning by `slope` along x.
    fn square(z: f64, slope: f64) -> Mark {
        let corner = |x: f64, y: f64| WorldPoint::new(x, y, z + slope * x);
        Mark::Face { corners: vec![corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)], edge: None }
    }

    #[test]
    fn the_near_lies_over_the_far_and_the_later_over_the_equal() {
        let mut scene = Scene::default();
        for (z, color) in [(5.0, [1; 3]), (0.0, [2; 3]), (5.0, [3; 3])] {
            let ends = [WorldPoint::new(0.0, 0.0, z), WorldPoint::new(1.0, 2.0, z)];
            scene.add_line(ends, 1, color, 1.0);
        }
        let order = |view: View| drawn(&scene, &view).iter().map(|drawn| drawn.color[0]).collect::<Vec<_>>();
        assert_eq!(order(from_above()), [2, 1, 3]);
        assert_eq!(order(from_above().turned_over()), [1, 3, 2]);
        assert_eq!(bounds(&drawn(&scene, &from_above())), Some([[0.0, 0.0], [1.0, 2.0]]));
    }

    #[test]
    fn a_face_that_leans_to_the_light_is_brighter_from_both_sides() {
        let mut scene = Scene::default();
        for slope in [0.7, -0.7] {
            scene.add(square(0.0, slope), [200; 3], 1.0);
        }
        let both = drawn(&scene, &from_above());
        let brightness = |number: usize| both[number].color[0];
        // The one whose middle is lower comes first: it falls to the right, away from the light at the left.
        assert!(brightness(0) < brightness(1), "{both:?}");
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let mut scene = Scene::default();
        scene.add(Mark::Dot { at: WorldPoint::new(f64::NAN, 0.0, 0.0), radius_px: 1.0 }, [0; 3], 1.0);
        scene.add(Mark::Face { corners: vec![WorldPoint::origin(); 2], edge: None }, [0; 3], 1.0);
        assert!(drawn(&scene, &from_above()).is_empty());
        assert_eq!(bounds(&[]), None);
    }

    #[test]
    fn far_dots_are_paler() {
        let mut scene = Scene::default();
        for z in [0.0, 1.0] {
            scene.add(Mark::Dot { at: WorldPoint::new(0.0, 0.0, z), radius_px: 1.0 }, [0; 3], 1.0);
        }
        let dots = drawn(&scene, &from_above());
        assert_eq!([dots[0].color, dots[1].color], [[128; 3], [0; 3]]);
    }
}
