//! `picture.png` as a Secondary Capture: what every archive and viewer shows.

use std::io;

use super::dataset::Text;
use super::instance::{Instance, Kind};
use crate::formats::write::record::Record;
use crate::formats::write::report;

pub(super) const KIND: Kind = Kind {
    class: "1.2.840.10008.5.1.4.1.1.7",
    modality: "OT",
    series: 9002,
    description: "medialrep picture, not for diagnosis",
    artifact: "picture.dcm",
};

/// The object.
///
/// # Errors
/// When the picture is too large for the format.
pub(super) fn instance(record: &Record) -> io::Result<Instance> {
    let pixels = report::picture(record).painted();
    let mut instance = Instance::new(record, KIND);
    let set = &mut instance.dataset;
    // Made by a workstation of what it has.
    set.text((0x0008, 0x0064), Text::Cs, "WSD");
    set.bytes((0x0008, 0x0008), *b"CS", br"DERIVED\SECONDARY");
    // Rows and columns are those of a page, not of the patient.
    set.text((0x0020, 0x0020), Text::Cs, "");
    set.text((0x0020, 0x0060), Text::Cs, "");
    set.short((0x0028, 0x0002), 3);
    set.text((0x0028, 0x0004), Text::Cs, "RGB");
    set.short((0x0028, 0x0006), 0);
    set.short((0x0028, 0x0010), u16::try_from(pixels.height()).map_err(io::Error::other)?);
    set.short((0x0028, 0x0011), u16::try_from(pixels.width()).map_err(io::Error::other)?);
    set.short((0x0028, 0x0100), 8);
    set.short((0x0028, 0x0101), 8);
    set.short((0x0028, 0x0102), 7);
    set.short((0x0028, 0x0103), 0);
    // The names of labels are whatever the file says.
    set.text((0x0028, 0x0301), Text::Cs, "YES");
    set.bytes((0x7fe0, 0x0010), *b"OB", pixels.bytes());
    Ok(instance)
}
