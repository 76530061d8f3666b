//! The end of an MCAP file: the summary, by which other programs find their way.

use std::fs::File;

use swm_files::write_all_at;

use super::describe;
use super::index::Index;
use super::records::{CHUNK_INDEX, Content, DATA_END, FOOTER, MAGIC, METADATA_INDEX, STATISTICS};
use crate::error::Result;

/// Ends the data behind the last committed episode and writes the summary.
/// `checksum` is that of all bytes before it.
pub(super) fn write(file: &File, index: &Index, checksum: u32) -> Result<()> {
    let committed = index.end;
    let end = Content::default().u32(checksum).record(DATA_END);
    let start = committed + end.len() as u64;
    let bytes = [end, bytes(index, start)].concat();
    let written =
        write_all_at(file, &bytes, committed).and_then(|()| file.set_len(committed + bytes.len() as u64));
    Ok(written.inspect_err(|_| {
        // Half a summary helps nobody.
        let _ = file.set_len(committed);
    })?)
}

/// The summary, which begins at the byte `start` of the file, and the footer.
fn bytes(index: &Index, start: u64) -> Vec<u8> {
    let mut summary = describe::description(&index.columns).concat();
    let times = index.chunks.iter().flat_map(|chunk| chunk.times);
    let messages: u64 = index.counts.iter().sum();
    let counts = index.channels.iter().zip(&index.counts);
    let counts = counts.fold(Content::default(), |list, ((id, _), &count)| list.u16(*id).u64(count));
    let statistics = Content::default()
        .u64(messages)
        .u16(2)
        .u32(index.channels.len() as u32)
        .u32(0)
        .u32(index.metadata.len() as u32)
        .u32(index.chunks.len() as u32)
        .u64(times.clone().min().unwrap_or(0))
        .u64(times.max().unwrap_or(0))
        .list(&counts.0);
    summary.extend(statistics.record(STATISTICS));
    for chunk in &index.chunks {
        let offsets = chunk.indexes.iter().fold(Content::default(), |list, &(id, at)| list.u16(id).u64(at));
        let index =
            Content::default().u64(chunk.times[0]).u64(chunk.times[1]).u64(chunk.at).u64(chunk.length);
        let index = index.list(&offsets.0).u64(chunk.indexes_length);
        let index = index.text(chunk.compression.name()).u64(chunk.stored).u64(chunk.size);
        summary.extend(index.record(CHUNK_INDEX));
    }
    for (name, at, length) in &index.metadata {
        summary.extend(Content::default().u64(*at).u64(*length).text(name).record(METADATA_INDEX));
    }
    // The checksum covers the summary and the footer up to itself.
    let footer = Content::default().u64(start).u64(0).u32(0).record(FOOTER);
    let (footer, _) = footer.split_at(footer.len() - 4);
    summary.extend(footer);
    let checksum = crc32fast::hash(&summary);
    summary.extend(checksum.to_le_bytes());
    summary.extend(MAGIC);
    summary
}
