//! Rules about Rust sources: `unsafe`, forbidden words, module documentation, length.

use super::Violation;
use super::mask::code_only;
use super::tree::TextFile;

/// Folders in which `unsafe` is allowed.
const UNSAFE_FOLDERS: &[&str] = &["crates/swm-envs-mujoco/src/ffi/"];

/// What no source holds, and what to do instead.
const FORBIDDEN: &[(&str, &str)] = &[
    ("todo!", "finish it, or leave it out"),
    ("unimplemented!", "finish it, or leave it out"),
    ("dbg!", "remove it"),
    ("#[ignore", "a test that cannot run here says so and passes, or fails"),
    ("#[allow", "write #[expect(lint, reason = \"…\")]"),
    ("#![allow", "write #![expect(lint, reason = \"…\")]"),
];

/// `unsafe` outside of the folders where it is allowed.
pub(super) fn misplaced_unsafe(files: &[TextFile]) -> Vec<Violation> {
    let elsewhere =
        sources(files).filter(|file| !UNSAFE_FOLDERS.iter().any(|folder| file.path.starts_with(folder)));
    elsewhere
        .flat_map(|file| find(file, "unsafe"))
        .map(|place| {
            Violation::new(place, format!("`unsafe` is allowed only in {}", UNSAFE_FOLDERS.join(", ")))
        })
        .collect()
}

/// Unfinished, ignored or silenced code.
pub(super) fn forbidden_words(files: &[TextFile]) -> Vec<Violation> {
    let mut violations = Vec::new();
    for file in sources(files) {
        for (word, advice) in FORBIDDEN {
            violations.extend(
                find(file, word)
                    .into_iter()
                    .map(|place| Violation::new(place, format!("`{word}`: {advice}"))),
            );
        }
    }
    violations
}

/// Files that do not begin by saying what they are.
pub(super) fn missing_module_docs(files: &[TextFile]) -> Vec<Violation> {
    let is_documented = |file: &&TextFile| {
        file.text
            .strip_prefix("//!")
            .is_some_and(|rest| rest.lines().next().is_some_and(|line| !line.trim().is_empty()))
    };
    sources(files)
        .filter(|file| !is_documented(file))
        .map(|file| {
            Violation::new(
                format!("{}:1", file.path),
                "begin with `//!`: what the file is, and what it is not",
            )
        })
        .collect()
}

/// Files of more than `limit` lines.
pub(super) fn longer_than(files: &[TextFile], limit: usize) -> Vec<Violation> {
    sources(files)
        .map(|file| (file, file.text.lines().count()))
        .filter(|(_, lines)| *lines > limit)
        .map(|(file, lines)| {
            Violation::new(
                &file.path,
                format!("{lines} lines, more than {limit}: give each duty a file of its own"),
            )
        })
        .collect()
}

fn sources(files: &[TextFile]) -> impl Iterator<Item = &TextFile> {
    files.iter().filter(|file| file.path.ends_with(".rs"))
}

/// `path:line` of each place where the code (no comment, no literal) holds the word as a whole.
fn find(file: &TextFile, word: &str) -> Vec<String> {
    if !file.text.contains(word) {
        return Vec::new();
    }
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let is_whole = |line: &str, at: usize| {
        let (before, after) = (line[..at].chars().next_back(), line[at + word.len()..].chars().next());
        let joins =
            |own: Option<char>, other: Option<char>| own.is_some_and(is_word) && other.is_some_and(is_word);
        !joins(word.chars().next(), before) && !joins(word.chars().next_back(), after)
    };
    let code = code_only(&file.text);
    let lines = code.lines().enumerate();
    lines
        .filter(|(_, line)| line.match_indices(word).any(|(at, _)| is_whole(line, at)))
        .map(|(index, _)| format!("{}:{}", file.path, index + 1))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(violations: Vec<Violation>) -> Vec<String> {
        violations.into_iter().map(|violation| violation.place).collect()
    }

    #[test]
    fn unsafe_code_is_found_outside_of_its_folder() {
        let text =
            "//! Speaks of unsafe code.\n#![forbid(unsafe_code)]\nfn f() { unsafe { g(\"unsafe\") } }\n";
        let files = [
            TextFile::new("crates/swm/src/a.rs", text),
            TextFile::new("crates/swm-envs-mujoco/src/ffi/calls.rs", text),
            TextFile::new("docs/a.md", "unsafe"),
        ];
        assert_eq!(places(misplaced_unsafe(&files)), ["crates/swm/src/a.rs:3"]);
    }

    #[test]
    fn forbidden_words_are_found_in_code_only() {
        let text = "//! No todo!() here.\nfn f() { todo!() }\n#[ignore = \"slow\"]\n#[allow(dead_code)]\n\
                    fn g() { let x = \"dbg!(y)\"; my_dbg!(x); }\nfn h() { dbg!(1); unimplemented!(\"x\") }\n";
        let files = [TextFile::new("a.rs", text)];
        assert_eq!(places(forbidden_words(&files)), ["a.rs:2", "a.rs:6", "a.rs:6", "a.rs:3", "a.rs:4"]);
    }

    #[test]
    fn a_file_begins_with_what_it_is() {
        let files = [
            TextFile::new("good.rs", "//! What it is.\n"),
            TextFile::new("empty.rs", ""),
            TextFile::new("blank.rs", "//!\n//! Late.\n"),
            TextFile::new("late.rs", "use std::fs;\n//! What it is.\n"),
            TextFile::new("readme.md", ""),
        ];
        assert_eq!(places(missing_module_docs(&files)), ["empty.rs:1", "blank.rs:1", "late.rs:1"]);
    }

    #[test]
    fn long_files_are_found_above_the_limit() {
        let files =
            [TextFile::new("at.rs", &"x\n".repeat(400)), TextFile::new("over.rs", &"x\n".repeat(401))];
        let found = longer_than(&files, 400);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].place, "over.rs");
        assert!(found[0].message.starts_with("401 lines"));
    }
}
