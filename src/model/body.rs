//! What a figure encloses, whatever its kind: for measures that look at all figures alike.

use super::closed::closed;
use super::figure::Figure;
use super::meshes::TriangleMesh;
use super::patches::Patches;
use super::shell::Shell;
use super::tube::TubeShell;
use super::tube_patches::TubePatches;
use crate::cancel::{Cancel, Cancelled, Never};

/// The nodes of a figure as what they enclose.
#[derive(Clone, Copy, Debug)]
pub enum Body<'a> {
    /// Cells and wedges of a sheet.
    Sheet(Shell<'a>),
    /// Wedges of a tube.
    Tube(TubeShell<'a>),
}

impl Figure {
    /// What it encloses.
    #[must_use]
    pub fn body(&self) -> Body<'_> {
        match self {
            Self::Sheet(sheet) => Body::Sheet(sheet.into()),
            Self::Tube(tube) => Body::Tube(tube.into()),
        }
    }
}

impl Body<'_> {
    /// The closed surface of the smooth surfaces through its nodes; `None` without one.
    #[must_use]
    pub fn smooth_closed(self) -> Option<TriangleMesh> {
        let (patches, _) = FigurePatches::of(self, &Never).ok()?;
        patches.body().closed()
    }

    /// Its closed surface; `None` without one.
    #[must_use]
    pub fn closed(&self) -> Option<TriangleMesh> {
        match self {
            Self::Sheet(shell) => closed(*shell),
            Self::Tube(shell) => shell.closed(),
        }
    }
}

/// The smooth surfaces through the nodes of a figure.
#[derive(Clone, Debug)]
pub enum FigurePatches {
    /// Of a sheet.
    Sheet(Patches),
    /// Of a tube.
    Tube(TubePatches),
}

impl FigurePatches {
    /// Those of a figure, and how many pairs of triangles of their closed surface run through each other; `None` without a
    /// closed surface.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(body: Body<'_>, cancel: &dyn Cancel) -> Result<(Self, Option<usize>), Cancelled> {
        Ok(match body {
            Body::Sheet(shell) => {
                let (patches, crossings) = Patches::of(shell, cancel)?;
                (Self::Sheet(patches), crossings)
            }
            Body::Tube(shell) => {
                let (patches, crossings) = TubePatches::of(shell, cancel)?;
                (Self::Tube(patches), crossings)
            }
        })
    }

    /// The same where it does not matter whether they run through each other.
    #[must_use]
    pub fn unchecked(body: Body<'_>) -> Self {
        match body {
            Body::Sheet(shell) => Self::Sheet(Patches::unchecked(shell)),
            Body::Tube(shell) => Self::Tube(TubePatches::unchecked(shell)),
        }
    }

    /// What they enclose.
    #[must_use]
    pub fn body(&self) -> Body<'_> {
        match self {
            Self::Sheet(patches) => Body::Sheet(patches.into()),
            Self::Tube(patches) => Body::Tube(patches.into()),
        }
    }
}
