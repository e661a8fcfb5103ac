//! How an attribute is matched (PS3.4 section C.2.2.2): by one value, a list of identifiers, a pattern, a range, or by
//! being asked for at all.

use serde_json::Value;

use super::entries::Entry;
use crate::formats::Uid;

/// Values of a list. A request line has room for a few hundred; each costs a look into the index.
const MAX_VALUES: usize = 256;

/// What the values of an attribute are compared with.
#[derive(Clone, Debug, PartialEq)]
pub enum Matcher {
    /// Whatever they are, and where there are none.
    Any,
    /// One of these identifiers.
    Uids(Vec<String>),
    /// One of these patterns.
    Patterns(Vec<Pattern>),
    /// A day from the first to the last, as eight digits.
    Days(Range<String>),
    /// A time of day from the first to the last, microseconds.
    Times(Range<u64>),
    /// This number.
    Number(i64),
}

/// From and to, both included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Range<T> {
    from: Option<T>,
    to: Option<T>,
}

impl<T: PartialOrd> Range<T> {
    fn has(&self, value: &T) -> bool {
        self.from.as_ref().is_none_or(|from| from <= value) && self.to.as_ref().is_none_or(|to| value <= to)
    }
}

/// Text with `*` for any letters and `?` for any one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    text: Vec<char>,
    /// Whether capitals are as good as small letters, as in names of people.
    ignores_case: bool,
}

impl Matcher {
    /// What a value of a query means for an attribute.
    ///
    /// # Errors
    /// With what it should be.
    pub fn of(entry: &Entry, text: &str) -> Result<Self, &'static str> {
        if text.is_empty() || (text.bytes().all(|byte| byte == b'*') && entry.kind != "UI") {
            return Ok(Self::Any);
        }
        match entry.kind {
            "UI" => uids(text),
            "DA" => days(text).map(Self::Days).ok_or("a day (20261129) or a range of them (20261101-20261129)"),
            "TM" => times(text).map(Self::Times).ok_or("a time (133000) or a range of them (08-1330)"),
            "IS" | "US" => text.trim().parse().map(Self::Number).map_err(|_| "a whole number"),
            "CS" => patterns(text.split([',', '\\']), false),
            "PN" => patterns([text].into_iter(), true),
            _ => patterns(text.split('\\'), false),
        }
    }

    /// Whether an attribute in JSON matches: one of its values at least.
    #[must_use]
    pub fn fits(&self, attribute: Option<&Value>) -> bool {
        if *self == Self::Any {
            return true;
        }
        let values = attribute.and_then(|own| own["Value"].as_array()).map(Vec::as_slice).unwrap_or_default();
        values.iter().flat_map(told).any(|value| self.fits_one(&value))
    }

    fn fits_one(&self, value: &str) -> bool {
        match self {
            Self::Any => true,
            Self::Uids(uids) => uids.iter().any(|uid| uid == value),
            Self::Patterns(patterns) => patterns.iter().any(|pattern| pattern.fits(value)),
            Self::Days(range) => day(value).is_some_and(|day| range.has(&day)),
            Self::Times(range) => time(value).is_some_and(|(from, _)| range.has(&from)),
            Self::Number(number) => value.parse() == Ok(*number),
        }
    }
}

/// A value as text: a name in each way that it is written, and in all together.
fn told(value: &Value) -> Vec<String> {
    match value {
        Value::String(text) => vec![text.clone()],
        Value::Object(groups) => {
            let group = |name: &str| groups.get(name).and_then(Value::as_str).unwrap_or_default();
            let groups = ["Alphabetic", "Ideographic", "Phonetic"].map(group);
            let mut texts: Vec<String> = groups.map(str::to_owned).to_vec();
            texts.push(groups.join("=").trim_end_matches('=').to_owned());
            texts
        }
        Value::Null => Vec::new(),
        other => vec![other.to_string()],
    }
}

fn uids(text: &str) -> Result<Matcher, &'static str> {
    let uids: Vec<Uid> = text.split([',', '\\']).map_while(|uid| Uid::parse(uid.trim())).collect();
    let has_all = uids.len() == text.split([',', '\\']).count() && uids.len() <= MAX_VALUES;
    let uids = uids.iter().map(|uid| uid.as_str().to_owned()).collect();
    if has_all { Ok(Matcher::Uids(uids)) } else { Err("a UID, or up to 256 of them with commas between") }
}

fn patterns<'a>(texts: impl Iterator<Item = &'a str>, ignores_case: bool) -> Result<Matcher, &'static str> {
    let patterns: Vec<Pattern> = texts.map(|text| Pattern::new(text, ignores_case)).collect();
    if patterns.len() <= MAX_VALUES { Ok(Matcher::Patterns(patterns)) } else { Err("at most 256 values") }
}

/// What stands before and behind the hyphen of a range; the same twice where there is none.
fn ends(text: &str) -> (&str, &str) {
    text.split_once('-').unwrap_or((text, text))
}

/// A range whose ends are read so; one of them may be open.
fn range<T>(text: &str, read: impl Fn(&str) -> Option<T>) -> Option<(Option<T>, Option<T>)> {
    let (from, to) = ends(text);
    let end = |text: &str| if text.is_empty() { Some(None) } else { read(text).map(Some) };
    let (from, to) = (end(from)?, end(to)?);
    (from.is_some() || to.is_some()).then_some((from, to))
}

fn days(text: &str) -> Option<Range<String>> {
    let (from, to) = range(text, day)?;
    Some(Range { from, to })
}

/// A day as eight digits.
fn day(text: &str) -> Option<String> {
    let is_number = text.len() == 8 && text.bytes().all(|byte| byte.is_ascii_digit());
    let part = |from: usize, to: usize| text.get(from..to).and_then(|part| part.parse::<u8>().ok());
    let is_day = is_number && (1..=12).contains(&part(4, 6)?) && (1..=31).contains(&part(6, 8)?);
    is_day.then(|| text.to_owned())
}

fn times(text: &str) -> Option<Range<u64>> {
    let (from, to) = range(text, time)?;
    Some(Range { from: from.map(|(first, _)| first), to: to.map(|(_, last)| last) })
}

/// The first and the last microsecond of the day that a time may mean: `13` is an hour, `1330` a minute.
fn time(text: &str) -> Option<(u64, u64)> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let has_room = matches!((whole.len(), fraction.len()), (2 | 4, 0) | (6, 0..=6));
    if !has_room || !is_number(whole) || !is_number(fraction) || (text.contains('.') && fraction.is_empty()) {
        return None;
    }
    let part = |at: usize| whole.get(at..at + 2).map_or(Some(0), |part| part.parse::<u64>().ok());
    let (hours, minutes, seconds) = (part(0)?, part(2)?, part(4)?);
    if hours > 23 || minutes > 59 || seconds > 60 {
        return None;
    }
    let micros: u64 = format!("{fraction:0<6}").parse().ok()?;
    let length_us = match (whole.len(), fraction.len()) {
        (2, _) => 3_600_000_000,
        (4, _) => 60_000_000,
        (_, digits) => 10_u64.pow(6 - u32::try_from(digits).ok()?),
    };
    let first = ((hours * 60 + minutes) * 60 + seconds) * 1_000_000 + micros;
    Some((first, first + length_us - 1))
}

impl Pattern {
    fn new(text: &str, ignores_case: bool) -> Self {
        Self { text: folded(text, ignores_case), ignores_case }
    }

    /// Whether all of a text is as the pattern says. Takes as long as both are at the most, times each other.
    fn fits(&self, text: &str) -> bool {
        let text = folded(text, self.ignores_case);
        let (mut at, mut here) = (0, 0);
        // Where the last star stands, and what of the text it has taken.
        let mut star: Option<(usize, usize)> = None;
        while here < text.len() {
            match self.text.get(at) {
                Some('*') => {
                    star = Some((at, here));
                    at += 1;
                }
                Some(own) if *own == '?' || text.get(here) == Some(own) => {
                    at += 1;
                    here += 1;
                }
                _ => {
                    let Some((place, taken)) = star else { return false };
                    star = Some((place, taken + 1));
                    (at, here) = (place + 1, taken + 1);
                }
            }
        }
        self.text.iter().skip(at).all(|left| *left == '*')
    }
}

/// Without what fills a name up behind its last part, and in small letters where capitals do not count.
fn folded(text: &str, ignores_case: bool) -> Vec<char> {
    let text = text.trim_matches(' ');
    if ignores_case { text.trim_end_matches('^').to_lowercase().chars().collect() } else { text.chars().collect() }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;
    use crate::dicomweb::entries::by_name;

    fn fits(keyword: &str, key: &str, values: &Value) -> bool {
        let entry = by_name(keyword).expect("a known one");
        Matcher::of(entry, key).expect("a good key").fits(Some(&json!({"vr": entry.kind, "Value": values})))
    }

    #[test]
    fn texts_are_matched_by_patterns() {
        for (key, is_found) in [
            ("CT-7", true),
            ("ct-7", false),
            ("C*", true),
            ("*7", true),
            ("C?-7", true),
            ("*T*-*7*", true),
            ("?", false),
            ("C*8", false),
            ("CT-7?", false),
            ("", true),
            ("**", true),
            ("X\\CT-7", true),
        ] {
            assert_eq!(fits("PatientID", key, &json!(["CT-7"])), is_found, "{key}");
        }
        assert!(fits("PatientID", "*", &json!([])) && !fits("PatientID", "?*", &json!([])));
        // What would take for ever where each star is tried with each.
        let stars = "*a".repeat(30) + "b";
        assert!(!fits("PatientID", &stars, &json!(["a".repeat(64)])));
    }

    #[test]
    fn names_are_matched_in_each_way_to_write_them_and_in_any_case() {
        let name = json!([{"Alphabetic": "Müller^Jörg", "Ideographic": "山田"}]);
        for (key, is_found) in [
            ("MÜLLER^JÖRG", true),
            ("müller*", true),
            ("Müller^Jörg^^", true),
            ("山田", true),
            ("Müller^Jörg=山田", true),
            ("Müller", false),
            ("Jörg*", false),
        ] {
            assert_eq!(fits("PatientName", key, &name), is_found, "{key}");
        }
    }

    #[test]
    fn days_times_and_numbers_are_matched_by_what_they_mean() {
        for (keyword, key, value, is_found) in [
            ("StudyDate", "20261129", "20261129", true),
            ("StudyDate", "20261101-20261129", "20261129", true),
            ("StudyDate", "20261130-", "20261129", false),
            ("StudyDate", "-20261128", "20261129", false),
            ("StudyDate", "20261101-", "", false),
            ("StudyTime", "13", "133059.5", true),
            ("StudyTime", "1330-1331", "133059.5", true),
            ("StudyTime", "133059.5", "133059.50", true),
            ("StudyTime", "-133059", "133100", false),
            ("SeriesNumber", "9003", "9003", true),
            ("SeriesNumber", "900", "9003", false),
            ("Modality", "CT,SR", "SR", true),
            ("SeriesInstanceUID", "1.2,1.3", "1.3", true),
            ("SeriesInstanceUID", "1.2", "1.2.3", false),
        ] {
            assert_eq!(fits(keyword, key, &json!([value])), is_found, "{keyword} {key}");
        }
    }

    #[test]
    fn keys_that_are_none_are_refused() {
        for (keyword, key) in [
            ("StudyDate", "2026"),
            ("StudyDate", "20261301"),
            ("StudyDate", "-"),
            ("StudyDate", "2026*"),
            ("StudyTime", "25"),
            ("StudyTime", "1330."),
            ("StudyTime", "133"),
            ("SeriesNumber", "x"),
            ("StudyInstanceUID", "1.2,"),
            ("StudyInstanceUID", "1.2.*"),
            ("StudyInstanceUID", "*"),
        ] {
            assert!(Matcher::of(by_name(keyword).expect("a known one"), key).is_err(), "{keyword} {key}");
        }
    }
}
