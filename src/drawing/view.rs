//! From where a scene is looked at.

use nalgebra::{Matrix3, Rotation3, Unit};

use crate::model::{Figure, Side, Structure};
use crate::numerics::moments::{Axes3, mean};
use crate::space::{WorldPoint, WorldVector};

/// A parallel projection: three unit directions at right angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// To the right of the picture.
    right: WorldVector,
    /// To its upper edge.
    up: WorldVector,
    /// To the eye.
    toward: WorldVector,
}

impl View {
    /// From the direction in which the eye is and one that points upwards in the picture. `None` where one is no
    /// direction, or both are the same.
    #[must_use]
    pub fn new(toward: WorldVector, up: WorldVector) -> Option<Self> {
        let toward = toward.try_normalize(1e-9)?;
        let right = up.cross(&toward).try_normalize(1e-9)?;
        Some(Self { right, up: toward.cross(&right), toward })
    }

    /// Onto the broad face of points: their longest principal axis lies to the right, their shortest towards the eye.
    /// Axes point to where their largest coordinate in the world is positive, so that the same anatomy is seen from the
    /// same side. Points that are not finite do not count; without any it is the view from above.
    #[must_use]
    pub fn face_on(points: &[WorldPoint]) -> Self {
        let finite: Vec<WorldPoint> = points.iter().copied().filter(|p| p.iter().all(|x| x.is_finite())).collect();
        let middle = mean(&finite);
        let mut moments = Matrix3::zeros();
        for point in &finite {
            let from_middle = point.coords - middle;
            moments += from_middle * from_middle.transpose();
        }
        let [right, up, _] = Axes3::of(moments).directions.map(towards_positive);
        Self { right, up, toward: right.cross(&up) }
    }

    /// Onto the figures of a structure: with sheets the mean of their upper vectors points towards the eye, and the
    /// longest principal axis of all nodes lies to the right as far as that leaves it.
    #[must_use]
    pub fn of_structure(structure: &Structure) -> Self {
        let (mut nodes, mut upwards) = (Vec::new(), WorldVector::zeros());
        for figure in &structure.figures {
            match figure {
                Figure::Sheet(sheet) => {
                    nodes.extend(&sheet.medial);
                    for (vector, is_seen) in sheet.vectors(Side::Upper).iter().zip(sheet.drawable()) {
                        if is_seen {
                            upwards += vector;
                        }
                    }
                }
                Figure::Tube(tube) => nodes.extend(&tube.wall),
            }
        }
        let face_on = Self::face_on(&nodes);
        Self::new(upwards, upwards.cross(&face_on.right)).unwrap_or(face_on)
    }

    /// From the other side, right and left as they were.
    #[must_use]
    pub fn turned_over(self) -> Self {
        Self { right: self.right, up: -self.up, toward: -self.toward }
    }

    /// With the scene turned in the picture, counter-clockwise.
    #[must_use]
    pub fn spun(self, degrees: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(self.toward), -degrees.to_radians());
        Self { right: turn * self.right, up: turn * self.up, toward: self.toward }
    }

    /// With the eye lowered: what was seen from above is seen from the front.
    #[must_use]
    pub fn tilted(self, degrees: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&Unit::new_unchecked(self.right), degrees.to_radians());
        Self { right: self.right, up: turn * self.up, toward: turn * self.toward }
    }

    /// Where a point is in the picture, mm: to the right, upwards, and towards the eye.
    #[must_use]
    pub fn project(&self, point: WorldPoint) -> [f64; 3] {
        [self.right, self.up, self.toward].map(|axis| axis.dot(&point.coords))
    }

    /// From in front of a patient who lies as the world says (RAS), their head up.
    #[must_use]
    pub fn from_front() -> Self {
        Self { right: -WorldVector::x(), up: WorldVector::z(), toward: WorldVector::y() }
    }

    /// From the patient's left, their head up.
    #[must_use]
    pub fn from_left() -> Self {
        Self { right: -WorldVector::y(), up: WorldVector::z(), toward: -WorldVector::x() }
    }

    /// From the patient's feet, their face up: as axial slices are shown.
    #[must_use]
    pub fn from_feet() -> Self {
        Self { right: -WorldVector::x(), up: WorldVector::y(), toward: -WorldVector::z() }
    }

    /// Letters of the sides of the patient that lie to the left, right, top and bottom of the picture.
    #[must_use]
    pub fn letters(&self) -> [char; 4] {
        [-self.right, self.right, self.up, -self.up].map(letter)
    }

    /// A direction in the same terms.
    #[must_use]
    pub fn project_vector(&self, vector: WorldVector) -> [f64; 3] {
        [self.right, self.up, self.toward].map(|axis| axis.dot(&vector))
    }
}

/// The side of the patient that a direction points to most.
fn letter(direction: WorldVector) -> char {
    const SIDES: [[char; 2]; 3] = [['R', 'L'], ['A', 'P'], ['S', 'I']];
    let [front, back] = SIDES[direction.iamax()];
    if direction[direction.iamax()] > 0.0 { front } else { back }
}

/// An axis or its opposite: that whose largest coordinate is positive. Of equal ones the first counts.
fn towards_positive(axis: WorldVector) -> WorldVector {
    let mut largest = 0.0_f64;
    for &coordinate in axis.iter() {
        // A hair more than equal: rounding must not choose.
        if coordinate.abs() > largest.abs() * (1.0 + 1e-6) {
            largest = coordinate;
        }
    }
    if largest < 0.0 { -axis } else { axis }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_near(found: [f64; 3], wanted: [f64; 3]) -> bool {
        found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-9)
    }

    #[test]
    fn a_plate_is_seen_onto_its_face_wherever_it_is_numbered_from() {
        let mut plate = Vec::new();
        for i in 0..10 {
            for j in 0..4 {
                plate.push(WorldPoint::new(f64::from(j), f64::from(i) * 2.0, 5.0));
            }
        }
        let view = View::face_on(&plate);
        assert!(is_near(view.project(WorldPoint::new(1.0, 2.0, 3.0)), [2.0, 1.0, -3.0]));
        plate.reverse();
        plate.push(WorldPoint::new(f64::NAN, 0.0, 0.0));
        let again = View::face_on(&plate);
        assert!(is_near(again.project(WorldPoint::new(1.0, 2.0, 3.0)), [2.0, 1.0, -3.0]));
    }

    #[test]
    fn views_turn_as_they_say() {
        let view = View::new(WorldVector::z(), WorldVector::y()).expect("two directions");
        let point = WorldPoint::new(1.0, 2.0, 3.0);
        assert!(is_near(view.project(point), [1.0, 2.0, 3.0]));
        assert!(is_near(view.turned_over().project(point), [1.0, -2.0, -3.0]));
        assert!(is_near(view.spun(90.0).project(point), [-2.0, 1.0, 3.0]));
        assert!(is_near(view.tilted(90.0).project(point), [1.0, 3.0, -2.0]));
        assert_eq!(View::new(WorldVector::z(), -WorldVector::z()), None);
    }

    #[test]
    fn the_patient_is_seen_as_on_slices() {
        let letters = [View::from_front(), View::from_left(), View::from_feet()].map(|view| view.letters());
        assert_eq!(letters, [['R', 'L', 'S', 'I'], ['A', 'P', 'S', 'I'], ['R', 'L', 'A', 'P']]);
        for view in [View::from_front(), View::from_left(), View::from_feet()] {
            assert_eq!(View::new(view.toward, view.up), Some(view), "it is no mirror");
        }
    }

    #[test]
    fn no_points_and_one_are_seen_too() {
        for points in [vec![], vec![WorldPoint::new(1.0, 1.0, 1.0)]] {
            assert!(View::face_on(&points).project(WorldPoint::origin()).iter().all(|x| x.is_finite()));
        }
    }
}
