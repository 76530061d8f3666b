//! Rust sources with comments and literals blanked out, so that a search finds code and nothing else.
//!
//! Not a parser: it knows only where comments, strings and characters begin and end.

/// The source with every character of a comment, string or character literal replaced by a blank; lines stay.
pub(super) fn code_only(source: &str) -> String {
    let chars: Vec<char> = source.chars().collect();
    let mut out = String::with_capacity(source.len());
    let mut at = 0;
    while at < chars.len() {
        let end = hidden_end(&chars, at);
        if end == at {
            out.push(chars[at]);
            at += 1;
            continue;
        }
        out.extend(chars[at..end].iter().map(|&c| if c == '\n' { c } else { ' ' }));
        at = end;
    }
    out
}

/// The source with every character outside of string literals, comments included, replaced by a blank; lines stay.
pub(super) fn literals_only(source: &str) -> String {
    let chars: Vec<char> = source.chars().collect();
    let mut out = String::with_capacity(source.len());
    let mut at = 0;
    while at < chars.len() {
        let end = hidden_end(&chars, at).max(at + 1);
        let is_literal = matches!(chars[at], '"' | 'r') && end > at + 1;
        out.extend(chars[at..end].iter().map(|&c| if c == '\n' || is_literal { c } else { ' ' }));
        at = end;
    }
    out
}

/// Where the comment or literal that begins at `at` ends; `at` itself where none begins.
fn hidden_end(chars: &[char], at: usize) -> usize {
    let rest = &chars[at..];
    match rest {
        ['/', '/', ..] => at + rest.iter().position(|&c| c == '\n').unwrap_or(rest.len()),
        ['/', '*', ..] => at + block_comment_len(rest),
        ['"', ..] => at + quoted_len(rest, '"'),
        ['\'', '\\', ..] | ['\'', _, '\'', ..] => at + quoted_len(rest, '\''),
        ['r', '"' | '#', ..] if !is_inside_word(chars, at) => at + raw_string_len(rest),
        _ => at,
    }
}

/// A prefix such as the `b` of `br"…"` does not make the `r` part of a word.
fn is_inside_word(chars: &[char], at: usize) -> bool {
    let is_word = |index: usize| chars.get(index).is_some_and(|c| c.is_alphanumeric() || *c == '_');
    match at.checked_sub(1) {
        None => false,
        Some(before) if matches!(chars[before], 'b' | 'c') => before.checked_sub(1).is_some_and(is_word),
        Some(before) => is_word(before),
    }
}

fn block_comment_len(rest: &[char]) -> usize {
    let (mut depth, mut at) = (0, 0);
    while at < rest.len() {
        match rest[at..] {
            ['/', '*', ..] => (depth, at) = (depth + 1, at + 2),
            ['*', '/', ..] if depth == 1 => return at + 2,
            ['*', '/', ..] => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
    }
    rest.len()
}

fn quoted_len(rest: &[char], quote: char) -> usize {
    let mut at = 1;
    while at < rest.len() {
        match rest[at] {
            '\\' => at += 2,
            c if c == quote => return at + 1,
            _ => at += 1,
        }
    }
    rest.len()
}

/// Zero for a raw identifier such as `r#type`.
fn raw_string_len(rest: &[char]) -> usize {
    let hashes = rest[1..].iter().take_while(|&&c| c == '#').count();
    if rest.get(1 + hashes) != Some(&'"') {
        return 0;
    }
    let body = 2 + hashes;
    let closes = |at: &usize| {
        rest[*at] == '"' && rest[at + 1..].iter().take(hashes).filter(|&&c| c == '#').count() == hashes
    };
    (body..rest.len()).find(closes).map_or(rest.len(), |at| at + 1 + hashes)
}

#[cfg(test)]
mod tests {
    use super::{code_only, literals_only};

    /// Blanks are squeezed so that the expectation is readable.
    #[track_caller]
    fn check(source: &str, expected: &str) {
        let masked = code_only(source);
        assert_eq!(masked.lines().count(), source.lines().count());
        assert_eq!(masked.split_whitespace().collect::<Vec<_>>().join(" "), expected);
    }

    #[test]
    fn comments_vanish_and_lines_stay() {
        check("a // b\nc /* d\n /* e */ f\n*/ g", "a c g");
        check("a / b", "a / b");
        check("/* open", "");
    }

    #[test]
    fn strings_vanish_with_their_escapes() {
        check(r#"a("x \" y") b"#, "a( ) b");
        check(r##"a(r#"x " y"#, br"\") b"##, "a( , b ) b");
        check("a \"// no comment\" b", "a b");
    }

    #[test]
    fn lifetimes_and_raw_identifiers_are_code() {
        check("fn f<'a>(x: &'a str) -> r#type { }", "fn f<'a>(x: &'a str) -> r#type { }");
        check("('x', '\\'', '\"', b'u') z", "( , , , b ) z");
    }

    #[test]
    fn literals_stay_alone() {
        let found = literals_only("f(\"a\", 'b', r#\"c \" d\"#) // \"e\"\n/* \"f\" */ r#type \"g\n \\\"h\"");
        assert_eq!(found.lines().count(), 3);
        assert_eq!(found.split_whitespace().collect::<Vec<_>>().join(" "), r##""a" r#"c " d"# "g \"h""##);
    }

    #[test]
    fn a_word_that_ends_in_r_is_no_prefix() {
        check(r#"bar"x" y"#, "bar y");
    }
}
