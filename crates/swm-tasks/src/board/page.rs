//! A board on disk: a page that needs nothing else, and its content as JSON.

use std::io;
use std::path::{Path, PathBuf};

use minijinja::context;

use super::Board;
use crate::error::{TaskError, cannot};
use crate::html::{of_json, render};
use crate::text_file::replace_text;

/// The page.
pub const PAGE: &str = "index.html";
/// Its content.
pub const DATA: &str = "board.json";

/// Whether the folder `path` may hold a board: it is not there, empty, or holds an earlier one.
///
/// # Errors
///
/// It is no folder, or cannot be read.
pub fn holds_board(path: &Path) -> io::Result<bool> {
    if !path.exists() || path.join(DATA).is_file() {
        return Ok(true);
    }
    Ok(path.read_dir()?.next().is_none())
}

/// Writes a board into the folder `out`, and gives the path of its page. An earlier one is replaced.
///
/// # Errors
///
/// A file cannot be written.
pub fn write_board(board: &Board, out: &Path) -> Result<PathBuf, TaskError> {
    std::fs::create_dir_all(out).map_err(cannot("make", out))?;
    let has_reruns = board.groups.iter().flat_map(|group| &group.rows).any(|row| row.rerun.is_some());
    let html = render("board.html", context! { has_reruns, ..of_json(&serde_json::to_value(board)?) })?;
    let page = out.join(PAGE);
    // The data first: a folder with a page and without data would be refused as one of somebody else.
    for (path, text) in [(out.join(DATA), serde_json::to_string_pretty(board)? + "\n"), (page.clone(), html)]
    {
        replace_text(&path, &text).map_err(cannot("write", &path))?;
    }
    Ok(page)
}
