//! `cargo xtask api`: public types that break a downstream crate when they get a field or a variant, for a review.
//!
//! It reads rustdoc's JSON, which is unstable: `RUSTC_BOOTSTRAP` lets the stable compiler write it, in a build directory of its own.

use std::fs;

use anyhow::{Context as _, Result};
use serde_json::Value as Json;

use crate::metadata::Metadata;
use crate::process;

/// Options of `cargo xtask api`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Only this crate; may be given several times. Default: all that build without tensors and Lance
    #[arg(long, short, value_name = "CRATE")]
    package: Vec<String>,
}

/// Prints the list, one type a line.
pub(crate) fn run(args: &Args) -> Result<()> {
    let metadata = Metadata::load()?;
    let target = metadata.target_directory.join("api");
    let mut doc = process::cargo(["doc", "--no-deps", "--lib"]);
    doc.args(args.package.iter().flat_map(|name| ["--package", name]));
    let flags = "-Z unstable-options --output-format json";
    process::run(
        doc.env("CARGO_TARGET_DIR", &target).env("RUSTC_BOOTSTRAP", "1").env("RUSTDOCFLAGS", flags),
    )?;
    let mut files: Vec<_> = fs::read_dir(target.join("doc"))?.collect::<std::io::Result<_>>()?;
    files.sort_by_key(fs::DirEntry::file_name);
    let names =
        files.iter().map(fs::DirEntry::path).filter(|path| path.extension().is_some_and(|end| end == "json"));
    for path in names {
        let crate_name = path.file_stem().unwrap_or_default().to_string_lossy().replace('_', "-");
        if !args.package.is_empty() && !args.package.contains(&crate_name) {
            continue;
        }
        let json = serde_json::from_slice(&fs::read(&path)?).with_context(|| path.display().to_string())?;
        for line in breakable(&json) {
            println!("{crate_name}: {line}");
        }
    }
    Ok(())
}

/// Public structs whose fields are all public, and public enums, unless they are non-exhaustive; with their place and parts.
fn breakable(json: &Json) -> Vec<String> {
    let index = &json["index"];
    let names = |ids: &Json| {
        let ids = ids.as_array().into_iter().flatten().map(ToString::to_string);
        ids.filter_map(|id| index[id]["name"].as_str().map(str::to_owned)).collect::<Vec<_>>().join(", ")
    };
    let items = index.as_object().into_iter().flat_map(|index| index.values());
    let ours = items.filter(|item| item["crate_id"] == 0 && item["visibility"] == "public");
    let mut lines: Vec<String> = ours
        .filter(|item| !item["attrs"].to_string().contains("non_exhaustive"))
        .filter_map(|item| {
            let plain = &item["inner"]["struct"]["kind"]["plain"];
            let (kind, parts) =
                match (plain["has_stripped_fields"].as_bool(), item["inner"]["enum"].get("variants")) {
                    (Some(false), _) => ("struct", names(&plain["fields"])),
                    (_, Some(variants)) => ("enum", names(variants)),
                    _ => return None,
                };
            let span = &item["span"];
            let place = format!("{}:{}", span["filename"].as_str().unwrap_or("?"), span["begin"][0]);
            (!parts.is_empty())
                .then(|| format!("{place}: {kind} {}: {parts}", item["name"].as_str().unwrap_or_default()))
        })
        .collect();
    lines.sort();
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn open_structs_and_enums_are_listed() {
        let item = |name: &str, attrs: Json, inner: Json| {
            json!({ "crate_id": 0, "visibility": "public", "name": name, "attrs": attrs, "inner": inner,
                    "span": { "filename": "a.rs", "begin": [7, 1] } })
        };
        let plain = |has_stripped: bool| json!({ "struct": { "kind": { "plain": { "fields": [9], "has_stripped_fields": has_stripped } } } });
        let json = json!({ "index": {
            "1": item("Open", json!([]), plain(false)),
            "2": item("Private", json!([]), plain(true)),
            "3": item("Marked", json!(["non_exhaustive"]), plain(false)),
            "4": item("Choice", json!([]), json!({ "enum": { "variants": [9] } })),
            "9": { "name": "part" },
        } });
        assert_eq!(breakable(&json), ["a.rs:7: enum Choice: part", "a.rs:7: struct Open: part"]);
    }
}
