//! The artifacts of a result: one entry each. A further output is one more entry here, its writer in [`super::write`],
//! and its name in [`ARTIFACT_NAMES`](crate::params::ARTIFACT_NAMES), so that parameters can ask for it: they know no
//! format.

use std::io::{self, Write};

use super::write::record::Record;
use super::write::{dicom, glb, picture, stl, tables, thickness};

/// A file that is made of a result.
pub struct Artifact {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Whether it is made unless others are asked for (parameter `outputs`).
    pub is_default: bool,
    /// Whether it says how long the others took: then it is written after them.
    pub tells_time: bool,
    /// Writes it.
    pub write: fn(&Record, &mut dyn Write) -> io::Result<()>,
}

impl Artifact {
    /// Whether it is a DICOM object, made for an archive.
    #[must_use]
    pub fn is_dicom(&self) -> bool {
        self.media_type == "application/dicom"
    }
}

/// All of them, in the order of the contract.
pub const ARTIFACTS: [Artifact; 11] = [
    Artifact {
        name: "model.glb",
        media_type: "model/gltf-binary",
        is_default: true,
        tells_time: false,
        write: |record, out| glb::write(&record.model, out),
    },
    Artifact {
        name: "thickness.json",
        media_type: "application/json",
        is_default: true,
        tells_time: true,
        write: |record, out| thickness::write(&record.model, &record.input, &record.warnings, record.timings, out),
    },
    Artifact {
        name: "thickness.csv",
        media_type: "text/csv",
        is_default: true,
        tells_time: false,
        write: |record, out| tables::write_thickness(&record.model, out),
    },
    Artifact {
        name: "points.csv",
        media_type: "text/csv",
        is_default: true,
        tells_time: false,
        write: |record, out| tables::write_points(&record.model, out),
    },
    Artifact {
        name: "picture.png",
        media_type: "image/png",
        is_default: false,
        tells_time: false,
        write: picture::write_png,
    },
    Artifact {
        name: "report.pdf",
        media_type: "application/pdf",
        is_default: false,
        tells_time: false,
        write: picture::write_pdf,
    },
    Artifact {
        name: "surfaces.stl",
        media_type: "model/stl",
        is_default: false,
        tells_time: false,
        write: |record, out| stl::write(&record.model, out),
    },
    Artifact {
        name: "picture.dcm",
        media_type: "application/dicom",
        is_default: false,
        tells_time: false,
        write: dicom::write_picture,
    },
    Artifact {
        name: "report.pdf.dcm",
        media_type: "application/dicom",
        is_default: false,
        tells_time: false,
        write: dicom::write_pdf,
    },
    Artifact {
        name: "surfaces.stl.dcm",
        media_type: "application/dicom",
        is_default: false,
        tells_time: false,
        write: dicom::write_stl,
    },
    Artifact {
        name: "report.sr.dcm",
        media_type: "application/dicom",
        is_default: false,
        tells_time: false,
        write: dicom::write_report,
    },
];

/// The artifact of a name.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static Artifact> {
    const ALL: &[Artifact] = &ARTIFACTS;
    ALL.iter().find(|artifact| artifact.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::{ARTIFACT_NAMES, Params};

    #[test]
    fn the_parameter_that_asks_for_artifacts_knows_all_of_them() {
        assert_eq!(ARTIFACTS.map(|artifact| artifact.name), ARTIFACT_NAMES);
        let default: Vec<_> = ARTIFACTS.iter().filter(|artifact| artifact.is_default).map(|own| own.name).collect();
        assert_eq!(Params::default().outputs, default);
    }
}
