//! The masks that a command line names: files, and those in folders, such as a series that a PACS wrote.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::cause;
use crate::formats::readers::check_header;
use crate::formats::{InputLimits, ReadError};
use crate::problem::Problem;

pub(super) const CHECK_PATH: &str = "check the path";
/// What a problem of the command line is at.
const ARGUMENT: &str = "MASK";
/// Files that are looked at: a study has thousands of slices. With more, a folder was named by mistake.
const MOST_FILES: usize = 100_000;
/// Folders below the one named: patient, study, series.
const MOST_FOLDERS: usize = 4;
/// Names of files end so; none of it is said again in the name of the folder for their results.
const ENDINGS: [&str; 8] = [".gz", ".nii", ".seg", ".nrrd", ".mha", ".dcm", ".dicom", ".img"];

/// A mask, and the name of the folder for its results where there are several.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Named {
    pub file: PathBuf,
    pub name: String,
}

/// The files to read: those of `paths`, and below its folders all whose header is that of a mask, each once.
///
/// # Errors
/// When one cannot be opened, or there is no mask below a folder.
pub(super) fn find_masks(paths: &[PathBuf]) -> Result<Vec<Named>, Box<Problem>> {
    let mut masks: Vec<Named> = Vec::new();
    for path in paths {
        for file in masks_at(path)? {
            if masks.iter().any(|other| other.file == file) {
                continue;
            }
            let is_taken = |name: &String| masks.iter().any(|other| other.name == *name);
            let stem = stem(&file);
            let further = (2..).map(|number| format!("{stem}-{number}"));
            let name = std::iter::once(stem.clone()).chain(further).find(|name| !is_taken(name)).unwrap_or_default();
            masks.push(Named { file, name });
        }
    }
    Ok(masks)
}

/// The name of a file without what tells its format.
fn stem(file: &Path) -> String {
    let name = file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let mut stem = name.as_str();
    while let Some(shorter) = ENDINGS.iter().find_map(|ending| {
        let at = stem.len().checked_sub(ending.len()).filter(|at| *at > 0)?;
        stem.get(at..)?.eq_ignore_ascii_case(ending).then(|| &stem[..at])
    }) {
        stem = shorter;
    }
    // A name of dots is another folder.
    let told = if stem.chars().all(|c| c == '.') { &name } else { stem };
    told.chars().map(|c| if c.is_control() { '_' } else { c }).collect()
}

/// `path` itself, or the files below it whose header is that of a mask.
fn masks_at(path: &Path) -> Result<Vec<PathBuf>, Box<Problem>> {
    if !path.is_dir() {
        return match File::open(path) {
            Ok(_) => Ok(vec![path.to_owned()]),
            Err(error) => Err(unreadable(path, &error)),
        };
    }
    let mut files = Vec::new();
    list(path, MOST_FOLDERS, &mut files).map_err(|error| unreadable(path, &error))?;
    if files.len() > MOST_FILES {
        let detail = format!("the folder {} holds more than {MOST_FILES} files", path.display());
        return Err(problem("too_many_files", detail, "name the mask, or the folder of its series"));
    }
    // The order of a folder differs from disk to disk.
    files.sort();
    let looked_at = files.len();
    let mut masks = Vec::new();
    for file in files {
        match check_header(&file, InputLimits::default()) {
            Ok(_) => masks.push(file),
            // It may be the mask.
            Err(ReadError::Io(error)) => return Err(unreadable(&file, &error)),
            Err(_) => {}
        }
    }
    if masks.is_empty() {
        let detail = format!("none of the {looked_at} files in the folder {} is a mask", path.display());
        return Err(problem("no_mask_in_folder", detail, "name the file; alone, it is told why it is none"));
    }
    Ok(masks)
}

/// Files in a folder and in those below it; links to folders are not followed.
fn list(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_dir() && depth > 0 {
            list(&entry.path(), depth - 1, files)?;
        } else if !kind.is_dir() && entry.path().is_file() {
            files.push(entry.path());
        }
        if files.len() > MOST_FILES {
            break;
        }
    }
    Ok(())
}

fn unreadable(path: &Path, error: &io::Error) -> Box<Problem> {
    let detail = format!("cannot open the mask {}: {}", path.display(), cause(error));
    let hint = if error.kind() == ErrorKind::PermissionDenied { "make it readable" } else { CHECK_PATH };
    problem("cannot_open_mask", detail, hint)
}

fn problem(code: &str, detail: String, hint: &str) -> Box<Problem> {
    Box::new(Problem::new(400, code, detail).at(ARGUMENT).hint(hint))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_named_as_its_mask_without_the_format() {
        for (file, name) in [
            ("a/liver.nii.gz", "liver"),
            ("liver.seg.nrrd", "liver"),
            ("liver.SEG.DCM", "liver"),
            ("IM0001", "IM0001"),
            ("1.2.840.99", "1.2.840.99"),
            (".nii", ".nii"),
            ("..nii", "..nii"),
            ("a\u{1b}b.nii", "a_b"),
            ("é.nii", "é"),
        ] {
            assert_eq!(stem(Path::new(file)), name, "{file}");
        }
    }
}
