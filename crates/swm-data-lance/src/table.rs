//! A Lance table as a folder: its newest manifest, and committing the next one. A manifest appears whole or not at all,
//! under a name that tells its version, so that what it lists is what counts. Rows are `data_file`'s affair.

use std::collections::{HashMap, HashSet};
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, OnceLock};

use lance_core::datatypes::Schema;
use lance_file::format::{MAGIC, MAJOR_VERSION, MINOR_VERSION};
use lance_file::version::ConcreteFileVersion;
use lance_io::object_store::ObjectStore;
use lance_io::traits::WriteExt as _;
use lance_table::format::{DataStorageFormat, Fragment, Manifest};
use lance_table::io::commit::ManifestNamingScheme;
use lance_table::io::deletion::read_deletion_file;
use lance_table::io::manifest::{read_manifest, write_manifest};
use object_store::path::Path as ObjectPath;
use swm_data::error::{At as _, FormatError, Result, guarded, invalid, missing, unsupported};
use swm_files::sync;
use tokio::runtime::{Builder, Runtime};

/// The version of data files that is written; the first that has today's encodings, and still the most widely read.
pub(crate) const FILE_VERSION: ConcreteFileVersion = ConcreteFileVersion::V2_1;
/// Where manifests lie.
const VERSIONS: &str = "_versions";
/// Where rows lie.
pub(crate) const DATA: &str = "data";
/// In the description of a table: the version after which a recording goes on.
const MARK: &str = "swm.recording";
/// A longer list of deleted rows is taken for damage.
const MAX_DELETED: usize = 1 << 26;
/// Manifests that stay: a reader may have chosen one that is not the newest any more.
const KEPT: usize = 2;
/// Of the listed files, this part may be missing in the newest manifest.
const LAG: usize = 64;

/// A table at one version.
#[derive(Debug)]
pub(crate) struct Table {
    pub(crate) folder: PathBuf,
    pub(crate) store: Arc<ObjectStore>,
    base: ObjectPath,
    manifest: Manifest,
    /// How many of its fragments the newest manifest lists.
    listed: usize,
    /// How many of its fragments are on the disk for certain, as far as this program wrote them.
    synced: usize,
}

impl Table {
    /// Whether there is one.
    pub(crate) fn exists(folder: &Path) -> bool {
        !versions(folder).is_empty()
    }

    /// Opens the newest version.
    pub(crate) fn open(folder: &Path) -> Result<Self> {
        let (store, base) = place(folder)?;
        let (version, name) = versions(folder).pop().ok_or(missing("it has no manifest"))?;
        let path = base.clone().join(VERSIONS).join(name.as_str());
        let manifest = wait(read_manifest(&store, &path, None))?;
        if manifest.version != version {
            return Err(invalid(format!("its manifest {name} is of version {}", manifest.version)));
        }
        let listed = manifest.fragments.len();
        let (folder, store) = (folder.to_owned(), Arc::new(store));
        let table = Self { folder, store, base, manifest, listed, synced: listed };
        table.fragments().iter().try_for_each(check_fragment)?;
        // Lance knows what the types are called, but not what to do about others.
        guarded(|| {
            table.schema().fields_pre_order().for_each(|field| drop(field.data_type()));
            Ok(())
        })?;
        Ok(table)
    }

    /// Makes a table without rows, in a folder that has none; a recording into it begins.
    pub(crate) fn create(folder: &Path, schema: Schema, about: HashMap<String, String>) -> Result<Self> {
        for name in [DATA, VERSIONS] {
            fs::create_dir_all(folder.join(name))?;
        }
        let (store, base) = place(folder)?;
        let fragments = Arc::new(Vec::new());
        let mut manifest =
            Manifest::new(schema, fragments, DataStorageFormat::new(FILE_VERSION), HashMap::new());
        manifest.table_metadata = about;
        let (folder, store) = (folder.to_owned(), Arc::new(store));
        let mut table = Self { folder, store, base, manifest, listed: 0, synced: 0 };
        table.write(true)?;
        Ok(table)
    }

    pub(crate) fn schema(&self) -> &Schema {
        &self.manifest.schema
    }

    pub(crate) fn fragments(&self) -> &[Fragment] {
        &self.manifest.fragments
    }

    /// The description of the table, by key.
    pub(crate) fn about(&self) -> &HashMap<String, String> {
        &self.manifest.table_metadata
    }

    /// A file below the folder, as Lance calls it.
    pub(crate) fn path(&self, name: &str) -> ObjectPath {
        name.split('/').fold(self.base.clone(), ObjectPath::join)
    }

    /// Whether files that were committed later than the newest manifest belong to the table, see `committed`.
    pub(crate) fn is_being_recorded(&self) -> bool {
        self.manifest.table_metadata.get(MARK) == Some(&self.manifest.version.to_string())
    }

    /// Whether a program has deleted rows.
    pub(crate) fn has_deletions(&self) -> bool {
        self.fragments().iter().any(|fragment| fragment.deletion_file.is_some())
    }

    /// The rows of a fragment that are deleted, in order.
    pub(crate) fn deleted(&self, fragment: &Fragment) -> Result<Vec<u32>> {
        let Some(file) = &fragment.deletion_file else { return Ok(Vec::new()) };
        let deleted = wait(read_deletion_file(fragment.id, file, &self.base, &self.store))?;
        if deleted.len() > MAX_DELETED {
            return Err(invalid(format!("its list of deleted rows has {} entries", deleted.len())));
        }
        let mut deleted: Vec<u32> = deleted.into_iter().collect();
        deleted.sort_unstable();
        Ok(deleted)
    }

    /// Deletes rows of a fragment as other programs do, for tests of reading such tables.
    #[cfg(test)]
    pub(crate) fn delete(&mut self, fragment: usize, rows: impl Iterator<Item = u32>) -> Result<()> {
        use lance_core::utils::deletion::DeletionVector;
        let (version, id) = (self.manifest.version, self.fragments()[fragment].id);
        let rows = DeletionVector::from_iter(rows);
        let file = wait(lance_table::io::deletion::write_deletion_file(
            &self.base,
            id,
            version,
            &rows,
            &self.store,
        ))?;
        Arc::make_mut(&mut self.manifest.fragments)[fragment].deletion_file = file;
        self.next(false)
    }

    /// What a new fragment is to be called.
    pub(crate) fn next_id(&self) -> u64 {
        self.fragments().iter().map(|fragment| fragment.id + 1).max().unwrap_or(0)
    }

    /// Adds a fragment that no manifest lists yet.
    pub(crate) fn push(&mut self, fragment: Fragment) {
        Arc::make_mut(&mut self.manifest.fragments).push(fragment);
    }

    /// Adds a fragment, and lists it in a new version when one is due.
    pub(crate) fn commit(&mut self, fragment: Fragment) -> Result<()> {
        self.push(fragment);
        if is_due(self.listed, self.fragments().len()) { self.next(true) } else { Ok(()) }
    }

    /// Makes the first `count` fragments the newest version, with which a recording begins; `about` replaces the
    /// description of the table.
    pub(crate) fn resume(&mut self, count: usize, about: Option<HashMap<String, String>>) -> Result<()> {
        Arc::make_mut(&mut self.manifest.fragments).truncate(count);
        self.synced = self.synced.min(count);
        if let Some(about) = about {
            self.manifest.table_metadata = about;
        }
        self.next(true)
    }

    /// Lists everything, and ends the recording.
    pub(crate) fn close(&mut self) -> Result<()> {
        self.next(false)?;
        self.sync()
    }

    /// Brings the files of rows that are new, the newest manifest and their folders from the system's memory to the disk.
    pub(crate) fn sync(&mut self) -> Result<()> {
        let (data, manifests) = (self.folder.join(DATA), self.folder.join(VERSIONS));
        let new = &self.fragments()[self.synced.min(self.fragments().len())..];
        let mut files: Vec<PathBuf> =
            new.iter().flat_map(|fragment| &fragment.files).map(|file| data.join(&file.path)).collect();
        files.extend(versions(&self.folder).pop().map(|(_, name)| manifests.join(name)));
        // The folders themselves last: with them, what they name is part of the table.
        sync(&files)?;
        sync(&[data, manifests])?;
        self.synced = self.fragments().len();
        Ok(())
    }

    /// The fragments that are there now become the next version.
    fn next(&mut self, is_being_recorded: bool) -> Result<()> {
        let (schema, fragments) = (self.manifest.schema.clone(), self.manifest.fragments.clone());
        self.manifest = Manifest::new_from_previous(&self.manifest, schema, fragments);
        self.manifest.update_max_fragment_id();
        self.write(is_being_recorded)
    }

    /// Writes the manifest, then forgets older ones.
    fn write(&mut self, is_being_recorded: bool) -> Result<()> {
        let version = self.manifest.version.to_string();
        match is_being_recorded {
            true => self.manifest.table_metadata.insert(MARK.to_owned(), version),
            false => self.manifest.table_metadata.remove(MARK),
        };
        let path = ManifestNamingScheme::V2.manifest_path(&self.base, self.manifest.version);
        wait(async {
            let mut writer = self.store.create(&path).await?;
            let at = write_manifest(&mut *writer, &mut self.manifest, None, None).await?;
            writer.write_magics(at, MAJOR_VERSION, MINOR_VERSION, MAGIC).await?;
            writer.shutdown().await
        })?;
        self.listed = self.fragments().len();
        let mut all = versions(&self.folder);
        all.truncate(all.len().saturating_sub(KEPT));
        for (_, name) in all {
            // An old version that stays costs space only.
            let _ = fs::remove_file(self.folder.join(VERSIONS).join(name));
        }
        Ok(())
    }

    /// Files of rows that are not of the table: what an interrupted recording left.
    pub(crate) fn leftovers(&self) -> Vec<PathBuf> {
        let data = self.folder.join(DATA);
        let files = self.fragments().iter().flat_map(|fragment| &fragment.files);
        let listed: HashSet<PathBuf> = files.map(|file| data.join(&file.path)).collect();
        let entries = fs::read_dir(&data).into_iter().flatten().flatten();
        let mut left: Vec<PathBuf> = entries
            .map(|entry| entry.path())
            .filter(|path| path.is_file() && !listed.contains(path))
            .collect();
        left.sort();
        left
    }

    /// Removes a table from its folder; first that by which it is one.
    pub(crate) fn remove(folder: &Path) -> io::Result<()> {
        for name in [VERSIONS, DATA, "_transactions", "_indices", "_deletions"] {
            let part = folder.join(name);
            if part.is_dir() {
                fs::remove_dir_all(&part)?;
            }
        }
        Ok(())
    }
}

/// Whether a manifest is to be written, of `listed` files in the last one and `all` now.
fn is_due(listed: usize, all: usize) -> bool {
    (all - listed) * LAG >= listed
}

/// Manifests by version, the newest last.
fn versions(folder: &Path) -> Vec<(u64, String)> {
    let entries = fs::read_dir(folder.join(VERSIONS)).into_iter().flatten().flatten();
    let named = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let version = ManifestNamingScheme::detect_scheme(&name)?.parse_version(&name)?;
        Some((version, name))
    });
    let mut versions: Vec<_> = named.collect();
    versions.sort();
    versions
}

/// The folder in Lance's terms.
fn place(folder: &Path) -> Result<(ObjectStore, ObjectPath)> {
    let folder = fs::canonicalize(folder)?;
    let base = ObjectPath::from_absolute_path(&folder).map_err(FormatError::other)?;
    Ok((ObjectStore::local(), base))
}

/// What Lance can, and its files alone cannot: rows that are replaced elsewhere, files that lie elsewhere.
fn check_fragment(fragment: &Fragment) -> Result<()> {
    if !fragment.overlays.is_empty() {
        let fix = "rewrite it with `lance.dataset(…).optimize.compact_files()`";
        return Err(unsupported(format!("rows of it were replaced; {fix}")));
    }
    if fragment.deletion_file.as_ref().is_some_and(|file| file.base_id.is_some()) {
        return Err(invalid("its list of deleted rows is none inside the folder"));
    }
    for file in &fragment.files {
        let plain = Path::new(&file.path).components().all(|part| matches!(part, Component::Normal(_)));
        if !plain || file.path.contains(['\\', '\0']) || file.base_id.is_some() {
            return Err(invalid(format!(
                "it names the file `{}`, which is none inside the folder",
                file.path
            )));
        }
    }
    Ok(())
}

/// Waits for Lance, on this thread; what it starts besides runs on threads of its own.
pub(crate) fn wait<T>(work: impl Future<Output = lance_core::Result<T>>) -> Result<T> {
    static RUNTIME: OnceLock<io::Result<Runtime>> = OnceLock::new();
    let runtime = RUNTIME
        .get_or_init(|| Builder::new_multi_thread().worker_threads(2).thread_name("swm-lance").build());
    let started = runtime.as_ref().map_err(|error| io::Error::new(error.kind(), error.to_string()));
    let _context = started.at("no thread can be started")?.enter();
    guarded(|| futures::executor::block_on(work).map_err(|error| FormatError::other(LanceError(error))))
}

/// An error of Lance, shown without the place in its sources.
#[derive(Debug, thiserror::Error)]
#[error("{}", reason(&.0.to_string()))]
struct LanceError(#[source] lance_core::Error);

fn reason(text: &str) -> String {
    let end = text.rfind(".rs:").and_then(|at| text[..at].rfind(", "));
    end.map_or(text, |end| &text[..end]).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_do_not_name_sources() {
        assert_eq!(
            reason("LanceError(IO): no such file, src/lance-io/src/local.rs:12:3"),
            "LanceError(IO): no such file"
        );
        assert_eq!(reason("no such file, or folder"), "no such file, or folder");
    }

    #[test]
    fn files_that_lie_elsewhere_are_refused() {
        let fragment = |path: &str| Fragment::new(0).with_file(path, vec![0], vec![0], FILE_VERSION, None);
        assert!(check_fragment(&fragment("a.lance")).is_ok());
        for path in ["../a.lance", "/etc/passwd", "a/../../b.lance", "a\\b"] {
            let error = check_fragment(&fragment(path)).unwrap_err().to_string();
            assert!(error.contains("none inside"), "{path}: {error}");
        }
    }

    #[test]
    fn manifests_become_rare_as_tables_grow() {
        let (mut listed, mut entries, mut manifests) = (0, 0, 0);
        for all in 1..=10_000 {
            if is_due(listed, all) {
                (listed, entries, manifests) = (all, entries + all, manifests + 1);
            }
            assert!(all - listed <= 1 + all / LAG, "{all}: {listed}");
        }
        assert!(entries < 2 * LAG * 10_000 && manifests < 500, "{entries} {manifests}");
    }
}
