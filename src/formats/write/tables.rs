//! Model → `thickness.csv` and `points.csv`. Numbers as in thickness.json; what is no finite
//! number is an empty cell.

use std::fmt;
use std::io::{self, Write};

use super::rounded::round;
use crate::model::{Figure, Model, Sheet, Side, Tube};

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
            let prefix = format!("{s},{},{f}", structure.label);
            match figure {
                Figure::Sheet(sheet) => write_nodes(&mut out, &prefix, sheet, has_spread)?,
                Figure::Tube(tube) => write_wall(&mut out, &prefix, tube, has_spread)?,
            }
        }
    }
    Ok(())
}

fn write_nodes(out: &mut impl Write, prefix: &str, sheet: &Sheet, has_spread: bool) -> io::Result<()> {
    for side in Side::BOTH {
        let vectors = sheet.vectors(side);
        for (node, at) in sheet.medial.iter().enumerate() {
            let (i, j) = (node / sheet.grid.cols, node % sheet.grid.cols);
            let (vector, valid, name) = (vectors[node], sheet.valid[node], side.name());
            let cells = Cells([at.x, at.y, at.z, vector.x, vector.y, vector.z, vector.norm()]);
            write!(out, "{prefix},{i},{j},{name},{cells},{valid}")?;
            if has_spread {
                write!(out, ",{}", Cells([deviation_mm(sheet, side, node).unwrap_or(f64::NAN)]))?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

/// The rows of a tube, whose one side is `wall`.
fn write_wall(out: &mut impl Write, prefix: &str, tube: &Tube, has_spread: bool) -> io::Result<()> {
    let (medial, vectors) = (tube.medial(), tube.vectors());
    for (node, (at, vector)) in medial.iter().zip(vectors).enumerate() {
        let (i, j) = (node / tube.grid.cols, node % tube.grid.cols);
        let cells = Cells([at.x, at.y, at.z, vector.x, vector.y, vector.z, vector.norm()]);
        write!(out, "{prefix},{i},{j},wall,{cells},true")?;
        if has_spread {
            let spread = tube.uncertainty.as_ref().and_then(|found| found.wall_mm[node]);
            write!(out, ",{}", Cells([spread.unwrap_or(f64::NAN)]))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Standard deviation of the thickness at a node.
fn deviation_mm(sheet: &Sheet, side: Side, node: usize) -> Option<f64> {
    let found = sheet.uncertainty.as_ref()?;
    match side {
        Side::Upper => found.upper_mm[node],
        Side::Lower => found.lower_mm[node],
    }
}

/// One row per voxel point of every surface, with where it was laid flat.
///
/// # Errors
/// When writing fails.
pub fn write_points(model: &Model, mut out: impl Write) -> io::Result<()> {
    writeln!(out, "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm")?;
    for (s, structure) in model.structures.iter().enumerate() {
        for (f, figure) in structure.figures.iter().enumerate() {
            match figure {
                Figure::Sheet(sheet) => write_surfaces(&mut out, &format!("{s},{f}"), sheet)?,
                Figure::Tube(tube) => write_wall_points(&mut out, &format!("{s},{f}"), tube)?,
            }
        }
    }
    Ok(())
}

fn write_surfaces(out: &mut impl Write, prefix: &str, sheet: &Sheet) -> io::Result<()> {
    for (surface, points) in sheet.points.named() {
        for (at, flat) in points.positions.iter().zip(&points.flat) {
            let cells = Cells([at.x, at.y, at.z, flat.x, flat.y]);
            writeln!(out, "{prefix},{surface},{cells}")?;
        }
    }
    Ok(())
}

/// The wall nodes of a tube, rolled out.
fn write_wall_points(out: &mut impl Write, prefix: &str, tube: &Tube) -> io::Result<()> {
    for (at, flat) in tube.wall.iter().zip(&tube.intrinsic) {
        writeln!(out, "{prefix},wall,{}", Cells([at.x, at.y, at.z, flat.x, flat.y]))?;
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
