//! What stands behind the semicolons of a header.

/// The parameter `wanted` of a header like Content-Disposition: names in any case, values as tokens or quoted (RFC 9110,
/// section 5.6.6).
pub fn parameter(text: &str, wanted: &str) -> Option<String> {
    let mut rest = text;
    loop {
        let place = rest.find([';', '"'])?;
        // A quoted value holds no parameter.
        if rest[place..].starts_with('"') {
            rest = quoted(&rest[place..])?.1;
            continue;
        }
        rest = rest[place + 1..].trim_start();
        // One without a value ends before the next: looked for further on, many of them would cost the square of their number.
        let end = rest.find(['=', ';'])?;
        let (name, value) = (&rest[..end], &rest[end..]);
        let Some(value) = value.strip_prefix('=') else {
            rest = value;
            continue;
        };
        if name.trim_end().eq_ignore_ascii_case(wanted) {
            let value = value.trim_start();
            if value.starts_with('"') {
                return quoted(value).map(|(text, _)| text);
            }
            return Some(value.split(';').next().unwrap_or_default().trim_end().to_owned());
        }
    }
}

/// What a quoted string says, and what follows it.
fn quoted(text: &str) -> Option<(String, &str)> {
    let (mut said, mut is_escaped) = (String::new(), false);
    for (place, c) in text.char_indices().skip(1) {
        match c {
            '"' if !is_escaped => return Some((said, &text[place + 1..])),
            '\\' if !is_escaped => is_escaped = true,
            c => {
                said.push(c);
                is_escaped = false;
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_parsed_and_not_searched_for() {
        for (text, name) in [
            ("form-data; name=\"mask\"; filename=\"m.nii.gz\"", Some("mask")),
            ("form-data; Name=\"mask\"; FileName=\"m\"", Some("mask")),
            ("form-data; filename=\"x; name=evil.nii\"; name=\"mask\"", Some("mask")),
            ("form-data; filename=\"x\\\"; name=evil\"; name = mask ; x=y", Some("mask")),
            ("form-data; filename=\"name=mask\"", None),
            ("form-data; name=\"mask", None),
            ("form-data", None),
            (";;;", None),
            (";x;name=mask", Some("mask")),
            ("form-data; a; name = mask; b", Some("mask")),
        ] {
            assert_eq!(parameter(text, "name").as_deref(), name, "{text}");
        }
        assert_eq!(parameter(&";".repeat(1 << 24), "name"), None, "in no time");
    }
}
