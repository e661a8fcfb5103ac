//! The numbers as a structured report, Comprehensive 3D SR after template 1500: for each structure a group of
//! measurements (template 1411 by its segment; 1501, with the label, where the mask has no segment to refer to).

use super::content::{Relation, add_content, code, container, number, segment, text, uid as uid_item};
use super::dataset::{Code, Dataset, Text};
use super::document::{evidence, reference};
use super::instance::{Instance, Kind};
use super::uid;
use crate::formats::dicom_origin::{DicomOrigin, SEGMENTED_SERIES, SOP_CLASS_UID};
use crate::formats::write::record::Record;
use crate::model::{Structure, Verdict};
use crate::space::LabelCode;

pub(super) const KIND: Kind = Kind {
    class: "1.2.840.10008.5.1.4.1.1.88.34",
    modality: "SR",
    series: 9001,
    description: "medialrep measurements, not for diagnosis",
    artifact: "report.sr.dcm",
};

/// Our own coding scheme: no scheme has a thickness that is measured across a medial sheet.
const OWN: &str = "99MEDIALREP";

pub(super) const REPORT: Code<'static> = Code("126000", "DCM", "Imaging Measurement Report");
pub(super) const MM: Code<'static> = Code("mm", "UCUM", "mm");
const MM2: Code<'static> = Code("mm2", "UCUM", "mm2");
const MM3: Code<'static> = Code("mm3", "UCUM", "mm3");

const THICKNESS: Code<'static> = Code("THICKNESS", OWN, "Thickness across medial sheet");
const SHEET_AREA: Code = Code("SHEETAREA", OWN, "Area of medial sheet");
const LABEL: Code<'static> = Code("LABEL", OWN, "Label in the mask");
const VERDICT: Code<'static> = Code("VERDICT", OWN, "Quality verdict");
const REASON: Code<'static> = Code("REASON", OWN, "Reason of quality verdict");
const VOLUME: Code<'static> = Code("118565006", "SCT", "Volume");
const DERIVATION: Code<'static> = Code("121401", "DCM", "Derivation");
const MEAN: Code<'static> = Code("373098007", "SCT", "Mean");
const DEVIATION: Code<'static> = Code("386136009", "SCT", "Standard deviation");
const MAXIMUM: Code<'static> = Code("56851009", "SCT", "Maximum");
const MINIMUM: Code<'static> = Code("255605001", "SCT", "Minimum");
const MEDIAN: Code<'static> = Code("373099004", "SCT", "Median");

/// The object.
pub(super) fn instance(record: &Record) -> Instance {
    let mut instance = Instance::new(record, KIND);
    let mut groups = Vec::new();
    for (index, structure) in record.model.structures.iter().enumerate() {
        groups.push(group(&instance, record, (index, structure)));
    }
    let set = &mut instance.dataset;
    set.text((0x0040, 0xa491), Text::Cs, "COMPLETE");
    set.text((0x0040, 0xa493), Text::Cs, "UNVERIFIED");
    set.items((0x0008, 0x1111), Vec::new());
    set.items((0x0040, 0xa372), Vec::new());
    if let Some(evidence) = record.dicom.as_ref().and_then(evidence) {
        set.items((0x0040, 0xa375), vec![evidence]);
    }
    set.items((0x0008, 0x0110), vec![scheme()]);
    set.text((0x0040, 0xa040), Text::Cs, "CONTAINER");
    set.code((0x0040, 0xa043), REPORT);
    let mut content = head(record);
    content.push(container(Code("126010", "DCM", "Imaging Measurements"), None, groups));
    add_content(set, Some("1500"), content);
    instance
}

/// Whose codes ours are.
fn scheme() -> Dataset {
    let mut scheme = Dataset::default();
    scheme.text((0x0008, 0x0102), Text::Sh, OWN);
    scheme.text((0x0008, 0x0115), Text::St, "Codes of medialrep");
    scheme.text((0x0008, 0x0116), Text::St, "medialrep");
    scheme
}

/// Language, observer and procedure.
fn head(record: &Record) -> Vec<Dataset> {
    vec![
        code(
            Relation::Modifier,
            Code("121049", "DCM", "Language of Content Item and Descendants"),
            Code("en", "RFC5646", "English"),
        ),
        code(Relation::Context, Code("121005", "DCM", "Observer Type"), Code("121007", "DCM", "Device")),
        uid_item(Relation::Context, Code("121012", "DCM", "Device Observer UID"), &uid::of(record, "observer")),
        text(Relation::Context, Code("121013", "DCM", "Device Observer Name"), "medialrep"),
        text(Relation::Context, Code("121014", "DCM", "Device Observer Manufacturer"), "medialrep"),
        text(Relation::Context, Code("121015", "DCM", "Device Observer Model Name"), "medialrep"),
        code(Relation::Modifier, Code("121058", "DCM", "Procedure reported"), Code("363679005", "SCT", "Imaging")),
    ]
}

/// The measurements of a structure.
fn group(instance: &Instance, record: &Record, (index, structure): (usize, &Structure)) -> Dataset {
    let (mut content, template) = identity(instance, record, (index, structure));
    content.push(text(Relation::Modifier, Code("111001", "DCM", "Algorithm Name"), "medialrep"));
    let version = env!("CARGO_PKG_VERSION");
    content.push(text(Relation::Modifier, Code("111003", "DCM", "Algorithm Version"), version));
    let summary = structure.thickness_summary();
    if let Some(total) = summary.total_mm {
        let statistics = [
            (total.mean, MEAN),
            (total.sd, DEVIATION),
            (total.max, MAXIMUM),
            (total.min, MINIMUM),
            (total.p50, MEDIAN),
        ];
        for (length_mm, statistic) in statistics {
            let derivation = code(Relation::Modifier, DERIVATION, statistic);
            content.extend(number(THICKNESS, length_mm, MM, vec![derivation]));
        }
        content.extend(number(SHEET_AREA, summary.area_mm2, MM2, Vec::new()));
    }
    content.extend(number(VOLUME, structure.volume_mm3, MM3, Vec::new()));
    content.push(code(Relation::Contains, VERDICT, verdict(structure)));
    for reason in reasons(structure) {
        content.push(text(Relation::Contains, REASON, &reason));
    }
    container(Code("125007", "DCM", "Measurement Group"), Some(template), content)
}

/// What the group is of, and the template that it follows.
fn identity(
    instance: &Instance,
    record: &Record,
    (index, structure): (usize, &Structure),
) -> (Vec<Dataset>, &'static str) {
    let name = structure.name.clone().unwrap_or_else(|| format!("Label {}", structure.label));
    let mut tracked = text(Relation::Context, Code("112039", "DCM", "Tracking Identifier"), &name);
    instance.words(&mut tracked, (0x0040, 0xa160), Text::Ut, &name);
    let tracking = uid::of(record, &format!("tracking {index} {}", structure.label));
    let mut content = vec![
        tracked,
        uid_item(Relation::Context, Code("112040", "DCM", "Tracking Unique Identifier"), &tracking),
        code(Relation::Contains, Code("121071", "DCM", "Finding"), finding(structure)),
    ];
    let source = record.dicom.as_ref().filter(|origin| has_segments(origin));
    let source = source.and_then(|own| Some((reference(own)?, own.uid(SEGMENTED_SERIES)?)));
    let (Some((reference, series)), Ok(number)) = (source, u16::try_from(structure.label)) else {
        content.push(text(Relation::Contains, LABEL, &structure.label.to_string()));
        return (content, "1501");
    };
    content.push(segment(Code("121191", "DCM", "Referenced Segment"), reference, number));
    let series_name = Code("121232", "DCM", "Source series for segmentation");
    content.push(uid_item(Relation::Contains, series_name, series));
    (content, "1411")
}

/// Whether a report may refer to a segment of the source. Label maps are younger than most readers of reports: those of
/// before 2024 know the class as no image, and refuse a report that refers to a segment of it as a whole.
fn has_segments(origin: &DicomOrigin) -> bool {
    const SEGMENTATION: &str = "1.2.840.10008.5.1.4.1.1.66.4";
    origin.uid(SOP_CLASS_UID) == Some(SEGMENTATION)
}

/// What the structure is: by the code that the source gives it, where that can be written with the letters and the length
/// that a code of a report has.
fn finding(structure: &Structure) -> Code<'_> {
    /// Characters of a value and of a scheme, and of a meaning.
    const MOST_CHARS: [usize; 3] = [16, 16, 64];
    const ANY: Code<'static> = Code("91723000", "SCT", "Anatomical structure");
    let Some(LabelCode { value, scheme, meaning }) = &structure.code else { return ANY };
    let texts = [value, scheme, meaning].map(String::as_str);
    let is_fit = |(text, most): (&str, usize)| text.is_ascii() && (1..=most).contains(&text.len());
    if texts.into_iter().zip(MOST_CHARS).all(is_fit) { Code(value, scheme, meaning) } else { ANY }
}

fn verdict(structure: &Structure) -> Code<'static> {
    match structure.quality.verdict {
        _ if structure.refusal.is_some() => Code("VERDICT-REFUSED", OWN, "Refused"),
        Verdict::Pass => Code("VERDICT-PASS", OWN, "Pass"),
        Verdict::Warn => Code("VERDICT-WARN", OWN, "Warn"),
        Verdict::Fail => Code("VERDICT-FAIL", OWN, "Fail"),
    }
}

fn reasons(structure: &Structure) -> Vec<String> {
    let mut reasons: Vec<String> = structure.quality.reasons.iter().map(|own| own.message.clone()).collect();
    reasons.extend(structure.refusal.as_ref().map(ToString::to_string));
    reasons
}
