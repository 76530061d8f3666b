//! Rules about manifests: every shared dependency is explained and used, every crate is described.

use std::collections::{BTreeMap, BTreeSet};

use super::Violation;
use crate::metadata::Metadata;

const TABLE: &str = "docs/dependencies.md";

/// Shared dependencies without a full row in the table, and rows without a dependency.
///
/// A row counts below the heading `## Crates`: name in backticks, why, license, cost to build.
pub(super) fn dependency_table(manifest: &str, document: &str) -> Vec<Violation> {
    let dependencies = match shared_dependencies(manifest) {
        Ok(dependencies) => dependencies,
        Err(violation) => return vec![violation],
    };
    let rows = rows(document);
    let mut violations = Vec::new();
    for name in &dependencies {
        match rows.get(name.as_str()) {
            None => violations.push(Violation::new(TABLE, format!("no row for `{name}` below `## Crates`"))),
            Some(cells) if cells.len() != 3 || cells.iter().any(|cell| cell.is_empty()) => {
                violations
                    .push(Violation::new(TABLE, format!("`{name}` needs: why | license | cost to build")));
            }
            Some(_) => {}
        }
    }
    let stale = rows.keys().filter(|name| !dependencies.contains(**name));
    violations.extend(
        stale.map(|name| Violation::new(TABLE, format!("`{name}` is no shared dependency: remove its row"))),
    );
    violations
}

/// Shared dependencies that no crate of the workspace names.
pub(super) fn unused_dependencies(manifest: &str, metadata: &Metadata) -> Vec<Violation> {
    let dependencies = match shared_dependencies(manifest) {
        Ok(dependencies) => dependencies,
        Err(violation) => return vec![violation],
    };
    let used: BTreeSet<&str> = metadata
        .members()
        .flat_map(|package| &package.dependencies)
        .map(|dependency| dependency.name.as_str())
        .collect();
    let unused = dependencies.iter().filter(|name| !used.contains(name.as_str()));
    unused.map(|name| Violation::new("Cargo.toml", format!("no crate uses `{name}`: remove it"))).collect()
}

/// Crates without a description or a license.
pub(super) fn undescribed(metadata: &Metadata) -> Vec<Violation> {
    let mut violations = Vec::new();
    for package in metadata.members() {
        let fields = [("description", &package.description), ("license", &package.license)];
        for (field, _) in
            fields.iter().filter(|(_, value)| value.as_deref().is_none_or(|text| text.trim().is_empty()))
        {
            violations.push(Violation::new(&package.name, format!("its Cargo.toml has no `{field}`")));
        }
    }
    violations
}

/// Names below `[workspace.dependencies]` that come from elsewhere.
fn shared_dependencies(manifest: &str) -> Result<BTreeSet<String>, Violation> {
    let manifest: toml::Table =
        manifest.parse().map_err(|error| Violation::new("Cargo.toml", format!("cannot be read: {error}")))?;
    let table = manifest
        .get("workspace")
        .and_then(|workspace| workspace.get("dependencies"))
        .and_then(toml::Value::as_table);
    let foreign = table.into_iter().flatten().filter(|(_, value)| value.get("path").is_none());
    Ok(foreign.map(|(name, _)| name.clone()).collect())
}

/// Rows of the table below `## Crates`: name, and the trimmed cells after it.
fn rows(document: &str) -> BTreeMap<&str, Vec<&str>> {
    let lines = document.lines().skip_while(|line| line.trim() != "## Crates").skip(1);
    lines.take_while(|line| !line.starts_with("## ")).filter_map(row).collect()
}

fn row(line: &str) -> Option<(&str, Vec<&str>)> {
    let mut cells = line.trim().strip_prefix('|')?.strip_suffix('|')?.split('|').map(str::trim);
    let name = cells.next()?.strip_prefix('`')?.strip_suffix('`')?;
    Some((name, cells.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;

    const MANIFEST: &str =
        "[workspace.dependencies]\nours = { path = \"a\" }\nanyhow = \"1\"\npng = { version = \"1\" }\n";

    fn messages(violations: Vec<Violation>) -> Vec<String> {
        violations.into_iter().map(|violation| violation.message).collect()
    }

    #[test]
    fn a_full_table_passes() {
        let document = "# Dependencies\n## Crates\n| crate | why | license | cost |\n|--|--|--|--|\n\
                        | `anyhow` | errors | MIT | light |\n| `png` | images | MIT | light |\n## Tools\n| `cmake` | x |\n";
        assert_eq!(dependency_table(MANIFEST, document), []);
    }

    #[test]
    fn missing_partial_and_stale_rows_are_found() {
        let document = "## Crates\n| `anyhow` | errors | | light |\n| `gone` | a | b | c |\n";
        assert_eq!(
            messages(dependency_table(MANIFEST, document)),
            [
                "`anyhow` needs: why | license | cost to build",
                "no row for `png` below `## Crates`",
                "`gone` is no shared dependency: remove its row",
            ]
        );
    }

    #[test]
    fn a_broken_manifest_is_told() {
        assert!(messages(dependency_table("[workspace", ""))[0].starts_with("cannot be read"));
    }

    #[test]
    fn unused_dependencies_are_found() {
        let metadata = fixture("swm: ~anyhow\n-anyhow: png\n-png:");
        assert_eq!(messages(unused_dependencies(MANIFEST, &metadata)), ["no crate uses `png`: remove it"]);
    }

    #[test]
    fn crates_say_what_they_are() {
        let mut metadata = fixture("swm:\nswm-core:\n-foreign:");
        metadata.packages[1].description = None;
        metadata.packages[1].license = Some(" ".into());
        metadata.packages[2].description = None;
        assert_eq!(
            undescribed(&metadata),
            [
                Violation::new("swm-core", "its Cargo.toml has no `description`"),
                Violation::new("swm-core", "its Cargo.toml has no `license`"),
            ]
        );
    }
}
