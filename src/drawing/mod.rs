//! Pictures of results as SVG text: for documents, reports and whoever has no viewer in space.
//!
//! ```text
//!  Model ──► Scene ──► Drawn ──► SVG
//!     figures    flat      picture
//! ```
//!
//! 1. A [`Scene`] is filled with what is to be seen of figures: faces, lines and dots in the world (`figures`);
//! 2. a [`View`] lays it flat by parallel projection, shades faces by their normal and puts the far before the near
//!    (`flat`): the painter's algorithm, which sorts by the middle of each mark. Large faces that run through each other
//!    are in no right order for it, so long lines are cut in pieces and faces are as large as the quads of a lattice;
//! 3. a [`Picture`] sets panels in rows, all of one scale, with captions, a scale bar and the meaning of the colours
//!    (`picture`).
//!
//! Equal scenes give equal bytes: marks at one depth stay in their order, and numbers have one decimal.

pub mod colors;

mod view;

mod scene;

mod figures;

mod flat;

mod legend;

mod svg;

mod words;

mod entries;

mod picture;

pub use colors::Rgb;
pub use figures::{Paint, VECTOR_COLORS, WALL_COLOR};
pub use legend::{Key, Legend, Range};
pub use picture::{Panel, Picture};
pub use scene::{Item, Mark, Scene};
pub use view::View;
