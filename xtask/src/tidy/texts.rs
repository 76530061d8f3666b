//! Rules about all files that git tracks: traces of one machine, and size.

use super::Violation;
use super::tree::TextFile;

/// Top folders that exist on one machine only.
const MACHINE_FOLDERS: &[&str] = &["home", "root", "work", "Users"];

/// Parts of addresses of package servers; the tools' own settings say where packages come from. Written in two halves, so
/// that this file passes.
const PACKAGE_SERVERS: &[(&str, &str)] = &[
    ("artifact", "ory"),
    ("jfrog", ".io"),
    ("files.python", "hosted.org"),
    ("pypi", ".org"),
    ("index.", "crates.io"),
    ("static.", "crates.io"),
];

/// Absolute paths of one machine and addresses of package servers.
pub(super) fn machine_traces(files: &[TextFile]) -> Vec<Violation> {
    let paths = MACHINE_FOLDERS.iter().map(|folder| format!("/{folder}/"));
    let servers = PACKAGE_SERVERS.iter().map(|(start, end)| [*start, *end].concat());
    let traces: Vec<String> = paths.chain(servers).collect();
    let mut violations = Vec::new();
    for file in files {
        for (index, line) in file.text.lines().enumerate() {
            for trace in traces.iter().filter(|trace| holds(line, trace)) {
                let message = format!(
                    "`{trace}` means something on one machine only: write it relative, or leave it out"
                );
                violations.push(Violation::new(format!("{}:{}", file.path, index + 1), message));
            }
        }
    }
    violations
}

/// Lines that git leaves where two sides of a merge disagree.
pub(super) fn conflicts(files: &[TextFile]) -> Vec<Violation> {
    let marks = ["<", ">", "|"].map(|mark| format!("{} ", mark.repeat(7)));
    let mut violations = Vec::new();
    for file in files {
        for (index, line) in file.text.lines().enumerate() {
            if marks.iter().any(|mark| line.starts_with(mark)) {
                let place = format!("{}:{}", file.path, index + 1);
                violations
                    .push(Violation::new(place, "a merge was not finished: keep what both sides meant"));
            }
        }
    }
    violations
}

/// A path counts only where it begins: in `crates/root/src` or `https://host/home/` it does not.
fn holds(line: &str, trace: &str) -> bool {
    line.match_indices(trace).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        !trace.starts_with('/') || !before.is_some_and(|c| c.is_alphanumeric() || "_-./~*}$".contains(c))
    })
}

/// More bytes than a clone should cost; names the largest files.
pub(super) fn too_large(sizes: &[(String, u64)], limit: u64) -> Vec<Violation> {
    let total: u64 = sizes.iter().map(|(_, size)| size).sum();
    if total <= limit {
        return Vec::new();
    }
    let mut largest: Vec<&(String, u64)> = sizes.iter().collect();
    largest.sort_by_key(|(_, size)| std::cmp::Reverse(*size));
    let largest: Vec<String> =
        largest.iter().take(3).map(|(path, size)| format!("{path} ({:.1} MB)", *size as f64 / 1e6)).collect();
    let message = format!(
        "{:.1} MB, more than {:.1} MB; the largest: {}",
        total as f64 / 1e6,
        limit as f64 / 1e6,
        largest.join(", ")
    );
    vec![Violation::new("the repository", message)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_and_servers_are_found_where_they_begin() {
        let folder = |name: &str| format!("/{name}/");
        let text = [
            format!("open(\"{}data.h5\")", folder("work")),
            format!("see crates{}src and https://example.org{}", folder("root"), folder("home")),
            format!("{}me", folder("home")),
            format!("index-url = https://{}simple", ["pypi", ".org/"].concat()),
            "cargo run".into(),
        ];
        let found = machine_traces(&[TextFile::new("a.md", &text.join("\n"))]);
        let places: Vec<&str> = found.iter().map(|violation| violation.place.as_str()).collect();
        assert_eq!(places, ["a.md:1", "a.md:3", "a.md:4"]);
    }

    #[test]
    fn unfinished_merges_are_found() {
        let [left, right] = ["<", ">"].map(|mark| mark.repeat(7));
        let text = format!("# A\n{left} HEAD\none\n=======\ntwo\n{right} branch\n a {left} b\n");
        let found = conflicts(&[TextFile::new("a.md", &text)]);
        let places: Vec<&str> = found.iter().map(|violation| violation.place.as_str()).collect();
        assert_eq!(places, ["a.md:2", "a.md:6"]);
    }

    #[test]
    fn a_large_repository_names_its_largest_files() {
        let sizes = [("small".into(), 1_000), ("big.png".into(), 2_000_000), ("bigger.h5".into(), 3_000_000)];
        assert_eq!(too_large(&sizes, 5_001_000), []);
        let found = too_large(&sizes, 5_000_999);
        assert_eq!(
            found[0].message,
            "5.0 MB, more than 5.0 MB; the largest: bigger.h5 (3.0 MB), big.png (2.0 MB), small (0.0 MB)"
        );
    }
}
