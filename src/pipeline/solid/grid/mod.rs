//! The grid that a part of a label is worked on, and the part on it.
//!
//! 1. The mask's own grain is found, and blocks of repeated voxels are read back to one ([`grain`]).
//! 2. The working grid is isotropic ([`working_grid`]), and finer where the part is thin ([`thinness`]).
//! 3. Between slices the level of the boundary is that of least bending ([`bending`]); from it the working grid is filled
//!    ([`resample`]).

pub(super) mod bending;

pub(super) mod grain;

pub(super) mod resample;

pub(super) mod thinness;

pub(super) mod working_grid;
