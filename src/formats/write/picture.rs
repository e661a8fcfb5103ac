//! A result as pictures and pages, in the formats that show them.

use std::io::{self, Write};

use super::record::Record;
use super::{pdf, png, report};

/// Title of the report.
pub(super) const REPORT_TITLE: &str = "Thickness report, not for diagnosis";

/// Writes `picture.png`.
///
/// # Errors
/// When writing fails.
pub fn write_png(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    png::write(&report::picture(record).painted(), out)
}

/// Writes `report.pdf`.
///
/// # Errors
/// When writing fails.
pub fn write_pdf(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    pdf::write(REPORT_TITLE, report::pages(record), out)
}
