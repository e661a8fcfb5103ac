//! Any bytes as parameters: what is accepted comes back the same, what is refused is told in a
//! short line.

use medialrep::formats::params_json::{params_to_json, parse};
use medialrep::problem::Problem;

/// No part of a refusal repeats more of the input than this.
const MAX_TEXT: usize = 1000;

/// What must hold of any bytes.
pub fn check(bytes: &[u8]) {
    match parse(bytes) {
        Ok(params) => {
            let json = params_to_json(&params).to_string();
            assert_eq!(parse(json.as_bytes()).as_ref(), Ok(&params), "{json}");
        }
        Err(error) => {
            let problem = Problem::from(&error);
            assert!(matches!(problem.status, 400 | 422), "{problem:?}");
            for text in [Some(problem.detail), problem.location, problem.hint].into_iter().flatten() {
                assert!(text.len() <= MAX_TEXT && !text.contains(char::is_control), "{text:?}");
            }
        }
    }
}
