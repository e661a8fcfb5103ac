//! Files within DICOM objects: the report as PDF, the surfaces as STL.

use std::io;

use super::dataset::{Code, Dataset, Text};
use super::instance::{Instance, Kind};
use super::measurements::{MM, REPORT};
use super::uid;
use crate::formats::dicom_origin::{
    DicomOrigin, FRAME_OF_REFERENCE_UID, SERIES_INSTANCE_UID, SOP_CLASS_UID, SOP_INSTANCE_UID, STUDY_INSTANCE_UID,
};
use crate::formats::write::record::Record;
use crate::formats::write::{picture, stl};

pub(super) const PDF: Kind = Kind {
    class: "1.2.840.10008.5.1.4.1.1.104.1",
    modality: "DOC",
    series: 9003,
    description: "medialrep report, not for diagnosis",
    artifact: "report.pdf.dcm",
};
pub(super) const STL: Kind = Kind {
    class: "1.2.840.10008.5.1.4.1.1.104.3",
    modality: "M3D",
    series: 9004,
    description: "medialrep surfaces, not for diagnosis",
    artifact: "surfaces.stl.dcm",
};

/// The report.
///
/// # Errors
/// When it has more bytes than the format can tell.
pub(super) fn pdf(record: &Record) -> io::Result<Instance> {
    let mut instance = Instance::new(record, PDF);
    let set = &mut instance.dataset;
    set.text((0x0008, 0x0064), Text::Cs, "WSD");
    set.text((0x0028, 0x0301), Text::Cs, "YES");
    set.text((0x0042, 0x0010), Text::St, picture::REPORT_TITLE);
    set.code((0x0040, 0xa043), REPORT);
    let mut bytes = Vec::new();
    picture::write_pdf(record, &mut bytes)?;
    add_file(set, &bytes, "application/pdf")?;
    Ok(instance)
}

/// The closed surfaces.
///
/// # Errors
/// When they have more bytes than the format can tell.
pub(super) fn stl(record: &Record) -> io::Result<Instance> {
    const MODEL: Code<'static> = Code("85040-4", "LN", "Segmented model");
    let mut instance = Instance::new(record, STL);
    let set = &mut instance.dataset;
    set.text((0x0028, 0x0301), Text::Cs, "NO");
    let surfaces = stl::surfaces(&record.model);
    set.text((0x0042, 0x0010), Text::St, &title(record, surfaces.len()));
    set.code((0x0040, 0xa043), MODEL);
    set.code((0x0040, 0x08ea), MM);
    let frame = record.dicom.as_ref().and_then(|origin| origin.uid(FRAME_OF_REFERENCE_UID));
    let own = uid::of_mask(record, "frame of reference");
    set.text(FRAME_OF_REFERENCE_UID, Text::Ui, frame.unwrap_or(&own));
    set.text((0x0020, 0x1040), Text::Lo, "");
    if let Some(origin) = &record.dicom {
        add_source(set, origin);
    }
    let mut bytes = Vec::new();
    stl::write_meshes(&surfaces, &mut bytes)?;
    add_file(set, &bytes, "model/stl")?;
    Ok(instance)
}

/// What so many surfaces are: who looks at them alone must see that some are missing.
fn title(record: &Record, surfaces: usize) -> String {
    let figures = record.model.structures.iter().map(|structure| structure.figures.len()).sum::<usize>();
    if surfaces == figures {
        return "Closed surfaces of all figures, not for diagnosis".to_owned();
    }
    format!("Closed surfaces of {surfaces} of {figures} figures (sheets with holes have none), not for diagnosis")
}

/// The object that the surfaces were made from, and where it is filed: an object may name no other whose study and series
/// it does not tell (Common Instance Reference, PS3.3 section C.12.2).
fn add_source(set: &mut Dataset, origin: &DicomOrigin) {
    let (Some(source), Some(series)) = (reference(origin), series_of_source(origin)) else { return };
    set.items((0x0042, 0x0013), vec![source]);
    set.items((0x0008, 0x1115), vec![series]);
}

/// Its series, which is in the same study as the surfaces; `None` where the source tells no study, series or object.
fn series_of_source(origin: &DicomOrigin) -> Option<Dataset> {
    origin.uid(STUDY_INSTANCE_UID)?;
    let mut series = Dataset::default();
    series.text((0x0020, 0x000e), Text::Ui, origin.uid(SERIES_INSTANCE_UID)?);
    series.items((0x0008, 0x114a), vec![reference(origin)?]);
    Some(series)
}

/// The object that the mask came in, as an item; `None` without its class and UID.
pub(super) fn reference(origin: &DicomOrigin) -> Option<Dataset> {
    let mut item = Dataset::default();
    item.text((0x0008, 0x1150), Text::Ui, origin.uid(SOP_CLASS_UID)?);
    item.text((0x0008, 0x1155), Text::Ui, origin.uid(SOP_INSTANCE_UID)?);
    Some(item)
}

/// The same within its series and study; `None` without these.
pub(super) fn evidence(origin: &DicomOrigin) -> Option<Dataset> {
    let mut series = Dataset::default();
    series.text((0x0020, 0x000e), Text::Ui, origin.uid(SERIES_INSTANCE_UID)?);
    series.items((0x0008, 0x1199), vec![reference(origin)?]);
    let mut study = Dataset::default();
    study.text((0x0020, 0x000d), Text::Ui, origin.uid(STUDY_INSTANCE_UID)?);
    study.items((0x0008, 0x1115), vec![series]);
    Some(study)
}

fn add_file(set: &mut Dataset, bytes: &[u8], media_type: &str) -> io::Result<()> {
    set.text((0x0008, 0x002a), Text::Dt, "");
    set.text((0x0042, 0x0012), Text::Lo, media_type);
    set.long((0x0042, 0x0015), u32::try_from(bytes.len()).map_err(io::Error::other)?);
    set.bytes((0x0042, 0x0011), *b"OB", bytes);
    Ok(())
}
