//! Results as DICOM objects, read back by a reader of the tests' own.

use medialrep::formats::artifacts::ARTIFACTS;
use medialrep::formats::dicom_origin::DicomOrigin;
use medialrep::formats::write::record::Record;
use medialrep::model::Figure;

use crate::formats_pages::{png, record, slab, written};
use crate::help::dicom_read::{Dataset, bytes, code, number, read, sequence, text};
use crate::help::models::model;

const OBJECTS: [(&str, &str); 4] = [
    ("picture.dcm", "1.2.840.10008.5.1.4.1.1.7"),
    ("report.pdf.dcm", "1.2.840.10008.5.1.4.1.1.104.1"),
    ("surfaces.stl.dcm", "1.2.840.10008.5.1.4.1.1.104.3"),
    ("report.sr.dcm", "1.2.840.10008.5.1.4.1.1.88.34"),
];

/// A mask that came as a segmentation, of a patient whose name has letters of Latin-1.
fn of_dicom() -> Record {
    let mut origin = DicomOrigin::default();
    for (tag, value) in [
        ((0x0008, 0x0005), b"ISO_IR 100".as_slice()),
        ((0x0008, 0x0016), b"1.2.840.10008.5.1.4.1.1.66.4"),
        ((0x0008, 0x0018), b"1.2.3.1\0"),
        ((0x0008, 0x0050), b"CANARY-7"),
        ((0x0008, 0x1115), b"1.2.3.9\0"),
        ((0x0010, 0x0010), b"M\xfcller^Canary"),
        ((0x0010, 0x0020), b"CANARY-ID "),
        ((0x0020, 0x000d), b"1.2.3.2\0"),
        ((0x0020, 0x000e), b"1.2.3.3\0"),
        ((0x0020, 0x0052), b"1.2.3.4\0"),
    ] {
        origin.keep(tag, value);
    }
    let mut model = slab();
    model.structures[0].name = Some("Größe".to_owned());
    Record { dicom: Some(origin), ..record(model) }
}

#[test]
fn every_object_is_of_its_class_and_none_of_a_patient_where_none_is_known() {
    let record = record(model());
    let mut series = Vec::new();
    for (name, class) in OBJECTS {
        let (meta, set) = read(&written(name, &record));
        assert_eq!([text(&meta, 0x0002_0002), text(&set, 0x0008_0016)], [class; 2], "{name}");
        assert_eq!(text(&meta, 0x0002_0003), text(&set, 0x0008_0018), "{name}");
        for tag in [0x0010_0010, 0x0010_0020, 0x0010_0030, 0x0010_0040, 0x0008_0020, 0x0008_0050] {
            assert_eq!(bytes(&set, tag), b"", "{name} {tag:08x}");
        }
        assert_eq!([text(&set, 0x0008_0023), text(&set, 0x0008_0033)], ["20240229", "235959"]);
        assert!(text(&set, 0x0008_103e).ends_with("not for diagnosis"));
        assert_eq!(text(&set, 0x0008_0070), "medialrep");
        series.push((text(&set, 0x0020_000d), text(&set, 0x0020_000e), text(&set, 0x0008_0018)));
    }
    let (study, ..) = series[0].clone();
    assert!(series.iter().all(|own| own.0 == study), "one study");
    let mut uids: Vec<&String> = series.iter().flat_map(|(_, series, own)| [series, own]).chain([&study]).collect();
    assert!(uids.iter().all(|uid| uid.starts_with("2.25.") && uid.len() <= 44), "{uids:?}");
    uids.sort();
    uids.dedup();
    assert_eq!(uids.len(), 9, "no two things share a UID");
}

#[test]
fn uids_follow_from_the_mask_and_the_parameters_alone() {
    let uid = |record: &Record| text(&read(&written("report.sr.dcm", record)).1, 0x0008_0018);
    let first = record(model());
    let later = Record { ended_unix_s: Some(1_800_000_000), ..record(model()) };
    assert_eq!(uid(&first), uid(&later));
    let mut other_mask = record(model());
    other_mask.input.sha256 = "cd".repeat(32);
    let mut other_params = record(model());
    other_params.model.params = medialrep::params::Params { uncertainty: 3, ..Default::default() }.check().unwrap();
    assert!(uid(&first) != uid(&other_mask) && uid(&first) != uid(&other_params));
}

#[test]
fn patient_and_study_are_those_of_the_segmentation_byte_for_byte() {
    for (name, _) in OBJECTS {
        let (_, set) = read(&written(name, &of_dicom()));
        assert_eq!(bytes(&set, 0x0010_0010), b"M\xfcller^Canary ", "{name}");
        assert_eq!([text(&set, 0x0008_0005), text(&set, 0x0010_0020)], ["ISO_IR 100", "CANARY-ID"], "{name}");
        assert_eq!([text(&set, 0x0020_000d), text(&set, 0x0008_0050)], ["1.2.3.2", "CANARY-7"], "{name}");
    }
    let (_, stl) = read(&written("surfaces.stl.dcm", &of_dicom()));
    assert_eq!(text(&stl, 0x0020_0052), "1.2.3.4");
    assert_eq!(text(&sequence(&stl, 0x0042_0013)[0], 0x0008_1155), "1.2.3.1");
    let series = &sequence(&stl, 0x0008_1115)[0];
    assert_eq!(text(series, 0x0020_000e), "1.2.3.3");
    assert_eq!(text(&sequence(series, 0x0008_114a)[0], 0x0008_1155), "1.2.3.1");
}

#[test]
fn what_names_a_patient_is_in_the_record_and_in_dicom_results_alone() {
    let record = of_dicom();
    let mut kept = Vec::new();
    record.write(&mut kept).unwrap();
    let read = Record::read(kept.as_slice()).unwrap();
    assert_eq!(read.dicom, record.dicom);
    let is_told = |bytes: &[u8]| bytes.windows(6).any(|part| part == b"CANARY" || part == b"Canary");
    // Of what is packed no text can be searched for: it has the bytes that it has without a patient.
    let without = Record { dicom: None, ..read.clone() };
    for artifact in ARTIFACTS.iter().filter(|artifact| artifact.media_type != "application/dicom") {
        assert!(written(artifact.name, &read) == written(artifact.name, &without), "{}", artifact.name);
    }
    assert!(!is_told(format!("{record:?}").as_bytes()));
}

#[test]
fn a_picture_has_the_pixels_of_the_png() {
    let record = record(slab());
    let (width, height, pixels) = png(&written("picture.png", &record));
    let (_, set) = read(&written("picture.dcm", &record));
    assert_eq!([number(&set, 0x0028_0010), number(&set, 0x0028_0011)], [height, width]);
    assert_eq!([number(&set, 0x0028_0002), number(&set, 0x0028_0100)], [3, 8]);
    assert_eq!(text(&set, 0x0028_0004), "RGB");
    assert!(bytes(&set, 0x7fe0_0010) == pixels);
}

#[test]
fn documents_hold_the_files_as_they_are() {
    let record = record(slab());
    for (object, file, media_type) in
        [("report.pdf.dcm", "report.pdf", "application/pdf"), ("surfaces.stl.dcm", "surfaces.stl", "model/stl")]
    {
        let (_, set) = read(&written(object, &record));
        let file = written(file, &record);
        assert_eq!((text(&set, 0x0042_0012).as_str(), number(&set, 0x0042_0015)), (media_type, file.len()));
        assert!(bytes(&set, 0x0042_0011)[..file.len()] == file, "{object}");
    }
    let (_, stl) = read(&written("surfaces.stl.dcm", &record));
    assert_eq!(code(&stl, 0x0040_08ea), "mm");
}

#[test]
fn surfaces_say_how_many_are_missing() {
    let title = |record: &Record| {
        let (_, set) = read(&written("surfaces.stl.dcm", record));
        text(&set, 0x0042_0010)
    };
    let mut record = record(slab());
    assert!(title(&record).starts_with("Closed surfaces of all figures"));
    let Figure::Sheet(sheet) = &mut record.model.structures[0].figures[0] else { panic!("a slab is a sheet") };
    sheet.valid[0] = false;
    assert!(title(&record).starts_with("Closed surfaces of 0 of 1 figures"), "a sheet with a hole has none");
}

/// The groups of measurements of a report.
fn groups(set: &Dataset) -> Vec<Dataset> {
    let all = sequence(set, 0x0040_a730);
    let measurements = all.iter().find(|item| code(item, 0x0040_a043) == "126010").unwrap();
    sequence(measurements, 0x0040_a730).to_vec()
}

/// The template of a container.
fn template(set: &Dataset) -> String {
    text(&sequence(set, 0x0040_a504)[0], 0x0040_db00)
}

/// Measured numbers with their name, statistic and unit.
fn measured(group: &Dataset) -> Vec<(String, String, String, f64)> {
    let mut found = Vec::new();
    for item in sequence(group, 0x0040_a730).iter().filter(|item| text(item, 0x0040_a040) == "NUM") {
        let value = &sequence(item, 0x0040_a300)[0];
        let statistic = sequence(item, 0x0040_a730).first().map_or(String::new(), |own| code(own, 0x0040_a168));
        let number = text(value, 0x0040_a30a).parse().unwrap();
        found.push((code(item, 0x0040_a043), statistic, code(value, 0x0040_08ea), number));
    }
    found
}

#[test]
fn a_report_has_the_numbers_of_each_structure_with_their_codes() {
    let record = record(slab());
    let structure = &record.model.structures[0];
    let summary = structure.thickness_summary();
    let total = summary.total_mm.unwrap();
    let (_, set) = read(&written("report.sr.dcm", &record));
    assert_eq!((template(&set), code(&set, 0x0040_a043)), ("1500".to_owned(), "126000".to_owned()));
    let groups = groups(&set);
    assert_eq!((groups.len(), template(&groups[0]).as_str()), (1, "1501"), "there is no segmentation to refer to");
    let wanted = [
        ("THICKNESS", "373098007", "mm", total.mean),
        ("THICKNESS", "386136009", "mm", total.sd),
        ("THICKNESS", "56851009", "mm", total.max),
        ("THICKNESS", "255605001", "mm", total.min),
        ("THICKNESS", "373099004", "mm", total.p50),
        ("SHEETAREA", "", "mm2", summary.area_mm2),
        ("118565006", "", "mm3", structure.volume_mm3),
    ];
    for ((name, statistic, unit, value), found) in wanted.into_iter().zip(measured(&groups[0])) {
        assert_eq!([found.0, found.1, found.2], [name, statistic, unit]);
        assert!((found.3 - value).abs() < 1e-6, "{name} {statistic}: {} is not {value}", found.3);
    }
    assert_eq!(measured(&groups[0]).len(), 7);
}

#[test]
fn a_group_refers_to_its_segment_and_the_series_that_was_segmented() {
    let record = of_dicom();
    let (_, set) = read(&written("report.sr.dcm", &record));
    let group = &groups(&set)[0];
    assert_eq!(template(group), "1411");
    let content = sequence(group, 0x0040_a730);
    let named = |name: &str| content.iter().find(|item| code(item, 0x0040_a043) == name).unwrap();
    let segment = &sequence(named("121191"), 0x0008_1199)[0];
    let label = usize::try_from(record.model.structures[0].label).unwrap();
    assert_eq!((text(segment, 0x0008_1155).as_str(), number(segment, 0x0062_000b)), ("1.2.3.1", label));
    assert_eq!(text(named("121232"), 0x0040_a124), "1.2.3.9");
    assert_eq!(text(named("112039"), 0x0040_a160), "Gr??e", "Latin-1 is another's: letters beyond ASCII are left out");
    let study = &sequence(&set, 0x0040_a375)[0];
    assert_eq!(text(study, 0x0020_000d), "1.2.3.2");
    assert_eq!(text(&sequence(study, 0x0008_1115)[0], 0x0020_000e), "1.2.3.3");
}

#[test]
fn a_group_of_a_label_map_tells_its_label_and_refers_to_no_segment() {
    let mut record = of_dicom();
    let mut origin = record.dicom.take().unwrap();
    origin.keep((0x0008, 0x0016), b"1.2.840.10008.5.1.4.1.1.66.7");
    let record = Record { dicom: Some(origin), ..record };
    let (_, set) = read(&written("report.sr.dcm", &record));
    let group = &groups(&set)[0];
    assert_eq!(template(group), "1501", "readers of before label maps refuse a report that refers to a segment of one");
    let content = sequence(group, 0x0040_a730);
    let label = content.iter().find(|item| code(item, 0x0040_a043) == "LABEL").unwrap();
    assert_eq!(text(label, 0x0040_a160), record.model.structures[0].label.to_string());
    assert!(content.iter().all(|item| text(item, 0x0040_a040) != "IMAGE"));
    assert_eq!(sequence(&set, 0x0040_a375).len(), 1, "the mask is still named as what was measured");
}

#[test]
fn verdicts_are_told_with_their_reasons() {
    let (_, set) = read(&written("report.sr.dcm", &record(model())));
    let mut told = Vec::new();
    for group in groups(&set) {
        for item in sequence(&group, 0x0040_a730) {
            match code(item, 0x0040_a043).as_str() {
                "VERDICT" => told.push(code(item, 0x0040_a168)),
                "REASON" => told.push(text(item, 0x0040_a160)),
                _ => {}
            }
        }
    }
    let refused = "the medial sheet has only 3 points, a lattice needs 9";
    assert_eq!(told, ["VERDICT-WARN", "few nodes", "VERDICT-REFUSED", "few nodes", refused]);
}

#[test]
fn a_name_in_a_set_of_letters_that_is_switched_to_keeps_its_set() {
    let mut origin = DicomOrigin::default();
    origin.keep((0x0008, 0x0005), b"\\ISO 2022 IR 87");
    origin.keep((0x0010, 0x0010), b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B");
    let (_, set) = read(&written("report.sr.dcm", &Record { dicom: Some(origin.clone()), ..record(slab()) }));
    assert_eq!(bytes(&set, 0x0008_0005), b"\\ISO 2022 IR 87 ");
    assert_eq!(bytes(&set, 0x0010_0010), origin.bytes((0x0010, 0x0010)));
}

#[test]
fn an_object_has_the_same_uid_whatever_other_files_are_asked_for() {
    let of = |outputs: &str| {
        let params = format!("{{\"outputs\": [{outputs}]}}");
        let params = medialrep::formats::params_json::parse(params.as_bytes()).unwrap();
        let mut record = record(slab());
        record.model.params = params;
        let (_, set) = read(&written("report.sr.dcm", &record));
        [0x0008_0018, 0x0020_000d, 0x0020_000e].map(|tag| text(&set, tag))
    };
    assert_eq!(of("\"report.sr.dcm\""), of("\"report.sr.dcm\", \"picture.dcm\""));
}
