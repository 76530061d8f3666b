//! The licenses of what the program is made of, for people: one text file with every license text that the crates carry.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};

use super::sbom::Origins;
use crate::cargo_tree::CargoTree;

/// How deep below a crate's root texts are looked for: bundled C libraries bring theirs.
const DEPTH: usize = 3;

/// Longer files are no licenses.
const MAX_BYTES: u64 = 200_000;

/// A table of the crates that come from elsewhere, then each text once, below the names of those that carry it.
pub(super) fn notices(tree: &CargoTree, origins: &Origins<'_>) -> Result<String> {
    let mut table = String::new();
    let mut carriers: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for unit in tree.dependencies() {
        let package = origins.package(unit)?;
        if package.source.is_none() {
            continue; // Ours: under the license of the project.
        }
        let license = package.license.as_deref().unwrap_or("see its text below");
        let from = package.repository.as_deref().unwrap_or("-");
        let folder = package.manifest_path.parent().context("a manifest lies in a folder")?;
        let texts = texts(folder, DEPTH)?;
        let note = if texts.is_empty() { "; its package holds no license text" } else { "" };
        let _ = writeln!(table, "{unit}: {license}{note}\n    {from}");
        for text in texts {
            carriers.entry(text).or_default().insert(unit.to_string());
        }
    }
    let mut out = format!(
        "This program contains the following software of others, under the licenses named here. Their texts follow.\n\n{table}"
    );
    // The text of most carriers first.
    let mut carriers: Vec<(String, BTreeSet<String>)> = carriers.into_iter().collect();
    carriers.sort_by_key(|(_, names)| std::cmp::Reverse(names.len()));
    for (text, names) in carriers {
        let names = names.into_iter().collect::<Vec<_>>().join(", ");
        let _ = write!(out, "\n{}\n{names}\n\n{}\n", "=".repeat(100), text.trim());
    }
    Ok(out)
}

/// The license texts below a folder.
fn texts(folder: &Path, depth: usize) -> Result<Vec<String>> {
    let mut found = Vec::new();
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    let mut entries: Vec<_> = entries.collect::<std::io::Result<_>>()?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let (kind, name) = (entry.file_type()?, entry.file_name().to_string_lossy().to_uppercase());
        if kind.is_dir() && depth > 1 && !["TESTS", "TEST", "TARGET", "SRC"].contains(&name.as_str()) {
            found.extend(texts(&entry.path(), depth - 1)?);
        } else if kind.is_file() && is_license(&name) && entry.metadata()?.len() <= MAX_BYTES {
            let bytes = fs::read(entry.path())?;
            found.push(String::from_utf8_lossy(&bytes).replace("\r\n", "\n"));
        }
    }
    Ok(found)
}

/// By its name, in capitals.
fn is_license(name: &str) -> bool {
    let starts = ["LICENSE", "LICENSE", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE"];
    let is_code = [".RS", ".PY", ".C", ".H", ".SH", ".TOML", ".JSON"].iter().any(|end| name.ends_with(end));
    starts.iter().any(|start| name.starts_with(start)) && !is_code
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cargo_tree::{Build, Unit};
    use crate::metadata::Metadata;
    use crate::process;

    #[test]
    fn equal_texts_are_found_in_bundled_libraries_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        fs::create_dir_all(path.join("ext/lib")).unwrap();
        fs::create_dir_all(path.join("tests")).unwrap();
        for (file, text) in [
            ("LICENSE-MIT", "mit"),
            ("ext/lib/copying.txt", "bsd"),
            ("tests/LICENSE", "no"),
            ("license.rs", "no"),
        ] {
            fs::write(path.join(file), text).unwrap();
        }
        assert_eq!(texts(path, DEPTH).unwrap(), ["mit", "bsd"]);
    }

    #[test]
    fn every_crate_of_a_build_is_named_with_its_license() {
        let build = Build { package: "swm-core".into(), default_features: true, features: Vec::new() };
        let (tree, metadata) = (build.tree().unwrap(), Metadata::load().unwrap());
        let lock = fs::read_to_string(process::root().join("Cargo.lock")).unwrap();
        let notices = notices(&tree, &Origins::new(&metadata, &lock).unwrap()).unwrap();
        let foreign: Vec<&Unit> = tree.dependencies().filter(|unit| !unit.name.starts_with("swm")).collect();
        assert!(foreign.len() > 20);
        assert!(foreign.iter().all(|unit| notices.contains(&format!("\n{unit}: "))));
        assert!(notices.contains("Permission is hereby granted, free of charge"));
    }
}
