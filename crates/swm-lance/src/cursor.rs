//! What a reader keeps between reads: chunks that were decoded last, for the next rows are often in the same ones.

use std::sync::Arc;

use crate::page::{Chunk, held};
use crate::values::Values;

/// Decoded chunks, at most.
const MAX_CHUNKS: usize = 32;
/// Their bytes, at most; the newest is kept in any case.
const MAX_BYTES: usize = 2 << 20;
/// Decoded pages of lists.
const MAX_PAGES: usize = 4;

/// What one reader keeps between reads. Readers of several threads have one each.
#[derive(Debug, Default)]
pub struct Cursor {
    /// By page and position, the newest last.
    chunks: Vec<((usize, usize), Arc<Chunk>)>,
    pages: Vec<(usize, Arc<Values>)>,
}

impl Cursor {
    pub(crate) fn chunk(&mut self, page: usize, index: usize) -> Option<Arc<Chunk>> {
        let at = self.chunks.iter().rposition(|(key, _)| *key == (page, index))?;
        let chunk = self.chunks.remove(at);
        self.chunks.push(chunk.clone());
        Some(chunk.1)
    }

    pub(crate) fn keep(&mut self, page: usize, index: usize, chunk: Chunk) -> Arc<Chunk> {
        let chunk = Arc::new(chunk);
        self.chunks.push(((page, index), chunk.clone()));
        while self.chunks.len() > MAX_CHUNKS
            || self.chunks.len() > 1
                && self.chunks.iter().map(|(_, chunk)| held(chunk)).sum::<usize>() > MAX_BYTES
        {
            self.chunks.remove(0);
        }
        chunk
    }

    pub(crate) fn page(&mut self, page: usize) -> Option<Arc<Values>> {
        self.pages.iter().find(|(key, _)| *key == page).map(|(_, values)| values.clone())
    }

    pub(crate) fn keep_page(&mut self, page: usize, values: Values) -> Arc<Values> {
        let values = Arc::new(values);
        if self.pages.len() == MAX_PAGES {
            self.pages.remove(0);
        }
        self.pages.push((page, values.clone()));
        values
    }
}
