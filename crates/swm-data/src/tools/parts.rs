//! Parts of a divided recording: which part a dataset is, whether parts together are the whole, and whether a run continues
//! the part that a file holds.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use swm_core::{Metadata, RecordingPart};

use crate::dataset::Dataset;
use crate::error::DataError;

/// Parts are listed up to this number.
const MAX_LISTED: usize = 8;

/// The episodes of part `shard` (counted from 1) of `of` parts of `0..total`.
pub fn range(shard: u64, of: u64, total: u64) -> Range<u64> {
    // The product of two episode counts does not fit into 64 bits.
    let cut = |part: u64| (u128::from(part) * u128::from(total) / u128::from(of.max(1))) as u64;
    cut(shard.saturating_sub(1))..cut(shard)
}

/// The part of a recording that a dataset is, and the metadata of that recording. `None`: it is no part, or its runs are of
/// several recordings.
pub fn part_of(dataset: &dyn Dataset) -> Option<(RecordingPart, Metadata)> {
    let episodes = dataset.num_episodes() as u64;
    let mut runs = dataset.info().runs.iter().filter(|&&(first, _)| first == 0 || first < episodes);
    let (_, head) = runs.next()?;
    let part = head.part?;
    let recording = recording(head);
    runs.all(|(_, run)| run.part == Some(part) && self::recording(run) == recording)
        .then_some((part, recording))
}

/// What all parts of a recording share. Another version of this program may continue a recording.
fn recording(metadata: &Metadata) -> Metadata {
    Metadata {
        part: None,
        rows_per_second: None,
        packages: BTreeMap::new(),
        made_from: BTreeMap::new(),
        ..metadata.clone()
    }
}

/// Orders datasets that are the parts of one recording by their episodes, after checking that none is missing. Datasets of
/// which none is a part stay as they are; so do datasets beside the parts, and then the order is that of the list.
///
/// # Errors
///
/// [`DataError::Request`]: the parts are of several recordings or divisions, one comes twice, one is missing or incomplete.
/// The message names them, and the settings that record one.
pub fn arrange(datasets: Vec<Box<dyn Dataset>>) -> Result<Vec<Box<dyn Dataset>>, DataError> {
    let held = held(&datasets)?;
    let Some(Held { part, metadata, dataset }) = held.values().next() else { return Ok(datasets) };
    let (of, total) = (part.of, part.total);
    let problems = problems(&held, part);
    if let Some((shard, _)) = problems.first() {
        let listed = problems.iter().take(MAX_LISTED).map(|(_, problem)| problem.clone());
        let more = problems.len().saturating_sub(MAX_LISTED);
        let listed: Vec<String> = listed.chain((more > 0).then(|| format!("{more} more"))).collect();
        let reason = format!(
            "its recording of {total} episodes in {of} parts is incomplete: {}. What recorded the other parts, with the shard \
             changed, records a part or the rest of it: env={}, seed={}, total={total}, shard={shard}/{of}, mode=append; `partial` \
             merges without these episodes",
            listed.join(", "),
            metadata.env,
            metadata.seed,
        );
        return Err(DataError::request(dataset.path(), reason));
    }
    if held.len() == datasets.len() { sort(datasets) } else { Ok(datasets) }
}

/// Datasets that are no part of a recording, where others in the list are.
pub fn beside_parts(datasets: &[Box<dyn Dataset>]) -> Vec<&Path> {
    let is_part = |dataset: &dyn Dataset| part_of(dataset).is_some();
    let all = || datasets.iter().map(AsRef::as_ref);
    match all().any(is_part) {
        true => all().filter(|dataset| !is_part(*dataset)).map(Dataset::path).collect(),
        false => Vec::new(),
    }
}

/// Orders the parts of one recording, of which some may be missing. Datasets that are no part come first.
///
/// # Errors
///
/// [`DataError::Request`]: the parts are of several recordings or divisions, or one comes twice.
pub(crate) fn sort(mut datasets: Vec<Box<dyn Dataset>>) -> Result<Vec<Box<dyn Dataset>>, DataError> {
    held(&datasets)?;
    datasets.sort_by_key(|dataset| part_of(dataset.as_ref()).map(|(part, _)| part.shard));
    Ok(datasets)
}

/// A part of a recording, and the recording's metadata.
struct Held<'a> {
    part: RecordingPart,
    metadata: Metadata,
    dataset: &'a dyn Dataset,
}

/// The datasets that are parts, by their number.
fn held(datasets: &[Box<dyn Dataset>]) -> Result<BTreeMap<u64, Held<'_>>, DataError> {
    const ADVICE: &str = "merge the parts of one recording at a time";
    let mut all: BTreeMap<u64, Held<'_>> = BTreeMap::new();
    for dataset in datasets {
        let Some((part, metadata)) = part_of(dataset.as_ref()) else { continue };
        let wrong = |reason: String| Err(DataError::request(dataset.path(), reason));
        let is_possible = (1..=part.of).contains(&part.shard)
            && range(part.shard, part.of, part.total) == (part.first..part.end);
        if !is_possible {
            return wrong(format!("its `swm_part` contradicts itself: {part:?}; record the part again"));
        }
        if let Some(other) = all.values().next() {
            let there = other.dataset.path().display();
            if (part.of, part.total) != (other.part.of, other.part.total) {
                let (here, of, total) = (name(&part), name(&other.part), other.part.total);
                return wrong(format!(
                    "it is part {here} of {} episodes, {there} is part {of} of {total}; {ADVICE}",
                    part.total
                ));
            }
            if let Some(difference) = difference(&metadata, &other.metadata) {
                return wrong(format!(
                    "it is a part of another recording than {there}: {difference}; {ADVICE}"
                ));
            }
        }
        if let Some(twice) = all.get(&part.shard) {
            let there = twice.dataset.path().display();
            return wrong(format!("it is part {}, as is {there}; give each part once", name(&part)));
        }
        all.insert(part.shard, Held { part, metadata, dataset: dataset.as_ref() });
    }
    Ok(all)
}

/// Parts that are missing, or hold another number of episodes than they should, with the reason.
fn problems(known: &BTreeMap<u64, Held<'_>>, recording: &RecordingPart) -> Vec<(u64, String)> {
    let mut problems = Vec::new();
    for shard in 1..=recording.of {
        let episodes = range(shard, recording.of, recording.total);
        let wanted = episodes.end - episodes.start;
        let of = recording.of;
        match known.get(&shard).map(|held| (held.dataset, held.dataset.num_episodes() as u64)) {
            // A part without episodes need not be there.
            None if wanted == 0 => {}
            None => problems.push((
                shard,
                format!("part {shard}/{of} (episodes {} to {}) is missing", episodes.start, episodes.end - 1),
            )),
            Some((_, held)) if held == wanted => {}
            Some((dataset, held)) => problems.push((
                shard,
                format!(
                    "part {shard}/{of} ({}) holds {held} of its {wanted} episodes",
                    dataset.path().display()
                ),
            )),
        }
    }
    problems
}

/// In what a run is of another recording than the last run of a file, `there`; nothing if it continues that one.
pub fn other_recording(there: &Metadata, here: &Metadata) -> Option<String> {
    let name = |metadata: &Metadata| {
        metadata.part.as_ref().map_or("the whole recording".to_owned(), |part| {
            format!("part {} of {} episodes", name(part), part.total)
        })
    };
    if there.part != here.part {
        return Some(format!("it holds {}, not {}", name(there), name(here)));
    }
    let difference = difference(&recording(there), &recording(here))?;
    Some(format!("its episodes are of another recording: {difference}"))
}

/// `3/16`.
fn name(part: &RecordingPart) -> String {
    format!("{}/{}", part.shard, part.of)
}

/// The first property in which a recording differs from another, as `policy "weak", not "expert"`.
fn difference(there: &Metadata, here: &Metadata) -> Option<String> {
    let properties = |metadata: &Metadata| match serde_json::to_value(metadata) {
        Ok(serde_json::Value::Object(properties)) => properties,
        _ => serde_json::Map::new(),
    };
    let (there, here) = (properties(there), properties(here));
    // Those that people set come first.
    let first = ["env", "policy", "seed"].into_iter();
    let mut names = first.chain(there.keys().map(String::as_str)).chain(here.keys().map(String::as_str));
    let name = names.find(|&name| there.get(name) != here.get(name))?;
    let value = |of: &serde_json::Map<String, _>| of.get(name).map_or("none".to_owned(), ToString::to_string);
    Some(format!("{name} {}, not {}", value(&there), value(&here)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_cover_every_episode_once() {
        for (of, total) in [(1, 5), (7, 100), (64, 10), (3, u64::MAX)] {
            let mut end = 0;
            for shard in 1..=of {
                let part = range(shard, of, total);
                assert_eq!(part.start, end);
                end = part.end;
            }
            assert_eq!(end, total);
        }
    }

    #[test]
    fn another_policy_seed_or_shard_is_no_continuation() {
        let part = RecordingPart { shard: 1, of: 2, first: 0, end: 5, total: 10 };
        let there = Metadata { policy: "weak".to_owned(), part: Some(part), ..Metadata::default() };
        let newer = BTreeMap::from([("swm-core".to_owned(), "9".to_owned())]);
        assert_eq!(other_recording(&there, &Metadata { packages: newer, ..there.clone() }), None);
        let refused = |here: Metadata, reason: &str| {
            let message = other_recording(&there, &here).unwrap();
            assert!(message.contains(reason), "{message}");
        };
        refused(Metadata { policy: "expert".to_owned(), ..there.clone() }, "policy \"weak\", not \"expert\"");
        refused(Metadata { seed: 3, ..there.clone() }, "seed 0, not 3");
        refused(Metadata { part: None, ..there.clone() }, "part 1/2 of 10 episodes, not the whole recording");
        let other = Some(RecordingPart { shard: 2, first: 5, end: 10, ..part });
        refused(Metadata { part: other, ..there.clone() }, "part 1/2 of 10 episodes, not part 2/2");
    }
}
