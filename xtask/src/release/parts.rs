//! What the program is made of: a bill of materials in CycloneDX 1.5 for machines, and the license texts for people.
//!
//! Format: <https://cyclonedx.org/docs/1.5/json/>. Neither holds a time or a serial number: equal builds get equal bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use anyhow::{Context as _, Result};
use serde_json::{Value, json};

use crate::cargo_tree::{CargoTree, Unit};
use crate::metadata::{Metadata, Package};

/// The crates of one build, with their packages.
pub(super) struct Parts<'a> {
    tree: &'a CargoTree,
    packages: BTreeMap<String, &'a Package>,
    /// The SHA-256 that `Cargo.lock` has for those from a registry.
    checksums: BTreeMap<String, String>,
}

impl<'a> Parts<'a> {
    pub(super) fn new(tree: &'a CargoTree, metadata: &'a Metadata, lock: &str) -> Result<Self> {
        let named = |package: &'a Package| (format!("{} {}", package.name, package.version), package);
        let lock: toml::Table = lock.parse().context("failed to read Cargo.lock")?;
        let locked = lock.get("package").and_then(toml::Value::as_array).into_iter().flatten();
        let checksum = |package: &toml::Value| {
            let text = |key| package.get(key).and_then(toml::Value::as_str);
            Some((format!("{} {}", text("name")?, text("version")?), text("checksum")?.to_owned()))
        };
        let checksums = locked.filter_map(checksum).collect();
        Ok(Self { tree, packages: metadata.packages.iter().map(named).collect(), checksums })
    }

    fn package(&self, unit: &Unit) -> Result<&'a Package> {
        let package = self.packages.get(&unit.to_string());
        package.copied().with_context(|| format!("cargo metadata does not know {unit}"))
    }

    /// The bill of materials, and the number of its components.
    pub(super) fn bill(&self) -> Result<(Vec<u8>, usize)> {
        let components = self.tree.dependencies().map(|unit| self.component(unit, "library"));
        let components = components.collect::<Result<Vec<_>>>()?;
        let count = components.len();
        let edges = self.tree.edges.iter();
        let dependencies = edges.map(
            |(unit, on)| json!({ "ref": url(unit), "dependsOn": on.iter().map(url).collect::<Vec<_>>() }),
        );
        let bill = json!({
            "bomFormat": "CycloneDX",
            "specVersion": "1.5",
            "version": 1,
            "metadata": { "component": self.component(&self.tree.root, "application")? },
            "components": components,
            "dependencies": dependencies.collect::<Vec<_>>(),
        });
        Ok((serde_json::to_vec_pretty(&bill)?, count))
    }

    fn component(&self, unit: &Unit, kind: &str) -> Result<Value> {
        let package = self.package(unit)?;
        let license = match &package.license {
            // CycloneDX does not know the older way to write a choice.
            Some(expression) => json!({ "expression": expression.replace('/', " OR ") }),
            None => json!({ "license": { "name": "as its files say" } }),
        };
        let hash = self.checksums.get(&unit.to_string());
        let repository = package.repository.as_deref().filter(|url| url.starts_with("https://"));
        let mut component = json!({
            "type": kind, "bom-ref": url(unit), "name": unit.name, "version": unit.version, "purl": url(unit),
            "licenses": [license],
            "description": package.description.as_deref().map(str::trim),
            "hashes": hash.map(|sum| [json!({ "alg": "SHA-256", "content": sum })]),
            "externalReferences": repository.map(|url| [json!({ "type": "vcs", "url": url })]),
        });
        component.as_object_mut().into_iter().for_each(|fields| fields.retain(|_, value| !value.is_null()));
        Ok(component)
    }

    /// A table of the crates from elsewhere, then each license text once, below the names of those that carry it.
    pub(super) fn notices(&self) -> Result<String> {
        let mut out =
            "This program contains the following software of others, under the licenses named here. \
            Their texts follow.\n\n"
                .to_owned();
        let mut carriers: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for unit in self.tree.dependencies() {
            let package = self.package(unit)?;
            if package.source.is_none() {
                continue; // Ours: under the license of the project.
            }
            let license = package.license.as_deref().unwrap_or("see its text below");
            let texts = texts(package.manifest_path.parent().context("a manifest lies in a folder")?, 3)?;
            let note = if texts.is_empty() { "; its package holds no license text" } else { "" };
            let from = package.repository.as_deref().unwrap_or("-");
            let _ = writeln!(out, "{unit}: {license}{note}\n    {from}");
            for text in texts {
                carriers.entry(text).or_default().push(unit.to_string());
            }
        }
        // The text of most carriers first.
        let mut carriers: Vec<_> = carriers.into_iter().collect();
        carriers.sort_by_key(|(_, names)| std::cmp::Reverse(names.len()));
        for (text, names) in carriers {
            let _ = write!(out, "\n{}\n{}\n\n{}\n", "=".repeat(100), names.join(", "), text.trim());
        }
        Ok(out)
    }
}

/// A crate's package URL, `pkg:cargo/NAME@VERSION`.
fn url(unit: &Unit) -> String {
    format!("pkg:cargo/{}@{}", unit.name, unit.version.replace('+', "%2B"))
}

/// The license texts below a folder, each once: bundled C libraries bring theirs, some folders deep.
fn texts(folder: &Path, depth: usize) -> Result<BTreeSet<String>> {
    let mut found = BTreeSet::new();
    for entry in fs::read_dir(folder).with_context(|| format!("failed to list {}", folder.display()))? {
        let (path, name) =
            entry.map(|entry| (entry.path(), entry.file_name().to_string_lossy().to_uppercase()))?;
        if path.is_dir() && depth > 1 && !["TESTS", "TEST", "TARGET", "SRC"].contains(&name.as_str()) {
            found.extend(texts(&path, depth - 1)?);
        } else if path.is_file() && is_license(&name) && path.metadata()?.len() <= 200_000 {
            found.insert(String::from_utf8_lossy(&fs::read(path)?).replace("\r\n", "\n"));
        }
    }
    Ok(found)
}

/// By its name, in capitals and in both spellings.
fn is_license(name: &str) -> bool {
    let starts = ["LICENSE", "LICENCE", "COPYING", "COPYRIGHT", "NOTICE", "UNLICENSE", "UNLICENCE"];
    let is_code = [".RS", ".PY", ".C", ".H", ".SH", ".TOML", ".JSON"].iter().any(|end| name.ends_with(end));
    starts.iter().any(|start| name.starts_with(start)) && !is_code
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cargo_tree::Build;
    use crate::metadata::fixture;
    use crate::process;

    #[test]
    fn a_bill_names_each_part_its_license_and_who_needs_it() {
        let metadata = fixture("swm: png\n-png: zlib\n-zlib:");
        let lock = "[[package]]\nname = \"png\"\nversion = \"1.0.0\"\nchecksum = \"abc\"\n";
        let unit = |name: &str| Unit { name: name.into(), version: "1.0.0".into() };
        let edges = [("swm", vec!["png"]), ("png", vec!["zlib"]), ("zlib", vec![])];
        let edges = edges.map(|(name, on)| (unit(name), on.into_iter().map(unit).collect()));
        let tree = CargoTree { root: unit("swm"), edges: edges.into() };
        let (bill, count) = Parts::new(&tree, &metadata, lock).unwrap().bill().unwrap();
        let bill: Value = serde_json::from_slice(&bill).unwrap();
        assert_eq!(bill["metadata"]["component"]["purl"], "pkg:cargo/swm@1.0.0");
        assert_eq!(
            (count, &bill["components"][0]["name"], &bill["components"][1]["name"]),
            (2, &json!("png"), &json!("zlib"))
        );
        assert_eq!(bill["components"][0]["hashes"][0]["content"], "abc");
        assert_eq!(bill["components"][1].get("hashes"), None);
        assert_eq!(bill["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        let first = json!({ "ref": "pkg:cargo/png@1.0.0", "dependsOn": ["pkg:cargo/zlib@1.0.0"] });
        assert_eq!(bill["dependencies"][0], first);
        let stranger =
            CargoTree { root: unit("stranger"), edges: [(unit("stranger"), BTreeSet::new())].into() };
        assert!(Parts::new(&stranger, &metadata, lock).unwrap().bill().is_err());
        assert_eq!(url(&Unit { name: "z".into(), version: "2.0.0+1.5".into() }), "pkg:cargo/z@2.0.0%2B1.5");
    }

    #[test]
    fn license_texts_are_found_in_bundled_libraries_too() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir_all(folder.path().join("ext/lib")).unwrap();
        fs::create_dir_all(folder.path().join("tests")).unwrap();
        let files = ["LICENCE-MIT", "ext/lib/copying.txt", "tests/LICENSE", "license.rs"];
        for file in files {
            fs::write(folder.path().join(file), file).unwrap();
        }
        assert_eq!(texts(folder.path(), 3).unwrap(), files[..2].iter().map(ToString::to_string).collect());
    }

    #[test]
    fn every_crate_of_a_build_is_named_with_its_license() {
        let build = Build { package: "swm-core".into(), default_features: true, features: Vec::new() };
        let (tree, metadata) = (build.tree().unwrap(), Metadata::load().unwrap());
        let lock = fs::read_to_string(process::root().join("Cargo.lock")).unwrap();
        let notices = Parts::new(&tree, &metadata, &lock).unwrap().notices().unwrap();
        let foreign: Vec<&Unit> = tree.dependencies().filter(|unit| !unit.name.starts_with("swm")).collect();
        assert!(foreign.len() > 20);
        assert!(foreign.iter().all(|unit| notices.contains(&format!("\n{unit}: "))));
        assert!(notices.contains("Permission is hereby granted, free of charge"));
    }
}
