//! `cargo xtask book`: the book in `docs/` as pages for a browser, by mdBook, into `target/book`; every link in them is followed.
//!
//! mdBook is built once, pinned by version, next to the build directory. That code on the pages runs is another test
//! (`tests/integration/book`); that their sources link well, a rule of `tidy`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail};

use crate::metadata::Metadata;
use crate::process;

/// Options of `cargo xtask book`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {}

const VERSION: &str = "0.5.4";

/// Pages that mdBook adds to ours: all in one, the table of contents alone, and one for links from anywhere.
const NOT_OURS: &[&str] = &["print.html", "toc.html", "404.html"];

/// Builds the book, and fails on a warning or a link that leads nowhere.
pub(crate) fn run(_args: &Args) -> Result<()> {
    let metadata = Metadata::load()?;
    let out = metadata.target_directory.join("book");
    build(&mdbook(&metadata.target_directory)?, &out)?;
    let mut pages = BTreeMap::new();
    read_pages(&out, &out, &mut pages)?;
    let book = Book {
        ids: pages.iter().map(|(path, text)| (path.clone(), ids(text))).collect(),
        out,
        repository: repository()?,
    };
    let mut dead = Vec::new();
    for (path, text) in &pages {
        let mut found = Vec::new();
        let linked = book.follow(path, text, &mut found);
        // In those, links are as in the pages that they are made of.
        if !NOT_OURS.contains(&path.as_str()) {
            dead.append(&mut found);
        }
        if linked != *text {
            let place = book.out.join(path);
            fs::write(&place, linked).with_context(|| format!("failed to write {}", place.display()))?;
        }
    }
    if !dead.is_empty() {
        bail!("{} links of the book lead nowhere:\n{}", dead.len(), dead.join("\n"));
    }
    println!("book: {} pages; open {}", pages.len() - NOT_OURS.len(), book.out.join("index.html").display());
    Ok(())
}

/// The program; built if it is missing, about a minute and a half of CPU time.
fn mdbook(target: &Path) -> Result<PathBuf> {
    let root = target.join("tools").join(format!("mdbook-{VERSION}"));
    let program = root.join("bin/mdbook");
    if !program.is_file() {
        eprintln!("book: building mdBook {VERSION}, once");
        let work = target.join("tools/build");
        let mut install =
            process::cargo(["install", "mdbook", "--locked", "--debug", "--quiet", "--version", VERSION]);
        install
            .args(["--no-default-features", "--features", "search", "--root"])
            .arg(&root)
            .env("CARGO_TARGET_DIR", &work);
        process::run(&mut install)?;
        fs::remove_dir_all(&work).with_context(|| format!("failed to remove {}", work.display()))?;
    }
    Ok(program)
}

/// Runs mdBook; what it warns of is an error.
fn build(program: &Path, out: &Path) -> Result<()> {
    let mut command = Command::new(program);
    command
        .arg("build")
        .arg(process::root().join("docs"))
        .arg("--dest-dir")
        .arg(out)
        .env("MDBOOK_LOG", "warn");
    let output = command.output().with_context(|| format!("failed to start {}", program.display()))?;
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said);
    if !output.status.success() || !said.trim().is_empty() {
        bail!("mdBook is not content with the book:\n{said}");
    }
    Ok(())
}

/// Where the sources are shown, for links to what is not in the book.
fn repository() -> Result<String> {
    let manifest = fs::read_to_string(process::root().join("Cargo.toml")).context("no Cargo.toml")?;
    let manifest: toml::Table = manifest.parse()?;
    let repository = &manifest["workspace"]["package"]["repository"];
    repository.as_str().map(str::to_owned).context("Cargo.toml names no repository")
}

/// Pages below `folder`, by their paths from `root`.
fn read_pages(root: &Path, folder: &Path, pages: &mut BTreeMap<String, String>) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("failed to read {}", folder.display()))? {
        let path = entry?.path();
        if path.is_dir() {
            read_pages(root, &path, pages)?;
        } else if path.extension().is_some_and(|extension| extension == "html") {
            let text =
                fs::read_to_string(&path).with_context(|| format!("failed to read {}", path.display()))?;
            let name = path.strip_prefix(root).expect("it lies below").to_string_lossy().replace('\\', "/");
            pages.insert(name, text);
        }
    }
    Ok(())
}

/// What links of a page can name.
fn ids(page: &str) -> BTreeSet<String> {
    page.split(" id=\"")
        .skip(1)
        .filter_map(|rest| rest.split_once('"'))
        .map(|(id, _)| id.to_owned())
        .collect()
}

struct Book {
    /// By page.
    ids: BTreeMap<String, BTreeSet<String>>,
    out: PathBuf,
    repository: String,
}

impl Book {
    /// The page with links to files outside of the book turned into links to the repository; adds those that lead nowhere to `dead`.
    fn follow(&self, page: &str, text: &str, dead: &mut Vec<String>) -> String {
        let mut linked = String::with_capacity(text.len());
        let mut rest = text;
        while let Some((at, name)) =
            ["href=\"", "src=\""].iter().filter_map(|name| Some((rest.find(name)?, name))).min()
        {
            let start = at + name.len();
            let end = start + rest[start..].find('"').unwrap_or(0);
            linked += &rest[..start];
            let link = &rest[start..end];
            match self.target(page, link) {
                Ok(Some(elsewhere)) => linked += &elsewhere,
                Ok(None) => linked += link,
                Err(reason) => {
                    dead.push(format!("{page}: `{link}`: {reason}"));
                    linked += link;
                }
            }
            rest = &rest[end..];
        }
        linked + rest
    }

    /// Where a link leads, if that is not what it says.
    fn target(&self, page: &str, link: &str) -> Result<Option<String>, String> {
        if link.is_empty() || link.contains(':') {
            return Ok(None);
        }
        let (path, id) = link.split_once('#').unwrap_or((link, ""));
        let path =
            if path.is_empty() { format!("docs/{page}") } else { resolve(&format!("docs/{page}"), path) };
        match path.strip_prefix("docs/") {
            Some(inside) if !self.out.join(inside).exists() => Err("there is no such file".to_owned()),
            Some(inside) => match self.ids.get(inside) {
                Some(ids) if !id.is_empty() && !ids.contains(id) => {
                    Err("the page has no such heading".to_owned())
                }
                _ => Ok(None),
            },
            None => self.outside(&path, id).map(Some),
        }
    }

    /// A file of the repository that is no page of the book. mdBook takes each page's extension for `html`.
    fn outside(&self, path: &str, id: &str) -> Result<String, String> {
        let source = path.strip_suffix(".html").map(|stem| format!("{stem}.md"));
        let source =
            source.filter(|source| process::root().join(source).exists()).unwrap_or_else(|| path.to_owned());
        let place = process::root().join(&source);
        let kind = if place.is_dir() { "tree" } else { "blob" };
        let id = if id.is_empty() { String::new() } else { format!("#{id}") };
        match place.exists() {
            true => Ok(format!("{}/{kind}/main/{source}{id}", self.repository)),
            false => Err(format!("there is no {source} in the repository")),
        }
    }
}

/// A link of the page `from`, as a path from the root.
fn resolve(from: &str, link: &str) -> String {
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in link.split('/') {
        match part {
            "." | "" => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn book() -> Book {
        let ids = [("a.html", &["one"][..]), ("envs/b.html", &[])];
        let ids = ids.map(|(page, ids)| (page.to_owned(), ids.iter().map(|&id| id.to_owned()).collect()));
        let out = std::env::temp_dir().join(format!("xtask-book-{}", std::process::id()));
        fs::create_dir_all(out.join("envs")).unwrap();
        fs::write(out.join("a.html"), "").unwrap();
        fs::write(out.join("envs/b.html"), "").unwrap();
        Book { ids: ids.into(), out, repository: "https://example.com/r".to_owned() }
    }

    #[test]
    fn links_in_the_book_hold_and_others_go_to_the_repository() {
        let (book, mut dead) = (book(), Vec::new());
        let text = "<a href=\"../a.html#one\"></a><a href=\"https://x.com\"></a><a href=\"../../README.html\"></a>\
                    <a href=\"../../xtask/src\"></a><a href=\"../../Cargo.toml\"></a>";
        let linked = book.follow("envs/b.html", text, &mut dead);
        assert!(dead.is_empty(), "{dead:?}");
        assert!(linked.contains("\"../a.html#one\"") && linked.contains("\"https://x.com\""));
        for place in ["blob/main/README.md", "tree/main/xtask/src", "blob/main/Cargo.toml"] {
            assert!(linked.contains(&format!("\"https://example.com/r/{place}\"")), "{place}: {linked}");
        }
        fs::remove_dir_all(&book.out).unwrap();
    }

    #[test]
    fn links_to_nothing_are_found() {
        let (book, mut dead) = (book(), Vec::new());
        let text =
            "<a href=\"c.html\"></a><a href=\"#two\"></a><img src=\"p.png\"><a href=\"../nothing\"></a>";
        assert_eq!(book.follow("a.html", text, &mut dead), text);
        assert_eq!(dead.len(), 4, "{dead:?}");
    }

    #[test]
    fn ids_are_read() {
        assert_eq!(
            ids("<h1 id=\"a\">A</h1><p class=\"x\" id=\"b-c\">"),
            ["a", "b-c"].map(str::to_owned).into()
        );
    }
}
