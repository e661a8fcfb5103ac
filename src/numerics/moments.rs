//! Where points lie and how they spread: their mean, their bounds, the principal axes of their second moments.

use nalgebra::{Matrix2, Matrix3, Point, Point2, Point3, SVector, SymmetricEigen, Vector2, Vector3};

/// The mean of points; the origin without points.
#[must_use]
pub fn mean<const D: usize>(points: &[Point<f64, D>]) -> SVector<f64, D> {
    let mut sum = SVector::zeros();
    for p in points {
        sum += p.coords;
    }
    sum / points.len().max(1) as f64
}

/// The smallest and the largest coordinates; without points the infinities, in the wrong order.
#[must_use]
pub fn bounds(points: &[Point2<f64>]) -> [Vector2<f64>; 2] {
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
    for p in points {
        low = low.inf(&p.coords);
        high = high.sup(&p.coords);
    }
    [low, high]
}

/// Principal axes of a form of the plane, the first that of its larger value.
#[derive(Clone, Copy, Debug)]
pub struct Axes2 {
    /// Unit directions.
    pub directions: [Vector2<f64>; 2],
    /// The form's values along them.
    pub values: [f64; 2],
}

impl Axes2 {
    /// Of a symmetric matrix.
    #[must_use]
    pub fn of(form: Matrix2<f64>) -> Self {
        let eigen = SymmetricEigen::new(form);
        let order = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { [0, 1] } else { [1, 0] };
        Self {
            directions: order.map(|k| eigen.eigenvectors.column(k).into_owned()),
            values: order.map(|k| eigen.eigenvalues[k]),
        }
    }
}

/// Principal axes of a form of space, by descending value.
#[derive(Clone, Copy, Debug)]
pub struct Axes3 {
    /// Unit directions.
    pub directions: [Vector3<f64>; 3],
    /// The form's values along them.
    pub values: [f64; 3],
}

impl Axes3 {
    /// The middle of points, and the axes of their mean second moments about it.
    #[must_use]
    pub fn of_points(points: &[Point3<f64>]) -> (Point3<f64>, Self) {
        let middle = mean(points);
        let mut moments = Matrix3::zeros();
        for point in points {
            let offset = point.coords - middle;
            moments += offset * offset.transpose() / points.len().max(1) as f64;
        }
        (Point3::from(middle), Self::of(moments))
    }

    /// Of a symmetric matrix.
    #[must_use]
    pub fn of(form: Matrix3<f64>) -> Self {
        let eigen = SymmetricEigen::new(form);
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        Self {
            directions: order.map(|k| eigen.eigenvectors.column(k).into_owned()),
            values: order.map(|k| eigen.eigenvalues[k]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_has_a_middle_and_bounds() {
        let points = [(1.0, 4.0), (3.0, -2.0)].map(|(x, y)| Point2::new(x, y));
        assert_eq!(mean(&points), Vector2::new(2.0, 1.0));
        assert_eq!(bounds(&points), [Vector2::new(1.0, -2.0), Vector2::new(3.0, 4.0)]);
        assert_eq!(mean::<3>(&[]), Vector3::zeros());
    }

    #[test]
    fn axes_come_by_descending_value() {
        let plane = Axes2::of(Matrix2::new(1.0, 0.0, 0.0, 4.0));
        assert_eq!(plane.values, [4.0, 1.0]);
        assert_eq!(plane.directions.map(|d| d.abs()), [Vector2::y(), Vector2::x()]);
        let space = Axes3::of(Matrix3::from_diagonal(&Vector3::new(2.0, 9.0, 5.0)));
        assert_eq!(space.values, [9.0, 5.0, 2.0]);
        assert_eq!(space.directions.map(|d| d.abs()), [Vector3::y(), Vector3::z(), Vector3::x()]);
    }
}
