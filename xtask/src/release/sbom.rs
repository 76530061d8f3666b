//! What the program is made of, for machines: a bill of materials in CycloneDX 1.5, as JSON.
//!
//! Format: <https://cyclonedx.org/docs/1.5/json/>. It holds no time and no serial number, so that equal builds get equal bytes.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, Result};
use serde_json::{Value, json};

use crate::cargo_tree::{CargoTree, Unit};
use crate::metadata::{Metadata, Package};

/// Packages by name and version, and the SHA-256 that `Cargo.lock` has for those from a registry.
pub(super) struct Origins<'a> {
    packages: BTreeMap<(&'a str, &'a str), &'a Package>,
    checksums: BTreeMap<(String, String), String>,
}

impl<'a> Origins<'a> {
    pub(super) fn new(metadata: &'a Metadata, lock: &str) -> Result<Self> {
        let packages = metadata.packages.iter();
        let packages = packages.map(|package| ((package.name.as_str(), package.version.as_str()), package));
        let lock: toml::Table = lock.parse().context("Cargo.lock cannot be read")?;
        let locked = lock.get("package").and_then(toml::Value::as_array).into_iter().flatten();
        let text = |package: &toml::Value, key: &str| package.get(key)?.as_str().map(str::to_owned);
        let checksums = locked.filter_map(|package| {
            Some(((text(package, "name")?, text(package, "version")?), text(package, "checksum")?))
        });
        Ok(Self { packages: packages.collect(), checksums: checksums.collect() })
    }

    pub(super) fn package(&self, unit: &Unit) -> Result<&'a Package> {
        let key = (unit.name.as_str(), unit.version.as_str());
        self.packages.get(&key).copied().with_context(|| format!("cargo metadata does not know {unit}"))
    }
}

/// The bill of one program.
pub(super) fn bill(tree: &CargoTree, origins: &Origins<'_>) -> Result<Value> {
    let components = tree.dependencies().map(|unit| component(unit, "library", origins));
    let dependencies = tree.edges.iter().map(|(unit, on): (&Unit, &BTreeSet<Unit>)| {
        json!({ "ref": url(unit), "dependsOn": on.iter().map(url).collect::<Vec<_>>() })
    });
    Ok(json!({
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": { "component": component(&tree.root, "application", origins)? },
        "components": components.collect::<Result<Vec<_>>>()?,
        "dependencies": dependencies.collect::<Vec<_>>(),
    }))
}

fn component(unit: &Unit, kind: &str, origins: &Origins<'_>) -> Result<Value> {
    let package = origins.package(unit)?;
    let license = match &package.license {
        // The older way to write a choice is none of the format's.
        Some(expression) => json!({ "expression": expression.replace('/', " OR ") }),
        None => json!({ "license": { "name": "as its files say" } }),
    };
    let mut component = json!({
        "type": kind,
        "bom-ref": url(unit),
        "name": unit.name,
        "version": unit.version,
        "purl": url(unit),
        "licenses": [license],
    });
    if let Some(description) = package.description.as_deref().map(str::trim) {
        component["description"] = description.into();
    }
    if let Some(sum) = origins.checksums.get(&(unit.name.clone(), unit.version.clone())) {
        component["hashes"] = json!([{ "alg": "SHA-256", "content": sum }]);
    }
    if let Some(repository) = package.repository.as_deref().filter(|url| url.starts_with("https://")) {
        component["externalReferences"] = json!([{ "type": "vcs", "url": repository }]);
    }
    Ok(component)
}

/// Its package URL, `pkg:cargo/NAME@VERSION`.
fn url(unit: &Unit) -> String {
    format!("pkg:cargo/{}@{}", unit.name, unit.version.replace('+', "%2B"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;

    #[test]
    fn a_bill_names_each_part_its_license_and_who_needs_it() {
        let metadata = fixture("swm: png\n-png: zlib\n-zlib:");
        let lock = "[[package]]\nname = \"png\"\nversion = \"1.0.0\"\nchecksum = \"abc\"\n";
        let unit = |name: &str| Unit { name: name.into(), version: "1.0.0".into() };
        let edges = [("swm", vec!["png"]), ("png", vec!["zlib"]), ("zlib", vec![])];
        let edges = edges.map(|(name, on)| (unit(name), on.into_iter().map(unit).collect()));
        let tree = CargoTree { root: unit("swm"), edges: edges.into() };
        let bill = bill(&tree, &Origins::new(&metadata, lock).unwrap()).unwrap();

        assert_eq!(bill["metadata"]["component"]["purl"], "pkg:cargo/swm@1.0.0");
        let names: Vec<&str> = bill["components"]
            .as_array()
            .unwrap()
            .iter()
            .map(|part| part["name"].as_str().unwrap())
            .collect();
        assert_eq!(names, ["png", "zlib"]);
        assert_eq!(bill["components"][0]["hashes"][0]["content"], "abc");
        assert_eq!(bill["components"][1].get("hashes"), None);
        assert_eq!(bill["components"][0]["licenses"][0]["expression"], "MIT OR Apache-2.0");
        assert_eq!(
            bill["dependencies"][0],
            json!({ "ref": "pkg:cargo/png@1.0.0", "dependsOn": ["pkg:cargo/zlib@1.0.0"] })
        );
        let stranger =
            CargoTree { root: unit("stranger"), edges: [(unit("stranger"), BTreeSet::new())].into() };
        assert!(super::bill(&stranger, &Origins::new(&metadata, lock).unwrap()).is_err());
    }

    #[test]
    fn build_metadata_is_escaped() {
        let unit = Unit { name: "zstd-sys".into(), version: "2.0.0+zstd.1.5".into() };
        assert_eq!(url(&unit), "pkg:cargo/zstd-sys@2.0.0%2Bzstd.1.5");
    }
}
