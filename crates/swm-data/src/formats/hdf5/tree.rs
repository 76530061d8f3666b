//! Arrays in the groups of an HDF5 file of another program. As for our own layout, only what lies in the file itself is read: no link by
//! name is followed, and no value of another file.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use hdf5_metno as h5;
use hdf5_metno::types::{IntSize, TypeDescriptor};
use hdf5_metno::{IndexType, IterationOrder, LinkType, LocationType};
use swm_core::{Dtype, Field, SliceMut};

use super::attributes::text;
use super::handles::library_error;
use super::layout::element_of;
use super::members::{Members, foreign_part};
use super::reader::{MAX_ROW_BYTES, open_library};
use super::storage::{ColumnStorage, Scratch};
use super::superblock;
use crate::dataset::Steps;
use crate::error::{DataError, Result, invalid, missing, unsupported};
use crate::formats::element::Element;

/// Groups are nested less deeply.
const MAX_DEPTH: usize = 16;
/// Why what a link by name leads to is no column.
const LINKED: &str = "it is a soft or an external link, which is not followed; copy what it leads to into its place (in h5py: `del group[name]`, \
     then `group.copy(source, group, name)`)";
/// Members of a group that are looked at.
const MAX_MEMBERS: usize = 1 << 20;

/// An open file, whose groups are walked.
#[derive(Clone, Debug)]
pub struct Tree {
    library: h5::File,
    file: Arc<File>,
    length: u64,
}

/// An array of numbers, marks or texts.
#[derive(Debug)]
pub struct Table {
    field: Field,
    rows: usize,
    storage: ColumnStorage,
    file: Arc<File>,
}

/// An array whose rows are lists of bytes, each of any length: encoded images.
#[derive(Debug)]
pub struct Bytes {
    rows: usize,
    storage: ColumnStorage,
    file: Arc<File>,
}

impl Tree {
    /// Opens a file.
    ///
    /// # Errors
    ///
    /// It is another file, was cut short, or cannot be opened.
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let unclean = superblock::ensure_readable(path)?.is_unclean();
        let library = open_library(path, unclean)?;
        let io = |source| DataError::io(path, "open", source);
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        Ok(Self { library, file: Arc::new(file), length })
    }

    /// The groups and the arrays in a group, by name, as bytes are sorted; the root is `/`.
    ///
    /// # Errors
    ///
    /// There is no such group, or it cannot be read.
    pub fn members(&self, group: &str) -> Result<(Vec<String>, Vec<String>)> {
        self.entries(group).map(|[groups, tables, _]| (groups, tables))
    }

    /// The soft and external links in a group, by name, which are not followed.
    ///
    /// # Errors
    ///
    /// As of [`Tree::members`].
    pub fn links(&self, group: &str) -> Result<Vec<String>> {
        self.entries(group).map(|[.., linked]| linked)
    }

    /// Names in it as signs of a layout.
    pub(super) fn names(&self) -> Vec<String> {
        Members::names(&self.library)
    }

    /// The groups, the arrays and the links by name in a group.
    fn entries(&self, group: &str) -> Result<[Vec<String>; 3]> {
        let group = self.library.group(group).map_err(library_error)?;
        let links = group.links(IndexType::Name, IterationOrder::Native).map_err(library_error)?;
        let [mut groups, mut tables, mut linked] = [const { Vec::new() }; 3];
        // A link by name may lead to another file.
        for (name, link) in links.into_iter().take(MAX_MEMBERS) {
            if name.contains('/') {
                continue;
            }
            if link.link_type != LinkType::Hard {
                linked.push(name);
                continue;
            }
            match group.loc_type_by_name(&name).map_err(library_error)? {
                LocationType::Group => groups.push(name),
                LocationType::Dataset => tables.push(name),
                _ => {}
            }
        }
        groups.sort();
        tables.sort();
        linked.sort();
        Ok([groups, tables, linked])
    }

    /// Paths of all arrays below a group, which is at this path, relative to it, and of links by name, which are refused when they are
    /// opened.
    ///
    /// # Errors
    ///
    /// As of [`Tree::members`]; groups are nested too deeply, or hold too many arrays.
    pub fn tables(&self, group: &str) -> Result<Vec<String>> {
        let mut found = Vec::new();
        self.walk(group, "", 0, &mut found)?;
        Ok(found)
    }

    fn walk(&self, group: &str, below: &str, depth: usize, found: &mut Vec<String>) -> Result<()> {
        if depth > MAX_DEPTH || found.len() > MAX_MEMBERS {
            return Err(unsupported(format!(
                "its groups are nested more than {MAX_DEPTH} deep, or hold more than {MAX_MEMBERS} arrays: `{below}`; where it is a hard \
                 link to a group that it is in, delete it (in h5py: `del group[name]`)"
            )));
        }
        let [groups, tables, linked] = self.entries(&format!("{group}/{below}"))?;
        found.extend(tables.iter().chain(&linked).map(|name| format!("{below}{name}")));
        for name in groups {
            self.walk(group, &format!("{below}{name}/"), depth + 1, found)?;
        }
        Ok(())
    }

    /// An array of a group; parts of the path below it are links of the file itself.
    fn dataset(&self, group: &str, below: &str) -> Result<h5::Dataset> {
        let mut at = self.library.group(group).map_err(library_error)?;
        let mut parts = below.split('/').peekable();
        while let Some(part) = parts.next() {
            let links = at.links(IndexType::Name, IterationOrder::Native).map_err(library_error)?;
            let link = links.into_iter().find(|(name, _)| name == part);
            match link.map(|(_, link)| link.link_type) {
                Some(LinkType::Hard) => {}
                Some(_) => return Err(unsupported(LINKED)),
                None => return Err(missing(format!("`{below}` is not in `{group}`"))),
            }
            if parts.peek().is_none() {
                let dataset = at.dataset(part).map_err(library_error)?;
                return match foreign_part(&dataset)? {
                    None => Ok(dataset),
                    Some(reason) => Err(unsupported(reason)),
                };
            }
            at = at.group(part).map_err(library_error)?;
        }
        Err(invalid("an array has no name"))
    }

    /// An array of a group.
    ///
    /// # Errors
    ///
    /// It is missing, no array of rows, of a type that is not read, behind a link by name, or was cut short.
    pub fn table(&self, group: &str, below: &str) -> Result<Table> {
        let dataset = self.dataset(group, below)?;
        let shape = dataset.space().map_err(library_error)?.shape();
        let element = element_of(&dataset.dtype().map_err(library_error)?)?;
        let Some((&rows, shape)) = shape.split_first() else {
            return Err(unsupported("it is a single value, not one per row"));
        };
        let bytes = shape.iter().try_fold(element.size().unwrap_or(1), |all, &size| all.checked_mul(size));
        match bytes {
            Some(0) => return Err(unsupported(format!("its rows are empty, {shape:?}"))),
            Some(bytes) if bytes <= MAX_ROW_BYTES => {}
            _ => return Err(invalid(format!("a row has the shape {shape:?}"))),
        }
        let field = Field::step(below, element.dtype(), shape);
        let storage =
            ColumnStorage::of(dataset, &field, element, rows, self.length).map_err(library_error)?;
        if let Some(row) = storage.first_row_behind(self.length).filter(|&row| row < rows) {
            return Err(invalid(format!("it was cut short: row {row} lies behind its end")));
        }
        if let Some(reason) = storage.unread_text(rows) {
            return Err(unsupported(reason));
        }
        Ok(Table { field, rows, storage, file: self.file.clone() })
    }

    /// An array of a group whose rows are lists of bytes; `None` if it is none.
    ///
    /// # Errors
    ///
    /// As of [`Tree::table`].
    pub fn bytes(&self, group: &str, below: &str) -> Result<Option<Bytes>> {
        let dataset = self.dataset(group, below)?;
        let kind = dataset.dtype().map_err(library_error)?.to_descriptor();
        let is_bytes = matches!(kind, Ok(TypeDescriptor::VarLenArray(inner)) if *inner == TypeDescriptor::Unsigned(IntSize::U1));
        if !is_bytes || dataset.ndim() != 1 {
            return Ok(None);
        }
        // References, as those of texts.
        let (element, rows) = (Element::Text, dataset.size());
        let field = Field::step(below, element.dtype(), &[]);
        let storage =
            ColumnStorage::of(dataset, &field, element, rows, self.length).map_err(library_error)?;
        match rows > 0 && storage.is_by_library() {
            true => Err(unsupported("lists of bytes are not read in such chunks or with such filters")),
            false => Ok(Some(Bytes { rows, storage, file: self.file.clone() })),
        }
    }

    /// A text in an attribute of a group; `None` if there is no such attribute, or it is no text.
    ///
    /// # Errors
    ///
    /// There is no such group, or the text cannot be read.
    pub fn attribute(&self, group: &str, name: &str) -> Result<Option<String>> {
        let attribute = self.library.group(group).and_then(|group| group.attr(name));
        attribute.map_or(Ok(None), |attribute| text(&attribute, &self.file))
    }
}

impl Table {
    /// The type of its columns.
    #[must_use]
    pub fn dtype(&self) -> Dtype {
        self.field.dtype
    }

    /// Of one row.
    #[must_use]
    pub fn shape(&self) -> &[usize] {
        &self.field.shape
    }

    /// Its rows.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "rows are counted, and no caller asks for none")]
    pub fn len(&self) -> usize {
        self.rows
    }

    /// Whether the file has numbers of u64, of which some may be none of the i64 that columns hold.
    #[must_use]
    pub fn is_u64(&self) -> bool {
        self.storage.element() == Element::U64
    }

    /// Reads rows that exist into `out`, which fits.
    ///
    /// # Errors
    ///
    /// They are damaged, or hold values that columns do not.
    pub fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        self.storage.read(&self.file, &self.field, rows, out, scratch)
    }
}

impl Bytes {
    /// Its rows.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "rows are counted, and no caller asks for none")]
    pub fn len(&self) -> usize {
        self.rows
    }

    /// The bytes of some rows.
    ///
    /// # Errors
    ///
    /// They are damaged.
    pub fn read(&self, first: usize, count: usize) -> Result<Vec<Vec<u8>>> {
        self.storage.read_lists(&self.file, Steps { first, count, stride: 1 }, &mut Scratch::default())
    }
}
