//! Model → `thickness.csv` and `points.csv`. Numbers as in thickness.json; what is no finite
//! number is an empty cell.

use std::fmt;
use std::io::{self, Write};

use super::rounded::round;
use crate::pipeline::model::{Figure, Model};

/// One row per node and side: where it is, its vector, its thickness.
///
/// # Errors
/// When writing fails.
pub fn write_thickness(model: &Model, mut out: impl Write) -> io::Result<()> {
    writeln!(out, "structure,label,figure,i,j,side,x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,thickness_mm,valid")?;
    for (s, structure) in model.structures.iter().enumerate() {
        for (f, figure) in structure.figures.iter().enumerate() {
            write_nodes(&mut out, &format!("{s},{},{f}", structure.label), figure)?;
        }
    }
    Ok(())
}

fn write_nodes(out: &mut impl Write, prefix: &str, figure: &Figure) -> io::Result<()> {
    for (side, vectors) in [("upper", figure.upper_vectors()), ("lower", figure.lower_vectors())] {
        for (node, ((at, vector), valid)) in figure.medial.iter().zip(&vectors).zip(&figure.valid).enumerate() {
            let (i, j) = (node / figure.grid.cols, node % figure.grid.cols);
            let cells = Cells([at.x, at.y, at.z, vector.x, vector.y, vector.z, vector.norm()]);
            writeln!(out, "{prefix},{i},{j},{side},{cells},{valid}")?;
        }
    }
    Ok(())
}

/// One row per voxel point of every surface, with where ISOMAP put it.
///
/// # Errors
/// When writing fails.
pub fn write_points(model: &Model, mut out: impl Write) -> io::Result<()> {
    writeln!(out, "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm")?;
    for (s, structure) in model.structures.iter().enumerate() {
        for (f, figure) in structure.figures.iter().enumerate() {
            for (surface, points) in figure.points.named() {
                for (at, flat) in points.positions.iter().zip(&points.flat) {
                    let cells = Cells([at.x, at.y, at.z, flat.x, flat.y]);
                    writeln!(out, "{s},{f},{surface},{cells}")?;
                }
            }
        }
    }
    Ok(())
}

struct Cells<const N: usize>([f64; N]);

impl<const N: usize> fmt::Display for Cells<N> {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        for (n, value) in self.0.iter().enumerate() {
            let comma = if n == 0 { "" } else { "," };
            match round(*value) {
                finite if finite.is_finite() => write!(formatter, "{comma}{finite}")?,
                _ => formatter.write_str(comma)?,
            }
        }
        Ok(())
    }
}
