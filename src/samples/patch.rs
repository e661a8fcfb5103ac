//! A sheet with a thickness: points and radii over a rectangle of parameters. Its solid is the
//! union of the balls.

use crate::space::WorldPoint;

/// Distance between neighbouring sampled ball centres, mm. At 0.3 the skin of a ball of 3 mm
/// is scalloped by 0.004 mm; larger shows in tests of sub-voxel accuracy, smaller costs time.
const STEP_MM: f64 = 0.3;
/// Samples along one parameter, whatever its length.
const MAX_SAMPLES: usize = 2000;
/// Gauss–Newton steps from the nearest sample to the nearest point of the sheet.
const REFINEMENTS: usize = 6;

type Position = Box<dyn Fn(f64, f64) -> WorldPoint + Send + Sync>;
type Radius = Box<dyn Fn(f64, f64) -> f64 + Send + Sync>;

/// A piece of sheet over `[0, 1]²`, with the radius of its largest ball everywhere.
pub struct Patch {
    position: Position,
    radius_mm: Radius,
}

/// A ball of a sampled patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ball {
    /// Its centre, on the sheet.
    pub center: WorldPoint,
    /// Its radius.
    pub radius_mm: f64,
    /// The parameters of the centre.
    pub at: [f64; 2],
}

impl Patch {
    /// From the position and the radius as functions of `(s, t)` in `[0, 1]²`.
    pub fn new(
        position: impl Fn(f64, f64) -> WorldPoint + Send + Sync + 'static,
        radius_mm: impl Fn(f64, f64) -> f64 + Send + Sync + 'static,
    ) -> Self {
        Self { position: Box::new(position), radius_mm: Box::new(radius_mm) }
    }

    /// Radius of the largest ball centred at a point of the sheet.
    #[must_use]
    pub fn radius_mm(&self, [s, t]: [f64; 2]) -> f64 {
        (self.radius_mm)(s, t)
    }

    /// A point of the sheet.
    #[must_use]
    pub fn position(&self, [s, t]: [f64; 2]) -> WorldPoint {
        (self.position)(s, t)
    }

    /// Balls no further apart than `STEP_MM` along either parameter.
    #[must_use]
    pub(crate) fn balls(&self) -> Vec<Ball> {
        let across = self.samples(|a, b| [a, b]);
        let along = self.samples(|a, b| [b, a]);
        let mut balls = Vec::with_capacity(across * along);
        for s in shares(across) {
            for t in shares(along) {
                let at = [s, t];
                balls.push(Ball { center: self.position(at), radius_mm: self.radius_mm(at), at });
            }
        }
        balls
    }

    /// Samples for the first argument of `at`, from the longest chord seen on a coarse raster.
    fn samples(&self, at: impl Fn(f64, f64) -> [f64; 2]) -> usize {
        const COARSE: usize = 33;
        let mut longest = 0.0_f64;
        for b in shares(COARSE) {
            let line: Vec<WorldPoint> = shares(COARSE).map(|a| self.position(at(a, b))).collect();
            for pair in line.windows(2) {
                longest = longest.max((pair[1] - pair[0]).norm());
            }
        }
        let steps_per_chord = (1..MAX_SAMPLES / COARSE).find(|n| longest <= STEP_MM * as_f64(*n));
        if longest == 0.0 { 1 } else { (COARSE - 1) * steps_per_chord.unwrap_or(MAX_SAMPLES / COARSE) + 1 }
    }

    /// The parameters of the sheet point nearest to `point`, from a start near it: Gauss–Newton
    /// with the parameters kept inside the patch.
    #[must_use]
    pub fn nearest(&self, point: WorldPoint, start: [f64; 2]) -> [f64; 2] {
        const STEP: f64 = 1e-5;
        let mut at = start;
        let mut best = (point - self.position(at)).norm();
        for _ in 0..REFINEMENTS {
            let here = self.position(at);
            let gradient = [0, 1].map(|axis| {
                let mut beside = at;
                let step = if at[axis] + STEP <= 1.0 { STEP } else { -STEP };
                beside[axis] += step;
                (self.position(beside) - here) / step
            });
            let gap = point - here;
            let next = [0, 1].map(|axis| at[axis] + newton_step(&gradient, &gap, axis)).map(|x| x.clamp(0.0, 1.0));
            let distance = (point - self.position(next)).norm();
            if distance >= best {
                break;
            }
            (at, best) = (next, distance);
        }
        at
    }
}

/// One coordinate of the solution of `(JᵀJ) x = Jᵀ gap`; where the columns of J are parallel
/// or zero (a pole, a line), the step along this column alone.
fn newton_step(j: &[nalgebra::Vector3<f64>; 2], gap: &nalgebra::Vector3<f64>, axis: usize) -> f64 {
    let (a, b) = (&j[axis], &j[1 - axis]);
    let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(b));
    let determinant = aa * bb - ab * ab;
    if determinant > 1e-9 * aa * bb {
        return (a.dot(gap) * bb - b.dot(gap) * ab) / determinant;
    }
    if aa > 0.0 { a.dot(gap) / aa } else { 0.0 }
}

/// `count` numbers from 0 to 1, both ends included; 0.5 for a single one.
fn shares(count: usize) -> impl Iterator<Item = f64> {
    (0..count).map(move |n| if count == 1 { 0.5 } else { as_f64(n) / as_f64(count - 1) })
}

fn as_f64(n: usize) -> f64 {
    n as f64
}
