//! Parts of a job that are gone or are not what their shards wrote: which shards they are of, and what to do.

use super::Failure;
use super::work;
use crate::evaluation::{file_bytes, file_hash};
use crate::jobs::JobFolder;
use crate::jobs::files::ranges;
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

/// Refuses to join parts that are not what their shards wrote, byte for byte, and says of which shards they are and what to do.
pub(super) fn check_parts(folder: &JobFolder, progress: &Progress) -> Result<(), Failure> {
    if folder.job.request.is_of_runs() {
        // Runs are not joined, and go on when they are resumed.
        return Ok(());
    }
    let (mut shards, mut parts) = (Vec::new(), Vec::new());
    for (shard, done) in Done::all(folder, progress)? {
        let part = work::shard_output(folder, shard);
        if file_bytes(&part)? != done.bytes || file_hash(&part)? != done.sha256 {
            shards.push(shard);
            parts.push(part);
        }
    }
    let Some(first) = parts.first() else { return Ok(()) };
    let first = match parts.len() {
        1 => first.display().to_string(),
        more => format!("{} and the {} others", first.display(), more - 1),
    };
    Err(format!(
        "the parts of {} cannot be joined: what {} {} wrote has changed since: remove {first}, and make the missing parts again: {}",
        folder.dir.display(),
        if shards.len() == 1 { "shard" } else { "shards" },
        ranges(&shards),
        folder.command_for_the_rest()
    )
    .into())
}
