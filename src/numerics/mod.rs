//! Algorithms that know no anatomy: fields on grids, digital topology, graphs, fits.
//! Lengths are in voxels of an isotropic grid unless a name says otherwise.

pub(crate) mod parallel;

pub mod field;

pub(crate) mod smooth;

pub(crate) mod distance;

pub(crate) mod components;

pub mod topology;

pub(crate) mod flood;

pub(crate) mod graph;

pub(crate) mod spanning;

pub(crate) mod eigen;

pub(crate) mod sparse;

pub(crate) mod balls;

pub(crate) mod points;

pub(crate) mod cells;

pub(crate) mod raster;

pub(crate) mod contour;

pub(crate) mod fit;

pub(crate) mod moments;

pub(crate) mod polyline;

pub(crate) mod stats;

pub(crate) mod surface_nets;

pub mod triangles;
