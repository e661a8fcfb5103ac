//! The mask that a command line names: a file, or the only mask in a folder, such as a series that a PACS wrote.

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
/// Masks that are named where there are several.
const NAMED: usize = 5;

/// The file to read: `path` itself, or the only file below it whose header is that of a mask.
///
/// # Errors
/// When it cannot be opened, or there is no mask below it or more than one.
pub(super) fn find_mask(path: &Path) -> Result<PathBuf, Box<Problem>> {
    if !path.is_dir() {
        return match File::open(path) {
            Ok(_) => Ok(path.to_owned()),
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
    match masks.len() {
        0 => {
            let detail = format!("none of the {looked_at} files in the folder {} is a mask", path.display());
            Err(problem("no_mask_in_folder", detail, "name the file; alone, it is told why it is none"))
        }
        1 => Ok(masks.remove(0)),
        count => {
            let named: Vec<String> = masks.iter().take(NAMED).map(|mask| mask.display().to_string()).collect();
            let more = if count > NAMED { ", …" } else { "" };
            let detail = format!("the folder {} holds {count} masks: {}{more}", path.display(), named.join(", "));
            Err(problem("several_masks", detail, "name one of them"))
        }
    }
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
