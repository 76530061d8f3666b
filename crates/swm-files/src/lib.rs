//! Files, on this machine and elsewhere, below every format of datasets: opened with care, replaced as a whole, locked by one writer at a
//! time, read by position, fetched.
//!
//! * [`open_regular`], [`open_beneath`], [`open_own`]: no pipe, nothing outside of a folder, no file of others through a link;
//! * [`replace`], [`draft`], [`settle`]: readers see the old content or the new, also after a loss of power; [`replace_unsynced`] leaves the
//!   disk to a later [`sync`];
//! * [`WriterLock`]: one writer at a time, also where a file system has no locks;
//! * [`Readable`], [`Cursor`]: bytes by position, of a file or of an object that lies elsewhere;
//! * [`remote`]: `https://`, `s3://` and `hf://` (with the feature `remote`);
//! * [`cache_folder`]: where what could be made again is kept.

mod atomic_write;
mod cache_folder;
mod folders;
mod lock;
mod open;
mod read_at;
pub mod remote;

pub use atomic_write::{DRAFT, draft, new_file, replace, replace_unsynced, settle, sync, write_new};
pub use cache_folder::cache_folder;
pub use folders::{beside, first_link, is_plain_name, link_out_of, size};
pub use lock::{WriterLock, has_no_locks, lacks_locks};
pub use open::{
    append_own, begins, identity, is_zip, link_count, open_beneath, open_own, open_regular, read_regular,
};
pub use read_at::{Cursor, ReadAt, Readable, read_exact_at, write_all_at};
