//! Pictures of results: for documents, reports and whoever has no viewer in space. Drawings are SVG text, surfaces are
//! pixels.
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
//!
//! ```text
//!  Structures ──► Solid ──► Pixels ──► Page ──► Pixels, or a page of a document
//!             solid    picture             painted
//! ```
//!
//! A [`Solid`] is drawn with a depth buffer, since closed surfaces hide much of each other; a [`Page`] sets such pictures
//! beside words, bars and numbers, in a [`Typeface`] that the program brings along.

pub mod colors;

mod view;

pub mod typeface;

mod pixels;

mod scene;

mod figures;

mod flat;

mod legend;

mod svg;

mod words;

mod entries;

mod picture;

mod solid;

pub mod page;

pub use colors::{NO_THICKNESS, Rgb};
pub use figures::{Paint, VECTOR_COLORS, WALL_COLOR};
pub use legend::{Key, Legend, Range, round_step, told};
pub use page::{Element, Page};
pub use picture::{Panel, Picture};
pub use pixels::Pixels;
pub use scene::{Item, Mark, Scene};
pub use solid::{BARE, Frame, Solid};
pub use typeface::Typeface;
pub use view::View;
