//! Model → `thickness.csv` and `points.csv`. Numbers as in thickness.json; what is no finite
//! number is an empty cell.

use std::fmt;
use std::io::{self, Write};

use super::rounded::round;
use crate::model::{Figure, Model};

/// One row per node and side: where it is, its vector, its thickness; and the standard deviation of
/// the thickness when it was asked for.
///
/// # Errors
/// When writing fails.
pub fn write_thickness(model: &Model, mut out: impl Write) -> io::Result<()> {
    let has_spread = model.params.uncertainty > 0;
    let spread = if has_spread { ",sd_mm" } else { "" };
    writeln!(out, "structure,label,figure,i,j,side,x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,thickness_mm,valid{spread}")?;
    for (s, structure) in model.structures.iter().enumerate() {
        for (f, figure) in structure.figures.iter().enumerate() {
            write_nodes(&mut out, &format!("{s},{},{f}", structure.label), figure, has_spread)?;
        }
    }
    Ok(())
}

fn write_nodes(out: &mut impl Write, prefix: &str, figure: &Figure, has_spread: bool) -> io::Result<()> {
    for (side, vectors) in [("upper", figure.upper_vectors()), ("lower", figure.lower_vectors())] {
        for (node, ((at, vector), valid)) in figure.medial.iter().zip(&vectors).zip(&figure.valid).enumerate() {
            let (i, j) = (node / figure.grid.cols, node % figure.grid.cols);
            let cells = Cells([at.x, at.y, at.z, vector.x, vector.y, vector.z, vector.norm()]);
            write!(out, "{prefix},{i},{j},{side},{cells},{valid}")?;
            if has_spread {
                let spread =
                    figure.uncertainty.as_ref().map(|u| if side == "upper" { &u.upper_mm } else { &u.lower_mm });
                write!(out, ",{}", Cells([spread.map_or(f64::NAN, |sd| sd[node])]))?;
            }
            writeln!(out)?;
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
