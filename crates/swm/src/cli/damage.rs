//! Parts of a job that are gone or are not what their shards wrote: which shards they are of, and what to do.

use super::Failure;
use super::work::{self, Kind};
use crate::evaluation::file_hash;
use crate::jobs::JobFolder;
use crate::jobs::files::{bytes, ranges};
use crate::jobs::progress::{Done, Progress};

/// Words for the shards whose parts are gone, to be put behind those that are not done; nothing if there are none.
pub(super) fn lost(folder: &JobFolder, progress: &Progress) -> String {
    let lost: Vec<u64> = progress.lost.iter().copied().collect();
    lost.first().map_or(String::new(), |&first| {
        format!(
            " (done before, but parts are missing: {}; {})",
            ranges(&lost),
            folder.written(first).display()
        )
    })
}

/// Why the parts cannot be joined, with the shards whose parts are damaged and what to do about them.
pub(super) fn explained(failure: Failure, folder: &JobFolder, kind: Kind, progress: &Progress) -> Failure {
    if failure.is_cancelled() || kind == Kind::Train {
        return failure;
    }
    let Ok(done) = Done::all(folder, progress) else { return failure };
    let mut damaged = Vec::new();
    for (&shard, done) in &done {
        let part = work::shard_output(folder, kind, shard);
        if bytes(&part).is_ok_and(|bytes| bytes == done.bytes)
            && file_hash(&part).is_ok_and(|sha256| sha256 == done.sha256)
        {
            continue;
        }
        damaged.push((shard, part));
    }
    let Some((_, first)) = damaged.first() else { return failure };
    let shards: Vec<u64> = damaged.iter().map(|(shard, _)| *shard).collect();
    let of = if shards.len() == 1 { "shard" } else { "shards" };
    format!(
        "{failure}; what {of} {} wrote has changed since: remove {}, and make the missing parts again: {}",
        ranges(&shards),
        match damaged.len() {
            1 => first.display().to_string(),
            more => format!("{} and the {} others", first.display(), more - 1),
        },
        folder.command_for_the_rest()
    )
    .into()
}
