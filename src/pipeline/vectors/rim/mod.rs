//! The rim of a figure: the vectors that close what the three meshes of the paper leave open.
//!
//! 1. Each node of the edge gets a crest point (`crest`), turned until no wedge is turned over (`mend_crest`).
//! 2. An arc leads round the rim from its upper node over that point to its lower node (`arcs`).
//! 3. Where sheets meet, arcs keep to the share of their own ([`shares`]).

pub(super) mod arcs;

pub(super) mod crest;

pub(super) mod mend_crest;

pub mod shares;
