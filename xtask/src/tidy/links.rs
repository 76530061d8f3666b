//! Rules about the pages: links lead somewhere, and the book has them all.

use std::collections::{BTreeMap, BTreeSet};

use super::Violation;
use super::tree::TextFile;

/// The book's table of contents.
const SUMMARY: &str = "docs/SUMMARY.md";

/// Relative links to files or folders that are not there, or to headings that their page does not have.
pub(super) fn broken(files: &[TextFile], paths: &[(String, u64)]) -> Vec<Violation> {
    let folders = paths.iter().flat_map(|(path, _)| path.match_indices('/').map(|(at, _)| &path[..at]));
    let there: BTreeSet<&str> = paths.iter().map(|(path, _)| path.as_str()).chain(folders).collect();
    let pages: BTreeMap<&str, BTreeSet<String>> =
        markdown(files).map(|page| (page.path.as_str(), headings(&page.text))).collect();
    let mut violations = Vec::new();
    for page in markdown(files) {
        for (line, link) in links(&page.text) {
            let (path, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = if path.is_empty() { page.path.clone() } else { resolve(&page.path, path) };
            let message = if !there.contains(target.as_str()) {
                format!("`{link}` leads nowhere: there is no {target}")
            } else if !heading.is_empty()
                && pages.get(target.as_str()).is_some_and(|all| !all.contains(heading))
            {
                format!("`{link}` leads to a heading that {target} does not have")
            } else {
                continue;
            };
            violations.push(Violation::new(format!("{}:{line}", page.path), message));
        }
    }
    violations
}

/// Pages below `docs/` that the table of contents does not name.
pub(super) fn not_in_the_book(files: &[TextFile]) -> Vec<Violation> {
    let summary = files.iter().find(|file| file.path == SUMMARY).map_or("", |file| file.text.as_str());
    let named: BTreeSet<String> = links(summary).map(|(_, link)| resolve(SUMMARY, link)).collect();
    let missing = markdown(files)
        .filter(|page| page.path.starts_with("docs/") && page.path != SUMMARY && !named.contains(&page.path));
    missing.map(|page| Violation::new(page.path.as_str(), format!("give it a line in {SUMMARY}"))).collect()
}

fn markdown(files: &[TextFile]) -> impl Iterator<Item = &TextFile> {
    files.iter().filter(|file| file.path.ends_with(".md"))
}

/// Line number and target of every relative link outside of code.
fn links(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut in_code = false;
    text.lines().enumerate().flat_map(move |(index, line)| {
        in_code ^= line.trim_start().starts_with("```");
        let parts = if in_code { "" } else { line };
        let inline = parts.split("](").skip(1).filter_map(|rest| rest.split([')', ' ']).next());
        let defined =
            parts.strip_prefix('[').and_then(|rest| rest.split_once("]: ")).map(|(_, target)| target);
        inline.chain(defined).filter(|target| is_relative(target)).map(move |target| (index + 1, target))
    })
}

fn is_relative(target: &str) -> bool {
    !target.is_empty() && !target.contains("://") && !target.starts_with("mailto:") && !target.contains("{{")
}

/// A link of the page `from`, as a path from the root.
fn resolve(from: &str, link: &str) -> String {
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in link.split('#').next().unwrap_or_default().trim_end_matches('/').split('/') {
        match part {
            "." | "" => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

/// What links to the headings of a page look like: lower case, words joined by `-`, punctuation dropped.
fn headings(text: &str) -> BTreeSet<String> {
    let mut in_code = false;
    let heads = text.lines().filter(|line| {
        in_code ^= line.trim_start().starts_with("```");
        !in_code && line.starts_with('#')
    });
    let slug = |line: &str| {
        let kept = line.trim_start_matches('#').trim().to_lowercase();
        let kept = kept.chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    };
    heads.map(slug).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(pages: &[(&str, &str)]) -> Vec<String> {
        let files: Vec<_> = pages.iter().map(|(path, text)| TextFile::new(path, text)).collect();
        let paths: Vec<_> = pages.iter().map(|(path, _)| ((*path).to_owned(), 1)).collect();
        broken(&files, &paths).into_iter().map(|violation| violation.place).collect()
    }

    #[test]
    fn links_to_files_folders_and_headings_hold() {
        let text = "[a](docs/a.md) [a](docs/a.md#the-first-part-of-2) [d](docs) [e](https://example.com/x.md)\n[r]: docs/a.md\n";
        assert!(
            check(&[("README.md", text), ("docs/a.md", "# The first `part` of 2\n[up](../README.md)")])
                .is_empty()
        );
    }

    #[test]
    fn links_to_nothing_are_found() {
        let text = "fine\n[a](docs/b.md)\n[a](docs/a.md#second)\n[r]: none.md\n```\n[code](x.md)\n```\n";
        assert_eq!(
            check(&[("README.md", text), ("docs/a.md", "# First")]),
            ["README.md:2", "README.md:3", "README.md:4"]
        );
    }

    #[test]
    fn pages_that_the_book_lacks_are_found() {
        let files = [
            TextFile::new(SUMMARY, "- [A](a.md)\n  - [B](b/c.md)"),
            TextFile::new("docs/a.md", ""),
            TextFile::new("docs/b/c.md", ""),
            TextFile::new("docs/d.md", ""),
            TextFile::new("README.md", ""),
        ];
        let found: Vec<_> = not_in_the_book(&files).into_iter().map(|violation| violation.place).collect();
        assert_eq!(found, ["docs/d.md"]);
    }
}
