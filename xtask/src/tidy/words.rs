//! The vocabulary: words that the project replaced by those of the field do not come back. The list is `words.toml`.

use std::collections::BTreeMap;

use serde::Deserialize;

use super::Violation;
use super::tree::TextFile;

/// The list, from the root.
const LIST: &str = "xtask/src/tidy/words.toml";

/// Files that the rule reads, by their ending.
const ENDINGS: &[&str] = &[".rs", ".md", ".toml", ".py", ".html"];

/// Files that the rule does not read: the list and this file, and recorded data.
const EXEMPT: &[&str] = &["xtask/src/tidy/words.", "tests/golden/"];

#[derive(Deserialize)]
struct List {
    /// Patterns, separated by commas, and what to write instead.
    replaced: BTreeMap<String, String>,
    allowed: Vec<Allowed>,
}

/// Where a replaced word is right.
#[derive(Deserialize)]
struct Allowed {
    /// Patterns of the list, separated by commas; empty: all.
    #[serde(default)]
    words: String,
    /// How the path of the file begins.
    #[serde(default)]
    path: String,
    /// What the line holds.
    #[serde(default)]
    line: String,
    reason: String,
}

/// Every use of a replaced word, and every allowance that nothing needs.
pub(super) fn replaced(files: &[TextFile]) -> Vec<Violation> {
    let list: Result<List, _> = toml::from_str(include_str!("words.toml"));
    list.map_or_else(|error| vec![Violation::new(LIST, error.to_string())], |list| check(&list, files))
}

fn check(list: &List, files: &[TextFile]) -> Vec<Violation> {
    let patterns: Vec<(&str, &str)> = list
        .replaced
        .iter()
        .flat_map(|(key, advice)| split(key).map(move |pattern| (pattern, advice.as_str())))
        .collect();
    let mut is_needed = vec![false; list.allowed.len()];
    let mut violations = Vec::new();
    let is_read = |path: &str| {
        ENDINGS.iter().any(|end| path.ends_with(end)) && !EXEMPT.iter().any(|start| path.starts_with(start))
    };
    for file in files.iter().filter(|file| is_read(&file.path)) {
        // The name of the file is line 0.
        for (number, line) in std::iter::once(file.path.as_str()).chain(file.text.lines()).enumerate() {
            let words = words(line);
            for (pattern, advice) in patterns.iter().filter(|(pattern, _)| holds(&words, pattern)) {
                let allows = |allowed: &Allowed| {
                    file.path.starts_with(&allowed.path)
                        && line.contains(&allowed.line)
                        && (allowed.words.is_empty() || split(&allowed.words).any(|word| word == *pattern))
                };
                match list.allowed.iter().position(allows) {
                    Some(index) => is_needed[index] = true,
                    None => violations.push(Violation::new(
                        format!("{}:{number}", file.path),
                        format!("`{pattern}`: write {advice}; where the word is right, allow it in {LIST}"),
                    )),
                }
            }
        }
    }
    let stale = list.allowed.iter().zip(is_needed).filter(|(_, is_needed)| !is_needed);
    violations.extend(stale.map(|(Allowed { words, reason, .. }, _)| {
        Violation::new(LIST, format!("no line needs that `{words}` is allowed as {reason}: remove it"))
    }));
    violations
}

fn split(patterns: &str) -> impl Iterator<Item = &str> {
    patterns.split(',').map(str::trim)
}

/// Whether successive words match a pattern: words as they stand, or beginnings that end with `*`.
fn holds(words: &[String], pattern: &str) -> bool {
    let parts: Vec<&str> = pattern.split(' ').collect();
    let is_match = |(word, part): (&String, &&str)| match part.strip_suffix('*') {
        Some(start) => word.starts_with(start),
        None => word == part,
    };
    words.windows(parts.len()).any(|window| window.iter().zip(&parts).all(is_match))
}

/// The words of a line in lower case; `snake_case`, `camelCase` and `HTMLPage` are two each.
fn words(line: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut chars = line.chars().peekable();
    let mut before = ' ';
    while let Some(c) = chars.next() {
        let begins_word = c.is_uppercase()
            && (before.is_lowercase()
                || (before.is_uppercase() && chars.peek().is_some_and(|c| c.is_lowercase())));
        if (begins_word || !c.is_alphabetic()) && words.last().is_some_and(|word| !word.is_empty()) {
            words.push(String::new());
        }
        if c.is_alphabetic() {
            words.last_mut().expect("never empty").extend(c.to_lowercase());
        }
        before = c;
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        [replaced]
        "film, films" = "video"
        "normalis*" = "normalize"
        "way out" = "the fix"

        [[allowed]]
        words = "film"
        path = "docs/cinema"
        line = "a film of soap"
        reason = "a thin layer"
    "#;

    #[track_caller]
    fn places(files: &[(&str, &str)]) -> Vec<String> {
        let files: Vec<TextFile> = files.iter().map(|(path, text)| TextFile::new(path, text)).collect();
        let found = check(&toml::from_str(TEXT).unwrap(), &files);
        found
            .into_iter()
            .filter(|violation| violation.place != LIST)
            .map(|violation| violation.place)
            .collect()
    }

    #[test]
    fn words_are_found_in_identifiers_text_and_file_names() {
        let text = "fn makeFilm() {}\nlet num_films = 1; // plain\n\"Normalising\" FILM\nfilmy, abnormalised\nThe way  out!";
        assert_eq!(
            places(&[("a.rs", text), ("a.txt", text)]),
            ["a.rs:1", "a.rs:2", "a.rs:3", "a.rs:3", "a.rs:5"]
        );
        assert_eq!(places(&[("src/film.rs", "//! A clip.")]), ["src/film.rs:0"]);
        assert_eq!(places(&[("tests/golden/film.md", "film")]), [""; 0]);
    }

    #[test]
    fn an_allowance_holds_for_its_files_and_lines() {
        assert_eq!(places(&[("docs/cinema.md", "a film of soap\na film")]), ["docs/cinema.md:2"]);
        assert_eq!(places(&[("docs/other.md", "a film of soap")]), ["docs/other.md:1"]);
    }

    #[test]
    fn an_allowance_that_nothing_needs_is_reported() {
        let found = check(&toml::from_str(TEXT).unwrap(), &[]);
        assert!(found[0].message.contains("`film` is allowed as a thin layer: remove it"), "{found:?}");
    }

    #[test]
    fn identifiers_are_split_into_words() {
        assert_eq!(words("HTMLPage, num_rows2x camelCase").join(" "), "html page num rows x camel case");
    }
}
