//! Groups of episodes in HDF5 files: which family of programs wrote a file, the order of its episodes, and its parts.

use std::collections::BTreeSet;

use swm_core::Column;
use swm_data::dataset::Steps;
use swm_data::error::{DataError, Result, unsupported};
use swm_data::hdf5::Tree;

use super::array::{Scratch, values};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    Robomimic,
    ManiSkill,
    Minari,
}

impl Family {
    /// The names of the format; of the group of episodes, what names of these start with, and what each of them has.
    pub(super) fn signs(self) -> (&'static str, &'static str, &'static str, &'static str) {
        match self {
            Self::Robomimic => ("robomimic", "/data", "demo_", "actions"),
            Self::ManiSkill => ("maniskill", "/", "traj_", "actions"),
            Self::Minari => ("minari", "/", "episode_", "observations"),
        }
    }
}

/// The episodes of a file.
pub(super) struct Episodes {
    pub(super) family: Family,
    /// Their groups, in their order.
    pub(super) groups: Vec<String>,
    /// Links by name in the places of others.
    linked: Vec<String>,
}

impl Episodes {
    pub(super) fn of(tree: &Tree) -> Option<Self> {
        [Family::Robomimic, Family::ManiSkill, Family::Minari].into_iter().find_map(|family| {
            let (_, root, start, sign) = family.signs();
            let sorted = |mut names: Vec<String>| {
                names.retain(|name| name.starts_with(start));
                names.sort_by_key(|name| super::natural(name));
                names
            };
            let linked = sorted(tree.links(root).ok()?);
            let path = |name| format!("{}/{name}", root.trim_end_matches('/'));
            let groups: Vec<String> = sorted(tree.members(root).ok()?.0).into_iter().map(path).collect();
            let is_it = match groups.first() {
                Some(first) => {
                    let (below, tables) = tree.members(first).ok()?;
                    let linked = tree.links(first).ok()?;
                    below.iter().chain(&tables).chain(&linked).any(|name| name == sign)
                }
                None => !linked.is_empty(),
            };
            is_it.then_some(Self { family, groups, linked })
        })
    }

    /// What a user has to know of episodes that are links; an error where all are.
    pub(super) fn about_links(&self) -> Result<Option<String>> {
        let Some(first) = self.linked.first() else { return Ok(None) };
        let about = format!(
            "{} of its {} episodes are soft or external links, which are not followed; the first of them is `{first}`; copy what they \
             lead to into their places (in h5py: `del group[name]`, then `group.copy(source, group, name)`)",
            self.linked.len(),
            self.linked.len() + self.groups.len()
        );
        if self.groups.is_empty() { Err(unsupported(about)) } else { Ok(Some(about)) }
    }
}

/// The episodes of a part, as `mask` lists them, and a note about those that are listed and not there.
pub(super) fn part(
    tree: &Tree,
    groups: &[String],
    split: &str,
) -> Result<(Vec<String>, Option<String>), DataError> {
    let refuse = |reason| Err(DataError::Option { option: "split", reason });
    let parts = tree.members("/mask").map(|(_, tables)| tables).unwrap_or_default();
    if !parts.iter().any(|part| part == split) {
        return refuse(match &parts[..] {
            [] => "the file has no parts (`mask`); leave it out".to_owned(),
            parts => format!("the file has no part `{split}`; it has {}", parts.join(", ")),
        });
    }
    let names = tree.table("/mask", split).and_then(|table| {
        let rows = super::hdf5::rows_of(table);
        let whole = Steps { first: 0, count: rows.rows(), stride: 1 };
        values(rows.as_ref(), whole, &mut Scratch::default())
    });
    let Ok(Column::Str(names)) = names else { return refuse(format!("`mask/{split}` holds no names")) };
    let names: BTreeSet<&str> = names.iter().map(|name| name.trim_end_matches('\0')).collect();
    let short = |group: &String| group.rsplit('/').next().unwrap_or_default().to_owned();
    let known: BTreeSet<String> = groups.iter().map(short).collect();
    let absent: Vec<&str> = names.iter().copied().filter(|name| !known.contains(*name)).collect();
    let note = absent.first().map(|first| {
        let count = absent.len();
        format!("`mask/{split}` names {count} episodes that are not read, the first of which is `{first}`")
    });
    let is_in = |group: &&String| names.contains(short(group).as_str());
    let chosen: Vec<String> = groups.iter().filter(is_in).cloned().collect();
    match chosen.is_empty() {
        true => refuse(format!("the part `{split}` has no episodes of the file")),
        false => Ok((chosen, note)),
    }
}
