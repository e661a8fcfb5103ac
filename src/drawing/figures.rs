//! What is to be seen of a model: its figures as faces, lines and dots.

use super::colors::{Rgb, category};
use super::legend::Range;
use super::scene::{Mark, Scene};
use crate::model::{Figure, LatticeSize, Sheet, Shell, Side, Structure, Tube, TubeShell};
use crate::space::WorldPoint;

/// Colours of the vectors to the upper and to the lower side.
pub const VECTOR_COLORS: [Rgb; 2] = [[0, 114, 178], [213, 94, 0]];
/// Colour of the vectors to the wall of a tube, and of its centreline.
pub const WALL_COLOR: Rgb = [0, 114, 178];

/// Edges of quads.
const EDGE: Rgb = [74, 74, 80];
/// Pieces of a vector: a whole one is in no right order to the quads that it runs through.
const VECTOR_PIECES: u32 = 3;
/// Vectors drawn to a side. More run together in a picture as wide as a hand; of a finer lattice every second, third …
/// row and column is drawn.
const MOST_VECTORS: usize = 170;
/// Thickness of vectors, pixels.
const VECTOR_PX: f64 = 1.4;
/// Opacity of a sheet that vectors are to be seen through.
const CLEAR: f64 = 0.72;
/// Opacity of a wall that the centreline is to be seen through.
const GLASS: f64 = 0.35;

/// How faces are coloured.
#[derive(Clone, Copy, Debug)]
pub enum Paint {
    /// In one colour.
    Plain(Rgb),
    /// By the thickness at their corners: upper and lower vector, or a wall's vector and the one opposite.
    Thickness(Range),
}

impl Scene {
    /// All figures of a structure: sheets coloured by thickness with their vectors, tubes as a wall that their
    /// centreline is seen through.
    pub fn add_structure(&mut self, structure: &Structure, range: Range) {
        for figure in &structure.figures {
            match figure {
                Figure::Sheet(sheet) => {
                    self.add_sheet(sheet, Paint::Thickness(range), CLEAR);
                    Side::BOTH.into_iter().for_each(|side| self.add_vectors(sheet, side));
                }
                Figure::Tube(tube) => {
                    self.add_wall(tube, Paint::Thickness(range), GLASS);
                    self.add_centreline(tube);
                }
            }
        }
    }

    /// The quads of a medial sheet.
    pub fn add_sheet(&mut self, sheet: &Sheet, paint: Paint, opacity: f64) {
        self.add_quads(&sheet.medial, &sheet_quads(sheet), &sheet.total_mm(), (paint, opacity));
    }

    /// The quads of a side.
    pub fn add_side(&mut self, sheet: &Sheet, side: Side, paint: Paint, opacity: f64) {
        self.add_quads(sheet.side(side), &sheet_quads(sheet), &sheet.total_mm(), (paint, opacity));
    }

    /// The thickness vectors to a side; of a fine lattice those of [`vector_step`](Self::vector_step) rows and columns.
    pub fn add_vectors(&mut self, sheet: &Sheet, side: Side) {
        let color = VECTOR_COLORS[usize::from(side == Side::Lower)];
        let drawable = sheet.drawable();
        for node in thinned(sheet.grid) {
            if drawable[node] {
                let ends = [sheet.medial[node], sheet.side(side)[node]];
                self.add_line(ends, VECTOR_PIECES, color, VECTOR_PX);
            }
        }
    }

    /// Of how many rows and columns one is drawn with its vectors.
    #[must_use]
    pub fn vector_step(grid: LatticeSize) -> usize {
        let mut step = 1;
        while grid.rows.div_ceil(step) * grid.cols.div_ceil(step) > MOST_VECTORS {
            step += 1;
        }
        step
    }

    /// The quads of a tube's wall and the triangles round its tips.
    pub fn add_wall(&mut self, tube: &Tube, paint: Paint, opacity: f64) {
        let shell = TubeShell::from(tube);
        let totals = tube.total_mm();
        self.add_quads(&tube.wall, &shell.quads(), &totals, (paint, opacity));
        let LatticeSize { rows, cols } = tube.grid;
        for (tip, col) in shell.fans() {
            for row in 0..rows {
                let nodes = [row, (row + 1) % rows].map(|row| row * cols + col);
                let color = color_of(paint, nodes.map(|node| totals[node]));
                let corners = vec![tip, tube.wall[nodes[0]], tube.wall[nodes[1]]];
                self.add(Mark::Face { corners, edge: Some(EDGE) }, color, opacity);
            }
        }
    }

    /// The centreline of a tube from tip to tip.
    pub fn add_centreline(&mut self, tube: &Tube) {
        let mut line = vec![tube.tips[0]];
        line.extend(&tube.centreline);
        line.push(tube.tips[1]);
        for ends in line.windows(2).filter(|ends| ends[0] != ends[1]) {
            self.add_line([ends[0], ends[1]], 1, WALL_COLOR, 2.0 * VECTOR_PX);
        }
    }

    /// The vectors from the centreline of a tube to its wall; of a fine lattice those of
    /// [`vector_step`](Self::vector_step) rows and columns.
    pub fn add_wall_vectors(&mut self, tube: &Tube) {
        for node in thinned(tube.grid) {
            let ends = [tube.centreline[node % tube.grid.cols], tube.wall[node]];
            self.add_line(ends, VECTOR_PIECES, WALL_COLOR, VECTOR_PX);
        }
    }

    /// The voxel points of the medial sheets of a structure, each sheet in a colour of its own.
    pub fn add_sheet_points(&mut self, structure: &Structure, radius_px: f64) {
        for (number, sheet) in structure.sheets().enumerate() {
            for &at in &sheet.points.medial.positions {
                self.add(Mark::Dot { at, radius_px }, category(number), 1.0);
            }
        }
    }

    /// Quads `[(i, j), (i, j+1), (i+1, j), (i+1, j+1)]` of nodes with a value each, painted by it.
    fn add_quads(
        &mut self,
        nodes: &[WorldPoint],
        quads: &[[usize; 4]],
        values: &[f64],
        (paint, opacity): (Paint, f64),
    ) {
        for &[a, b, c, d] in quads {
            let color = color_of(paint, [a, b, c, d].map(|node| values[node]));
            let corners = [a, b, d, c].map(|node| nodes[node]).to_vec();
            self.add(Mark::Face { corners, edge: Some(EDGE) }, color, opacity);
        }
    }
}

/// The quads of a sheet whose nodes can all be drawn.
fn sheet_quads(sheet: &Sheet) -> Vec<[usize; 4]> {
    let drawable = sheet.drawable();
    let shell = Shell { valid: &drawable, ..sheet.into() };
    shell.quads().map(|quad| quad.nodes).collect()
}

/// Nodes of every so manieth row and column, as far from one edge as from the other.
fn thinned(grid: LatticeSize) -> Vec<usize> {
    let step = Scene::vector_step(grid);
    let first = |count: usize| (count.saturating_sub(1) % step) / 2;
    let mut nodes = Vec::new();
    for row in (first(grid.rows)..grid.rows).step_by(step) {
        for col in (first(grid.cols)..grid.cols).step_by(step) {
            nodes.push(row * grid.cols + col);
        }
    }
    nodes
}

/// The colour of a face with these values at its corners.
fn color_of<const CORNERS: usize>(paint: Paint, values: [f64; CORNERS]) -> Rgb {
    match paint {
        Paint::Plain(color) => color,
        Paint::Thickness(range) => {
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            super::colors::viridis(range.share(mean))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawing::colors::viridis;

    fn slab(rows: usize, cols: usize) -> Sheet {
        let at = |z: f64| (0..rows * cols).map(|n| WorldPoint::new((n % cols) as f64, (n / cols) as f64, z)).collect();
        Sheet {
            grid: LatticeSize { rows, cols },
            medial: at(0.0),
            upper: at(2.0),
            lower: at(-1.0),
            valid: vec![true; rows * cols],
            ..Sheet::default()
        }
    }

    #[test]
    fn a_sheet_is_its_quads_and_a_node_that_is_off_it_takes_its_own_along() {
        let range = Range { low_mm: 2.0, high_mm: 4.0, is_exceeded: [false; 2] };
        let mut sheet = slab(3, 4);
        let mut scene = Scene::default();
        scene.add_sheet(&sheet, Paint::Thickness(range), 1.0);
        assert_eq!(scene.items.len(), 6);
        assert!(scene.items.iter().all(|item| item.color == viridis(0.5)), "3 mm is the middle of 2 to 4");
        sheet.valid[0] = false;
        let mut scene = Scene::default();
        scene.add_side(&sheet, Side::Upper, Paint::Plain([1, 2, 3]), 1.0);
        scene.add_vectors(&sheet, Side::Lower);
        let faces = scene.items.iter().filter(|item| matches!(item.mark, Mark::Face { .. })).count();
        assert_eq!((faces, scene.items.len() - faces), (5, 11 * VECTOR_PIECES as usize));
    }

    #[test]
    fn of_a_fine_lattice_some_vectors_are_drawn() {
        let grid = LatticeSize { rows: 30, cols: 41 };
        assert_eq!(Scene::vector_step(LatticeSize { rows: 6, cols: 8 }), 1);
        assert_eq!(Scene::vector_step(grid), 3);
        let nodes = thinned(grid);
        assert!(nodes.len() <= MOST_VECTORS);
        assert_eq!((nodes.first(), nodes.last()), (Some(&41), Some(&(28 * 41 + 39))));
    }

    #[test]
    fn a_tube_is_its_wall_with_fans_and_its_centreline() {
        let (rows, cols) = (6, 4);
        let mut wall = Vec::new();
        for row in 0..rows {
            let (sin, cos) = (row as f64 / rows as f64 * std::f64::consts::TAU).sin_cos();
            wall.extend((0..cols).map(|col| WorldPoint::new(cos, sin, col as f64)));
        }
        let tube = Tube {
            grid: LatticeSize { rows, cols },
            centreline: (0..cols).map(|col| WorldPoint::new(0.0, 0.0, col as f64)).collect(),
            wall,
            tips: [WorldPoint::new(0.0, 0.0, -1.0), WorldPoint::new(0.0, 0.0, 4.0)],
            ..Tube::default()
        };
        let structure_range = Range::round(tube.total_mm());
        let mut scene = Scene::default();
        scene.add_wall(&tube, Paint::Thickness(structure_range), 0.5);
        assert_eq!(scene.items.len(), rows * (cols - 1) + 2 * rows);
        scene.add_centreline(&tube);
        assert_eq!(scene.items.len(), rows * (cols - 1) + 2 * rows + cols + 1);
        scene.add_wall_vectors(&tube);
        assert_eq!(scene.items.len(), rows * (cols - 1) + 2 * rows + cols + 1 + rows * cols * VECTOR_PIECES as usize);
    }
}
