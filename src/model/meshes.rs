//! Triangle meshes.

use crate::space::WorldPoint;

/// A triangle mesh in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corners, mm.
    pub positions: Vec<WorldPoint>,
    /// Corner indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}
