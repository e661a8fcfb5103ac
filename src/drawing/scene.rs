//! What is to be seen, in the world.

use super::colors::Rgb;
use crate::space::WorldPoint;

/// The form of a thing to be seen. What is not finite is left out of the picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A polygon of three or more corners, shaded by its normal.
    Face {
        /// Its corners in their order.
        corners: Vec<WorldPoint>,
        /// The colour of its edge; none for a face without.
        edge: Option<Rgb>,
    },
    /// A straight line.
    Line {
        /// Its ends.
        ends: [WorldPoint; 2],
        /// How thick it is in the picture, pixels.
        width_px: f64,
    },
    /// A dot, paler the farther it is from the eye.
    Dot {
        /// Its middle.
        at: WorldPoint,
        /// Its radius in the picture, pixels.
        radius_px: f64,
    },
}

/// A thing to be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Item {
    /// Its form.
    pub mark: Mark,
    /// Its colour.
    pub color: Rgb,
    /// From 0, not seen, to 1, hiding what is behind it.
    pub opacity: f64,
}

/// Things to be seen together. What is added later lies over what is equally far.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The things.
    pub items: Vec<Item>,
}

impl Scene {
    /// Adds a thing.
    pub fn add(&mut self, mark: Mark, color: Rgb, opacity: f64) {
        self.items.push(Item { mark, color, opacity });
    }

    /// Adds a line in as many pieces, each of which is as near as its own middle.
    pub fn add_line(&mut self, [from, to]: [WorldPoint; 2], pieces: u32, color: Rgb, width_px: f64) {
        let pieces = pieces.max(1);
        let at = |piece: u32| from + (to - from) * (f64::from(piece) / f64::from(pieces));
        for piece in 0..pieces {
            let ends = [at(piece), at(piece + 1)];
            self.add(Mark::Line { ends, width_px }, color, 1.0);
        }
    }
}
