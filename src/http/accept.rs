//! Media types that a client accepts, with their parameters (RFC 9110, section 12.5.1; PS3.18 section 8.7.3).

use axum::http::HeaderMap;
use axum::http::header::ACCEPT;

use super::extract::{list_header, media_range};
use crate::media_type::parameter;

/// What a client accepts.
#[derive(Clone, Debug)]
pub struct Accepted(Vec<Range>);

/// One media range of a list.
#[derive(Clone, Debug)]
pub struct Range {
    /// In lower case, without parameters.
    kind: String,
    text: String,
    /// How much it is wanted, from 0 to 1.
    weight: f32,
}

impl Accepted {
    /// What the parameter `accept` of the query says, else the header; anything where neither is there.
    pub fn of(headers: &HeaderMap, query: &[(String, String)]) -> Self {
        let asked: Vec<&str> =
            query.iter().filter(|(name, _)| name == "accept").map(|(_, value)| value.as_str()).collect();
        let list = if asked.is_empty() { list_header(headers, ACCEPT) } else { asked.join(",") };
        let ranges = split(&list).into_iter().map(|text| {
            let (kind, weight) = media_range(text);
            Range { kind, text: text.to_owned(), weight }
        });
        let mut ranges: Vec<Range> = ranges.filter(|range| !range.kind.is_empty()).collect();
        if ranges.is_empty() {
            ranges.push(Range { kind: "*/*".to_owned(), text: String::new(), weight: 1.0 });
        }
        Self(ranges)
    }

    /// How much something is wanted that some ranges stand for: as the narrowest of them says, the most of several such; 0
    /// where it is not accepted.
    pub fn weight(&self, fits: impl Fn(&Range) -> bool) -> f32 {
        let of = |stars: usize| self.0.iter().filter(move |range| range.kind.matches('*').count() == stars);
        let weights = |stars| of(stars).filter(|range| fits(range)).map(|range| range.weight).reduce(f32::max);
        (0..=2).find_map(weights).unwrap_or(0.0)
    }

    /// Whether a media type is accepted.
    pub fn has(&self, media_type: &str) -> bool {
        self.weight(|range| range.covers(media_type)) > 0.0
    }
}

impl Range {
    /// Whether the range is this media type or one of many of which it is one.
    pub fn covers(&self, media_type: &str) -> bool {
        covers(&self.kind, media_type)
    }

    /// Whether the parts of what is covered may be of this media type: their range, where one is given, is in a
    /// parameter.
    pub fn has_parts(&self, media_type: &str) -> bool {
        parameter(&self.text, "type").is_none_or(|own| covers(&own.to_ascii_lowercase(), media_type))
    }

    /// Whether the range is this media type and no other.
    pub fn is(&self, media_type: &str) -> bool {
        self.kind == media_type
    }

    /// Whether a parameter is not given, or is this.
    pub fn lets(&self, name: &str, value: &str) -> bool {
        parameter(&self.text, name).is_none_or(|own| own.eq_ignore_ascii_case(value))
    }
}

fn covers(range: &str, media_type: &str) -> bool {
    let group = media_type.split('/').next().unwrap_or_default();
    range == media_type || range == "*/*" || range.strip_suffix("/*") == Some(group)
}

/// The members of a list; commas in quotes part nothing.
fn split(list: &str) -> Vec<&str> {
    let (mut members, mut begin, mut is_quoted) = (Vec::new(), 0, false);
    for (place, letter) in list.char_indices() {
        match letter {
            '"' => is_quoted = !is_quoted,
            ',' if !is_quoted => {
                members.push(list[begin..place].trim());
                begin = place + 1;
            }
            _ => {}
        }
    }
    members.push(list[begin..].trim());
    members
}

#[cfg(test)]
mod tests {
    use super::*;

    fn accepted(list: &str) -> Accepted {
        let headers = [(ACCEPT, list.parse().unwrap())].into_iter().collect();
        Accepted::of(&headers, &[])
    }

    #[test]
    fn ranges_are_told_apart_with_their_parameters() {
        let list = accepted("multipart/related; type=\"a/b, c\"; q=0.5, Application/DICOM;q=0.2 , text/*;q=0");
        assert_eq!(list.0.len(), 3);
        assert!((list.weight(|range| range.covers("multipart/related")) - 0.5).abs() < 1e-6);
        assert!(list.has("application/dicom") && !list.has("text/html") && !list.has("image/png"));
        let list_but_one = accepted("text/html;q=0, text/*;q=0.5, */*");
        assert!(!list_but_one.has("text/html") && list_but_one.has("text/csv") && list_but_one.has("image/png"));
        assert!(list.0[0].has_parts("a/b, c") && !list.0[0].has_parts("x/y") && list.0[0].lets("other", "x"));
        for (range, is_covered) in [("*/*", true), ("Application/*", true), ("image/*", false)] {
            let list = accepted(&format!("multipart/related; type=\"{range}\""));
            assert_eq!(list.0[0].has_parts("application/dicom"), is_covered, "{range}");
        }
    }

    #[test]
    fn anything_is_accepted_where_nothing_is_said_and_the_query_goes_before_the_header() {
        assert!(accepted("").has("image/png") && Accepted::of(&HeaderMap::new(), &[]).has("image/png"));
        let headers = [(ACCEPT, "image/png".parse().unwrap())].into_iter().collect();
        let query = [("accept".to_owned(), "application/dicom".to_owned())];
        let both = Accepted::of(&headers, &query);
        assert!(both.has("application/dicom") && !both.has("image/png"));
    }
}
