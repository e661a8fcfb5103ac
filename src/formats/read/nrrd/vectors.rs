//! Vectors in brackets, as `(1,0,0) none (0, 0, 2.5)`.

use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Line, number};

/// Axes that a file may have here, and coordinates of one.
const MAX_AXES: usize = 4;

const EXPECTED: &str = "vectors of finite numbers in brackets, such as (1,0,0), or none, one for each axis";

/// The vectors of a line, `None` for an axis that has none.
pub(super) fn vectors(line: &Line) -> Result<Vec<Option<Vec<f64>>>, ReadError> {
    let mut found = Vec::new();
    let mut rest = line.value.trim_start();
    while !rest.is_empty() {
        if found.len() == MAX_AXES {
            return Err(line.malformed(EXPECTED));
        }
        let (vector, after) = next(rest).ok_or_else(|| line.malformed(EXPECTED))?;
        found.push(vector);
        rest = after.trim_start();
    }
    Ok(found)
}

fn next(text: &str) -> Option<(Option<Vec<f64>>, &str)> {
    if let Some(after) = text.strip_prefix("none") {
        return Some((None, after));
    }
    let (inside, after) = text.strip_prefix('(')?.split_once(')')?;
    let coordinates: Option<Vec<f64>> = inside.split(',').take(MAX_AXES + 1).map(|word| number(word.trim())).collect();
    Some((Some(coordinates?), after))
}
