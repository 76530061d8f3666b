//! An object that is read by position: by blocks, which are kept on disk.

use std::collections::VecDeque;
use std::io;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;

use sha2::{Digest as _, Sha256};

use super::blocks::BLOCK;
use super::client::{Link, Version};
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::found::Remote;
use super::sign::hex;

/// Blocks that an object keeps in memory.
const RECENT: usize = 16;
/// Blocks that are fetched at once, in parallel.
const AT_ONCE: u64 = 8;

/// A version of an object. All of its readers read that one.
#[derive(Debug)]
pub struct Object {
    pub(super) remote: Arc<Remote>,
    pub(super) link: Link,
    pub(super) version: Version,
    /// What tells this version from all that is kept on disk.
    pub(super) key: String,
    /// Whether parts of it can be asked for.
    is_ranged: bool,
    /// Whether something tells its versions apart.
    pub(super) is_versioned: bool,
    /// Its hash, where a list has it.
    pub(super) sha256: Option<String>,
    recent: Mutex<Recent>,
}

#[derive(Debug, Default)]
struct Recent {
    blocks: VecDeque<(u64, Arc<Vec<u8>>)>,
    /// The block behind the last one that was read.
    next: u64,
    /// Blocks that are fetched ahead, while all are read in order.
    ahead: u64,
}

impl Recent {
    fn push(&mut self, index: u64, block: Arc<Vec<u8>>) {
        if self.blocks.len() == RECENT {
            self.blocks.pop_front();
        }
        self.blocks.push_back((index, block));
        self.next = index + 1;
    }
}

impl Object {
    /// The object behind an address, whose first block is fetched. `commit` says that the address holds its version.
    pub(super) fn probe(remote: &Arc<Remote>, link: Link, commit: Option<&str>) -> Result<Self, RemoteError> {
        let mut first = Vec::new();
        let head = remote.client.read(&link, 0..BLOCK, None, &mut first)?;
        let tag = head.version.tag.filter(|_| commit.is_none());
        let version = Version { tag: tag.clone(), ..head.version };
        let own = tag.as_deref().or(commit);
        let nonce = || format!("{}-{:?}", std::process::id(), super::now());
        let key = key(&link, version.length, &own.map_or_else(nonce, str::to_owned));
        let object = Self::known(remote, link, version, key, None);
        let object = Self { is_ranged: head.is_ranged, is_versioned: own.is_some(), ..object };
        if object.version.length > 0 {
            object.remote.blocks.put(&object.key, 0, &first);
            object.recent().push(0, Arc::new(first));
        }
        Ok(object)
    }

    /// An object of a list.
    pub(super) fn known(
        remote: &Arc<Remote>,
        link: Link,
        version: Version,
        key: String,
        sha256: Option<String>,
    ) -> Self {
        let remote = remote.clone();
        Self {
            remote,
            link,
            version,
            key,
            is_ranged: true,
            is_versioned: true,
            sha256,
            recent: Mutex::default(),
        }
    }

    fn recent(&self) -> MutexGuard<'_, Recent> {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Its bytes.
    #[must_use]
    pub fn length(&self) -> u64 {
        self.version.length
    }

    /// Whether it is of use to read parts of it.
    #[must_use]
    pub fn is_by_position(&self) -> bool {
        self.is_ranged || self.version.length <= BLOCK
    }

    pub(super) fn is_ranged(&self) -> bool {
        self.is_ranged
    }

    /// Fills `out` with the bytes from `at` on.
    ///
    /// # Errors
    ///
    /// It ends before, cannot be reached, or was changed after it was opened.
    pub fn read_exact_at(&self, out: &mut [u8], at: u64) -> io::Result<()> {
        let end = at.checked_add(out.len() as u64).filter(|&end| end <= self.version.length);
        let end = end.ok_or(io::ErrorKind::UnexpectedEof)?;
        let mut done = 0;
        while done < out.len() {
            let place = at + done as u64;
            let block = self.block(place / BLOCK, (end - 1) / BLOCK)?;
            let from = (place % BLOCK) as usize;
            let count = block.len().saturating_sub(from).min(out.len() - done);
            if count == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            out[done..done + count].copy_from_slice(&block[from..from + count]);
            done += count;
        }
        Ok(())
    }

    /// A block; of those up to `last`, some are fetched with it.
    fn block(&self, index: u64, last: u64) -> Result<Arc<Vec<u8>>, RemoteError> {
        let ahead = {
            let mut recent = self.recent();
            if let Some((_, block)) = recent.blocks.iter().find(|(there, _)| *there == index) {
                return Ok(block.clone());
            }
            recent.ahead = if index == recent.next { (recent.ahead * 2).clamp(1, AT_ONCE) } else { 1 };
            recent.ahead.max((last - index + 1).min(AT_ONCE))
        };
        if let Some(bytes) = self.remote.blocks.get(&self.key, index, self.size(index)) {
            let block = Arc::new(bytes);
            self.recent().push(index, block.clone());
            return Ok(block);
        }
        let all = self.version.length.div_ceil(BLOCK);
        let is_missing = |at: &u64| *at == index || !self.remote.blocks.has(&self.key, *at);
        let wanted: Vec<u64> = (index..all.min(index + ahead)).take_while(is_missing).collect();
        let fetched = self.fetch(&wanted)?;
        let mut recent = self.recent();
        for (&at, block) in wanted.iter().zip(&fetched) {
            recent.push(at, block.clone());
        }
        let first = fetched.into_iter().next();
        first.ok_or_else(|| {
            RemoteError::new(Kind::Answer, &self.link.name, "it has no such bytes", "open it again")
        })
    }

    /// Bytes of a block.
    fn size(&self, index: u64) -> usize {
        self.version.length.saturating_sub(index * BLOCK).min(BLOCK) as usize
    }

    fn fetch(&self, wanted: &[u64]) -> Result<Vec<Arc<Vec<u8>>>, RemoteError> {
        let one = |index: u64| -> Result<Arc<Vec<u8>>, RemoteError> {
            let (start, size) = (index * BLOCK, self.size(index));
            let mut bytes = Vec::with_capacity(size);
            self.remote.client.read(
                &self.link,
                start..start + size as u64,
                Some(&self.version),
                &mut bytes,
            )?;
            self.remote.blocks.put(&self.key, index, &bytes);
            Ok(Arc::new(bytes))
        };
        if let &[index] = wanted {
            return Ok(vec![one(index)?]);
        }
        thread::scope(|scope| {
            let threads: Vec<_> = wanted.iter().map(|&index| scope.spawn(move || one(index))).collect();
            let failed = || {
                RemoteError::new(
                    Kind::Network,
                    &self.link.name,
                    "a thread that fetched it failed",
                    "run it again",
                )
            };
            threads.into_iter().map(|thread| thread.join().unwrap_or_else(|_| Err(failed()))).collect()
        })
    }
}

/// What tells a version of an object from all others.
pub(super) fn key(link: &Link, length: u64, version: &str) -> String {
    hex(&Sha256::digest(format!("{}\0{length}\0{version}", link.url)))[..32].to_owned()
}
