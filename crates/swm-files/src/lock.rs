//! One writer at a time: a lock file beside the dataset, locked through the operating system, which frees it when
//! the process ends in any way. The file says who holds it, for the message to the next; one that is left behind by a kill
//! does no harm. Readers need no lock.
//!
//! Some file systems of clusters have no such locks. There the file itself is the lock: it is made exclusively, its owner renews its time
//! while it lives ([`Heartbeat`]), and one that nobody has renewed for a while is taken over.

use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek as _, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use swm_core::dataset::DataError;

use crate::atomic_write::{draft, new_file};
use crate::folders::{beside, folder_of};
use crate::open::{identity, open_own};

/// A lock file above this size is not ours.
const MAX_BYTES: u64 = 4096;

/// Looks at a lock file that others make and remove.
const MAX_TRIES: usize = 1000;

/// Looks, a millisecond apart, for the name of an owner who has just taken a lock.
const MAX_LOOKS: usize = 200;

/// Held while a writer lives; removes the lock file when dropped.
#[derive(Debug)]
pub struct WriterLock {
    path: PathBuf,
    file: File,
    /// Where the file system has no locks.
    heartbeat: Option<Heartbeat>,
}

impl WriterLock {
    /// Takes the lock of the dataset at `dataset`.
    ///
    /// # Errors
    ///
    /// [`DataError::Busy`]: another writer has it, who is named; or the file of the lock cannot be made.
    pub fn take(dataset: &Path) -> Result<Self, DataError> {
        Self::take_file(beside(dataset, ".lock"), dataset)
    }

    /// Takes the lock of a folder that one process at a time writes to, in its file `lock`.
    ///
    /// # Errors
    ///
    /// As of [`WriterLock::take`].
    pub fn take_within(folder: &Path) -> Result<Self, DataError> {
        Self::take_file(folder.join("lock"), folder)
    }

    /// Takes the lock in the file `path`; messages name `dataset`.
    fn take_file(path: PathBuf, dataset: &Path) -> Result<Self, DataError> {
        let failed = |source| DataError::io(dataset, "create", source);
        let busy = |holder: Option<Holder>| DataError::Busy {
            path: dataset.to_owned(),
            holder: holder.map_or_else(|| "another process".to_owned(), |holder| holder.to_string()),
        };
        let mut tries = 0;
        loop {
            tries += 1;
            let file = match open_own(&path, true) {
                // Another writer made or removed it between two looks at it.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists && tries < MAX_TRIES => continue,
                // Nothing can be made in a folder that was removed under this process, and in some of the system.
                Err(error)
                    if error.kind() == io::ErrorKind::NotFound
                        && tries < MAX_TRIES
                        && folder_of(&path).is_dir() =>
                {
                    continue;
                }
                Err(error) if error.kind() == io::ErrorKind::Other => {
                    return Err(DataError::io(&path, "lock", error));
                }
                opened => opened.map_err(failed)?,
            };
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(busy(Holder::read_soon(&file))),
                Err(TryLockError::Error(error)) if has_no_locks(&error) => {
                    drop(file);
                    return match by_file(&path).map_err(failed)? {
                        Ok((file, heartbeat)) => Ok(Self { path, file, heartbeat: Some(heartbeat) }),
                        Err(holder) => Err(busy(holder)),
                    };
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
            // The former owner may have removed the file between our open and our lock: then take the new one.
            if is_at(&file, &path) {
                // On a full disk it is a lock without a name.
                let _ = file.set_len(0).and_then(|()| Holder::this().write(&file));
                return Ok(Self { path, file, heartbeat: None });
            }
        }
    }

    /// The writer of the dataset at `dataset`, if it is a process of this machine that has not ended: `process 123 on host`. Writers
    /// on other machines are not found. Nothing is locked, so that nobody is kept from writing.
    #[must_use]
    pub fn holder_here(dataset: &Path) -> Option<String> {
        let file = open_own(&beside(dataset, ".lock"), false).ok()?;
        Holder::read(&file).filter(Holder::lives_here).map(|holder| holder.to_string())
    }
}

impl Drop for WriterLock {
    fn drop(&mut self) {
        // Where there are no locks, somebody may have taken it over while this process was stopped for long.
        if self.heartbeat.take().is_some() && !is_at(&self.file, &self.path) {
            return;
        }
        // The lock is still held here, so this removes no other writer's file. If it fails, the file does no harm.
        let _ = fs::remove_file(&self.path);
        // Closing is not enough while a child process that is being started still has a copy of the handle.
        let _ = self.file.unlock();
    }
}

/// Whether a lock failed because the file system has none: Lustre, NFS or FUSE, as they are mounted on some clusters.
#[must_use]
pub fn has_no_locks(error: &io::Error) -> bool {
    // ENOLCK, ENOSYS and EOPNOTSUPP of Linux; macOS has other numbers for two of them.
    let numbers: &[i32] = if cfg!(target_os = "linux") { &[37, 38, 95] } else { &[77, 78, 102] };
    error.kind() == io::ErrorKind::Unsupported
        || error.raw_os_error().is_some_and(|number| cfg!(unix) && numbers.contains(&number))
}

/// Whether the file system on which `path` lies, or will lie, has no locks.
#[must_use]
pub fn lacks_locks(path: &Path) -> bool {
    let locks = |file: File| matches!(file.try_lock_shared(), Err(TryLockError::Error(error)) if has_no_locks(&error));
    File::open(path).or_else(|_| File::open(beside(path, ".lock"))).is_ok_and(locks)
}

/// Between two signs of life of an owner.
const BEAT: Duration = Duration::from_secs(10);
/// An owner without a sign for so long has ended: several beats, as file servers can be slow.
const SILENCE: Duration = Duration::from_secs(120);

/// Renews the time of a lock's file until it is dropped.
#[derive(Debug)]
struct Heartbeat {
    /// Its end stops the thread.
    _stop: Sender<()>,
}

impl Heartbeat {
    fn start(file: File) -> io::Result<Self> {
        let (stop, stopped) = channel();
        let beat = move || {
            while stopped.recv_timeout(BEAT) == Err(RecvTimeoutError::Timeout) {
                // The time is the file server's, and not this machine's. A beat that fails is made up for by the next.
                let _ = renew(&file);
            }
        };
        thread::Builder::new().name("lock".to_owned()).spawn(beat)?;
        Ok(Self { _stop: stop })
    }
}

/// Writes the file's content again, so that the file server gives it its present time.
fn renew(mut file: &File) -> io::Result<()> {
    file.seek(SeekFrom::Start(0))?;
    Holder::this().write(file)?;
    file.sync_all()
}

/// Makes the file at `path` exclusively as a lock; else who holds it, as far as that is known. One whose owner has ended is taken over.
fn by_file(path: &Path) -> io::Result<Result<(File, Heartbeat), Option<Holder>>> {
    for _ in 0..MAX_TRIES {
        // The file server's present time is that of a file that is written now.
        let mine = draft(path);
        let file = new_file(&mine)?;
        Holder::this().write(&file)?;
        file.sync_all()?;
        // A second name is given to one process alone, also by file servers for which exclusive creation is none.
        let taken = fs::hard_link(&mine, path);
        let now = file.metadata()?.modified()?;
        match taken {
            Ok(()) => {
                fs::remove_file(&mine)?;
                let heartbeat = Heartbeat::start(file.try_clone()?)?;
                return Ok(Ok((file, heartbeat)));
            }
            Err(error) => {
                drop(file);
                fs::remove_file(&mine)?;
                if error.kind() != io::ErrorKind::AlreadyExists {
                    return Err(error);
                }
            }
        }
        let there = match open_own(path, false) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            there => there?,
        };
        let holder = Holder::read(&there);
        // The file of an owner has its name from the beginning.
        let is_empty = there.metadata()?.len() == 0;
        let silent = now.duration_since(there.metadata()?.modified()?).unwrap_or_default();
        let has_ended = match &holder {
            Some(holder) if holder.host == host() => !holder.lives_here(),
            _ => is_empty || silent > SILENCE,
        };
        if !has_ended {
            return Ok(Err(holder));
        }
        // Of those who take it over, one moves the file that was looked at; who moved another one puts it back.
        if !is_at(&there, path) {
            continue;
        }
        let aside = draft(path);
        match fs::rename(path, &aside) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            renamed => renamed?,
        }
        if !is_at(&there, &aside) {
            let _ = fs::hard_link(&aside, path);
        }
        fs::remove_file(&aside)?;
    }
    Ok(Err(None))
}

/// Who holds a lock: `process 123 on host`.
#[derive(Debug, PartialEq, Eq)]
struct Holder {
    process: u32,
    host: String,
}

impl Holder {
    fn this() -> Self {
        Self { process: std::process::id(), host: host() }
    }

    /// Writes it in one piece, so that nobody reads a part.
    fn write(&self, mut file: &File) -> io::Result<()> {
        file.write_all(format!("{self}\n").as_bytes())
    }

    /// What the file of a lock that is taken says: its owner writes it right after it was taken.
    fn read_soon(mut file: &File) -> Option<Self> {
        for _ in 0..MAX_LOOKS {
            match Self::read(file) {
                Some(holder) => return Some(holder),
                None => thread::sleep(Duration::from_millis(1)),
            }
            file.seek(SeekFrom::Start(0)).ok()?;
        }
        None
    }

    /// What a lock file says; nothing if it is of an older version, or cannot be read while it is locked.
    fn read(file: &File) -> Option<Self> {
        let mut text = String::new();
        file.take(MAX_BYTES).read_to_string(&mut text).ok()?;
        let (process, host) = text.strip_suffix('\n')?.strip_prefix("process ")?.split_once(" on ")?;
        Some(Self { process: process.parse().ok()?, host: host.to_owned() })
    }

    /// Whether it is a process of this machine that has not ended, as far as that can be known.
    fn lives_here(&self) -> bool {
        self.host == host() && Path::new(&format!("/proc/{}", self.process)).exists()
    }
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {} on {}", self.process, self.host)
    }
}

/// The name of this machine.
fn host() -> String {
    let named = fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let named =
        named.or_else(|| std::env::var("COMPUTERNAME").ok()).or_else(|| std::env::var("HOSTNAME").ok());
    match named.as_deref().map(str::trim) {
        None | Some("") => "an unnamed host".to_owned(),
        Some(name) => name.to_owned(),
    }
}

/// Whether `path` still names the open `file`. Where files cannot be told apart, an open one cannot be removed.
pub(crate) fn is_at(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(ours), Ok(there)) => identity(&ours) == identity(&there),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_writer_and_no_traces() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = folder.path().join("a.h5");
        // What a killed writer left.
        fs::write(beside(&dataset, ".lock"), "process 4194305 on elsewhere, with a longer name\n").unwrap();
        assert_eq!(WriterLock::holder_here(&dataset), None);
        let first = WriterLock::take(&dataset).unwrap();
        let message = WriterLock::take(&dataset).unwrap_err().to_string();
        if cfg!(unix) {
            let holder = format!("a.h5 is being written by process {} on {};", std::process::id(), host());
            assert!(message.contains(&holder), "{message}");
            assert_eq!(WriterLock::holder_here(&dataset), Some(Holder::this().to_string()));
        }
        drop(first);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        WriterLock::take(&dataset).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn an_owner_is_named_who_has_not_written_its_name_yet() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = folder.path().join("a.h5");
        let taken = File::create(beside(&dataset, ".lock")).unwrap();
        taken.lock().unwrap();
        let message = thread::scope(|scope| {
            let refused = scope.spawn(|| WriterLock::take(&dataset).unwrap_err().to_string());
            thread::sleep(Duration::from_millis(5));
            Holder::this().write(&taken).unwrap();
            refused.join().unwrap()
        });
        assert!(message.contains(&format!("process {} on ", std::process::id())), "{message}");
        // On a full disk no name is ever written.
        taken.set_len(0).unwrap();
        let message = WriterLock::take(&dataset).unwrap_err().to_string();
        assert!(message.contains("a.h5 is being written by another process;"), "{message}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_folder_in_which_nothing_can_be_made_is_an_error() {
        let message = WriterLock::take(Path::new("/proc/a.h5")).unwrap_err().to_string();
        assert!(message.contains("/proc/a.h5"), "{message}");
    }

    #[test]
    fn a_lock_that_is_a_file_has_one_owner() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5.lock");
        // As it is found where the locks of the system were tried first.
        fs::write(&path, "").unwrap();
        let (file, heartbeat) = by_file(&path).unwrap().unwrap();
        assert_eq!(by_file(&path).unwrap().unwrap_err(), Some(Holder::this()));
        drop((file, heartbeat));
        if cfg!(target_os = "linux") {
            // One of a process of this machine that has ended is free at once, one of another machine after a while.
            fs::write(&path, format!("{}\n", Holder { process: 4_194_305, ..Holder::this() })).unwrap();
            by_file(&path).unwrap().unwrap();
        }
        let elsewhere = Holder { host: "elsewhere".to_owned(), ..Holder::this() };
        fs::write(&path, format!("{elsewhere}\n")).unwrap();
        assert_eq!(by_file(&path).unwrap().unwrap_err(), Some(elsewhere));
        let long_ago = std::time::SystemTime::UNIX_EPOCH;
        File::options().write(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        let (file, _heartbeat) = by_file(&path).unwrap().unwrap();
        assert!(is_at(&file, &path));
        // The present time of the file is that of its last beat.
        file.set_modified(long_ago).unwrap();
        renew(&file).unwrap();
        assert!(file.metadata().unwrap().modified().unwrap() > long_ago);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no draft is left");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn file_systems_without_locks_are_known_by_their_errors() {
        let of = |number| has_no_locks(&io::Error::from_raw_os_error(number));
        assert_eq!([37, 38, 95, 2, 28].map(of), [true, true, true, false, false]);
    }

    #[test]
    fn holders_that_have_ended_are_recognized() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.lock");
        let holder = |text: &str| {
            fs::write(&path, text).unwrap();
            Holder::read(&File::open(&path).unwrap())
        };
        let this = Holder::this();
        assert_eq!(holder(&format!("{this}\n")).as_ref(), Some(&this));
        assert_eq!(this.lives_here(), cfg!(target_os = "linux"));
        // Above the largest process id that Linux gives.
        assert!(!Holder { process: 4_194_305, ..Holder::this() }.lives_here());
        assert!(!Holder { host: "elsewhere".to_owned(), ..Holder::this() }.lives_here());
        for text in ["", "process", "process x on y", "anything else"] {
            assert_eq!(holder(text), None, "{text}");
        }
    }
}
