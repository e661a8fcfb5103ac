//! Segments as 3D Slicer describes them, in keys such as `Segment0_Name:=liver`.

use std::collections::BTreeMap;

use crate::formats::read::layers::Segments;
use crate::space::{Label, VolumeNotice};

/// As many as a volume can have labels.
const MAX_SEGMENTS: usize = u16::MAX as usize;
/// Characters of a name, trimmed: with more it is no name. The same as in tables of NIfTI.
const MAX_NAME_CHARS: usize = 80;
/// Indices of voxels from here on are none of an image.
const MAX_INDEX: i64 = 1 << 31;

/// The voxels of the segmented image that the file keeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct KeptExtent {
    /// The first one, as `[i, j, k]`.
    pub first: [f64; 3],
    /// The line that says so.
    pub line: u64,
}

impl KeptExtent {
    /// From the first and last index along each axis; `None` where these are no six numbers.
    pub fn parse(value: &[u8], line: u64) -> Option<Self> {
        let words = std::str::from_utf8(value).ok()?.split_ascii_whitespace();
        let index = |word: &str| word.parse::<i64>().ok().filter(|index| index.abs() < MAX_INDEX);
        let ends: Option<Vec<i64>> = words.take(7).map(index).collect();
        match ends?.as_slice() {
            [i, _, j, _, k, _] => Some(Self { first: [*i, *j, *k].map(|index| index as f64), line }),
            _ => None,
        }
    }
}

/// The keys of all segments, by their number from 0.
#[derive(Debug, Default)]
pub(super) struct SegmentKeys {
    told: BTreeMap<u32, Told>,
    /// Values of keys that were passed over.
    ignored: u64,
}

/// What is told of one. What is not told has the value that Slicer takes for it.
#[derive(Debug, Default)]
struct Told {
    name: Option<String>,
    color: Option<[u8; 3]>,
    value: Option<i64>,
    layer: Option<usize>,
}

impl SegmentKeys {
    /// Takes a key if it is one of a segment. What is wrong with it is no reason to refuse the voxels.
    pub fn take(&mut self, key: &[u8], value: &[u8]) {
        let Some((number, what)) = split(key) else { return };
        if !matches!(what, "Name" | "Color" | "DefaultColor" | "LabelValue" | "Layer") {
            return;
        }
        if self.told.len() == MAX_SEGMENTS && !self.told.contains_key(&number) {
            self.ignored += 1;
            return;
        }
        let told = self.told.entry(number).or_default();
        let text = unescaped(value);
        let is_taken = match (what, text.as_deref().map(str::trim)) {
            ("Name", Some(text)) => set(&mut told.name, name(text)),
            ("Color" | "DefaultColor", Some(text)) => set(&mut told.color, color(text)),
            ("LabelValue", Some(text)) => set(&mut told.value, text.parse().ok()),
            ("Layer", Some(text)) => set(&mut told.layer, text.parse().ok()),
            _ => false,
        };
        self.ignored += u64::from(!is_taken);
    }

    /// The segments of a file with so many layers.
    pub fn of_layers(self, layers: usize, notices: &mut Vec<VolumeNotice>) -> Segments {
        let mut segments = Segments::default();
        let mut ignored = self.ignored;
        for (number, told) in self.told {
            // Where no layer is told there is one for each segment, as Slicer 4 wrote them.
            let own = if layers == 1 { 0 } else { usize::try_from(number).unwrap_or(layers) };
            let layer = told.layer.unwrap_or(own);
            let value = told.value.unwrap_or(1);
            if layer >= layers || value == 0 {
                ignored += 1;
                continue;
            }
            segments.add(i64::from(number) + 1, layer, Label { value, name: told.name, color: told.color, code: None });
        }
        if ignored > 0 {
            let message = format!(
                "{ignored} keys or descriptions of segments in the header were passed over: names of more than \
                 {MAX_NAME_CHARS} characters, with control characters or not in UTF-8, colours or numbers that are \
                 none, or layers that the file does not have"
            );
            notices.push(VolumeNotice { code: "label_table_ignored", message });
        }
        segments
    }
}

/// `Segment12_Name` → 12 and `Name`.
fn split(key: &[u8]) -> Option<(u32, &str)> {
    let (number, what) = std::str::from_utf8(key).ok()?.strip_prefix("Segment")?.split_once('_')?;
    Some((number.parse().ok()?, what))
}

/// Whether there is something new to set.
fn set<T>(slot: &mut Option<T>, new: Option<T>) -> bool {
    let is_some = new.is_some();
    if is_some {
        *slot = new;
    }
    is_some
}

/// A value with the two escapes that NRRD has, `\n` and `\\`, undone.
fn unescaped(value: &[u8]) -> Option<String> {
    let value = std::str::from_utf8(value).ok()?;
    let mut text = String::with_capacity(value.len());
    let mut characters = value.chars();
    while let Some(character) = characters.next() {
        match (character, characters.as_str().chars().next()) {
            ('\\', Some('n')) => text.push('\n'),
            ('\\', Some('\\')) => text.push('\\'),
            _ => {
                text.push(character);
                continue;
            }
        }
        characters.next();
    }
    Some(text)
}

fn name(text: &str) -> Option<String> {
    let is_name = !text.is_empty() && text.chars().count() <= MAX_NAME_CHARS && !text.chars().any(char::is_control);
    is_name.then(|| text.to_owned())
}

/// Red, green and blue as shares of 1.
fn color(text: &str) -> Option<[u8; 3]> {
    let parts: Option<Vec<f64>> = text.split_ascii_whitespace().take(4).map(|word| word.parse().ok()).collect();
    let [red, green, blue] = parts?.try_into().ok()?;
    let parts: [f64; 3] = [red, green, blue];
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 255, and rounded")]
    let byte = |part: f64| (255.0 * part).round() as u8;
    parts.iter().all(|part| (0.0..=1.0).contains(part)).then(|| parts.map(byte))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn escapes_are_undone_and_other_backslashes_stay() {
        assert_eq!(unescaped(br"a\\nb\nc\d\").as_deref(), Some("a\\nb\nc\\d\\"));
        assert_eq!(unescaped(b"\xe4"), None);
    }
}
