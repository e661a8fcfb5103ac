//! Algorithms that know no anatomy: fields on grids, digital topology, graphs, fits.
//! Lengths are in voxels of an isotropic grid unless a name says otherwise.

pub mod parallel;

pub mod field;

pub mod smooth;

pub mod distance;

pub mod components;

pub mod topology;

pub mod flood;

pub mod graph;

pub mod spanning;

pub mod eigen;

pub mod sparse;

pub mod balls;

pub mod points;

pub mod cells;

pub mod raster;

pub mod contour;

pub mod fit;

pub mod moments;

pub mod polyline;

pub mod stats;

pub mod surface_nets;

pub mod triangles;
