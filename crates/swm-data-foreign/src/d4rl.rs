//! HDF5 files of D4RL: flat arrays of all steps, with marks where trajectories end.
//!
//! Source of the layout: D4RL 1.1, `offline_env.py`.

use std::path::Path;

use swm_data::OpenOptions;
use swm_data::dataset::{Dataset, Steps};
use swm_data::error::{At as _, DataError, FormatError, Result, invalid};
use swm_data::hdf5::Tree;

use super::array::{Memory, Scratch, Shared, numbers, values};
use super::dataset::Span;
use super::found::{Found, Source};
use super::hdf5::{array, scalars};

pub(super) const NAME: &str = "d4rl";

const SIGNS: [&str; 4] = ["observations", "actions", "rewards", "terminals"];

/// Whether a file has all signs, perhaps as links.
fn is_it(tree: &Tree) -> bool {
    let (Ok((_, tables)), Ok(linked)) = (tree.members("/"), tree.links("/")) else { return false };
    SIGNS.iter().all(|sign| tables.iter().chain(&linked).any(|name| name == sign))
}

pub(super) fn detect(path: &Path) -> bool {
    path.is_file() && super::hdf5::open(path).is_some_and(|tree| is_it(&tree))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    let tree = Tree::open(path)?;
    let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
    let found = find(&tree, &name, options.max_steps).map_err(|error| DataError::damaged(path, error))?;
    let found = found.map_err(|reason| DataError::Option { option: "max_steps", reason })?;
    found.open(path, NAME, options, &["max_steps"])
}

/// The inner error asks for the longest episode.
fn find(tree: &Tree, name: &str, max_steps: Option<usize>) -> Result<Result<Found, String>> {
    let scratch = &mut Scratch::default();
    let paths = tree.tables("/")?;
    let mut marks = |path: &str| -> Result<Option<Vec<bool>>> {
        match paths.iter().any(|known| known == path) {
            true => {
                let rows = scalars(array(tree, "/", path, false)?);
                Ok(Some(
                    numbers(rows.as_ref(), scratch)?
                        .into_iter()
                        .map(|mark| mark != 0.0)
                        .collect::<Vec<bool>>(),
                ))
            }
            false => Ok(None),
        }
    };
    let terminals = marks("terminals").at("`terminals`")?.unwrap_or_default();
    let timeouts = marks("timeouts").at("`timeouts`")?;
    let rows = terminals.len();
    let mut found = Found::default();
    let timeouts = match (timeouts, max_steps) {
        (Some(timeouts), None) if timeouts.len() == rows => timeouts,
        (Some(timeouts), None) => {
            return Err(invalid(format!("`timeouts` has {} rows, `terminals` {rows}", timeouts.len())));
        }
        (Some(_), Some(_)) => {
            return Ok(Err("the file marks where time limits ended an episode; leave it out".to_owned()));
        }
        (None, None) => {
            return Ok(Err(
                "the file does not mark where time limits ended an episode (`timeouts`); give the \
                           `max_episode_steps` of its environment"
                    .to_owned(),
            ));
        }
        (None, Some(most)) => {
            let mut since = 0;
            let mut is_end = |&terminal: &bool| {
                since += 1;
                let is_limit = since == most;
                if terminal || is_limit {
                    since = 0;
                }
                is_limit && !terminal
            };
            terminals.iter().map(&mut is_end).collect()
        }
    };
    // In antmaze, terminals mark the rows at the goal, and an episode goes on.
    let last = paths.iter().any(|path| path == "next_observations");
    let is_at_goal = is_antmaze(name)
        || terminals.windows(2).any(|two| two[0] && two[1]) && goes_on(tree, &terminals, &timeouts, last)?;
    let is_end = |row: usize| timeouts[row] || (!is_at_goal && terminals[row]);
    let mut starts = Vec::new();
    let mut first = 0;
    for row in 0..rows {
        if is_end(row) || row + 1 == rows {
            starts.push((first, row + 1 - first));
            first = row + 1;
        }
    }
    found.lengths = starts.iter().map(|(_, count)| count + usize::from(last)).collect();
    let ends = starts.iter().flat_map(|&(first, count)| (first..first + count).chain(last.then_some(rows)));
    let ends: Vec<usize> = ends.collect();
    let marks_of = |marks: &[bool]| {
        let marks = ends.iter().map(|&row| marks.get(row).copied().unwrap_or_default()).collect();
        vec![Memory::marks(marks)]
    };
    let spans = found.end_to_end();
    let new = if is_at_goal { "terminals" } else { "terminated" };
    found.sources.push(Source::step("terminals", new, marks_of(&terminals), spans.clone()));
    found.sources.push(Source::step("timeouts", "truncated", marks_of(&timeouts), spans));
    for path in
        paths.iter().filter(|path| !["terminals", "timeouts", "next_observations"].contains(&path.as_str()))
    {
        if path.starts_with("metadata/") {
            continue;
        }
        let column = match array(tree, "/", path, false) {
            Ok(column) if column.rows() == rows => column,
            Ok(column) => {
                let reason = format!("it has {} rows, `terminals` {rows}", column.rows());
                if SIGNS.contains(&path.as_str()) {
                    return Err(invalid(reason).at(format_args!("`{path}`")));
                }
                found.skipped.push((path.replace('/', "."), reason));
                continue;
            }
            Err(FormatError::Unsupported(reason)) if !SIGNS.contains(&path.as_str()) => {
                found.skipped.push((path.replace('/', "."), reason.to_string()));
                continue;
            }
            Err(error) => return Err(error.at(format_args!("`{path}`"))),
        };
        let (mut arrays, new): (Vec<Shared>, _) = match path.as_str() {
            "observations" => (vec![column], "state".to_owned()),
            "actions" => (vec![column], "action".to_owned()),
            "rewards" => (vec![scalars(column)], "reward".to_owned()),
            other => (vec![column], other.replace('/', ".")),
        };
        let has_next = last && path == "observations";
        if has_next {
            arrays.push(array(tree, "/", "next_observations", false).at("`next_observations`")?);
        }
        let span = |&(first, count): &(usize, usize)| Span {
            array: 0,
            first,
            count,
            tail: has_next.then_some((1, first + count - 1)),
        };
        let spans = starts.iter().map(span).collect();
        found.sources.push(Source::step(path, &new, arrays, spans));
    }
    notes(name, is_at_goal, &mut found);
    Ok(Ok(found))
}

/// Whether a file is called so: `antmaze-…` by D4RL, `Ant_maze_…` where it is published.
fn is_antmaze(name: &str) -> bool {
    ["antmaze", "ant_maze", "ant-maze"].iter().any(|start| name.contains(start))
}

/// Whether observations go on behind `terminals`, rather than begin anew: where most of them are the next ones of the row before, in files
/// that have these; else by the median of their distances from one row to the next, which is that elsewhere in an episode.
fn goes_on(tree: &Tree, terminals: &[bool], timeouts: &[bool], has_next: bool) -> Result<bool> {
    /// Pairs of rows of either kind.
    const MOST: usize = 1000;
    /// What begins anew is more than so many usual steps away.
    const FAR: f64 = 2.0;
    /// Next ones that are written in other bits.
    const SAME: f64 = 1e-5;
    let rows = array(tree, "/", "observations", false)?;
    let next = if has_next { Some(array(tree, "/", "next_observations", false)?) } else { None };
    let scratch = &mut Scratch::default();
    let mut row_of = |array: &Shared, row: usize| -> Result<Vec<f64>> {
        let row = values(array.as_ref(), Steps { first: row, count: 1, stride: 1 }, scratch)?;
        Ok((0..row.len()).map(|at| row.as_slice().as_f64(at).unwrap_or(0.0)).collect())
    };
    let mut median = |from: &Shared, is_wanted: &dyn Fn(usize) -> bool| -> Result<f64> {
        let mut distances = Vec::new();
        let pairs = (0..terminals.len().saturating_sub(1)).filter(|&row| !timeouts[row] && is_wanted(row));
        for row in pairs.take(MOST) {
            let (one, other) = (row_of(from, row)?, row_of(&rows, row + 1)?);
            distances.push(one.iter().zip(&other).map(|(one, other)| (other - one).powi(2)).sum::<f64>());
        }
        distances.sort_by(f64::total_cmp);
        Ok(distances.get(distances.len() / 2).copied().unwrap_or(0.0).sqrt())
    };
    match next {
        Some(next) => Ok(median(&next, &|row| terminals[row])? <= SAME),
        None => Ok(median(&rows, &|row| terminals[row])? <= FAR * median(&rows, &|row| !terminals[row])?),
    }
}

fn notes(name: &str, is_at_goal: bool, found: &mut Found) {
    if is_at_goal {
        found.notes.push(
            "`terminals` are true in rows at the goal, within episodes, which end at `timeouts` only: there is no `terminated`".to_owned(),
        );
    }
    if is_antmaze(name) && name.contains("-v0") {
        found
            .notes
            .push("`timeouts` of version 0 are misplaced, so that episodes jump; use version 2".to_owned());
    }
    if name.contains("maze2d") {
        found.notes.push(
            "`timeouts` mark reached goals, and the reward of a row is that of its own observation"
                .to_owned(),
        );
    }
}
