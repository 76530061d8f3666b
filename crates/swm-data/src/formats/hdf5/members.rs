//! Which objects of a file are read: datasets that lie in the file itself. A file can also name others: links to other
//! files, raw values in any file of the machine, datasets made of pieces of other datasets, filters that are loaded from
//! a library. None of these is followed, for the file may come from anywhere; they are left out with the reason.

use hdf5_metno as h5;
use hdf5_metno::dataset::Layout;
use hdf5_metno::filters::Filter;
use hdf5_metno::{IndexType, IterationOrder, LinkType, LocationType};

use super::handles::library_error;
use crate::error::{At as _, Result, guarded, invalid, unsupported};

/// The datasets at the root of a file.
#[derive(Debug, Default)]
pub(super) struct Members {
    /// Those that are read, by name.
    pub(super) datasets: Vec<(String, h5::Dataset)>,
    /// Names of the others, with the reason.
    pub(super) skipped: Vec<(String, String)>,
}

impl Members {
    /// Opens them, in the order of their names. Groups and named types are no columns, and are passed over.
    ///
    /// # Errors
    ///
    /// The list, or the head of an object, is damaged.
    pub(super) fn of(file: &h5::File) -> Result<Self> {
        let links = file.links(IndexType::Name, IterationOrder::Native);
        let mut links = links.map_err(library_error).at("its list of columns")?;
        links.sort_by(|(a, _), (b, _)| a.cmp(b));
        let mut found = Self::default();
        for (name, link) in links {
            let place = format_args!("column `{name}`");
            if link.link_type != LinkType::Hard {
                let reason =
                    "it is a link by name, to another place or file, and such links are not followed";
                found.skipped.push((name, reason.to_owned()));
                continue;
            }
            if file.loc_type_by_name(&name).map_err(library_error).at(place)? != LocationType::Dataset {
                continue;
            }
            let dataset = file.dataset(&name).map_err(library_error).at(place)?;
            match foreign_part(&dataset).map_err(|error| error.at(place))? {
                None => found.datasets.push((name, dataset)),
                Some(reason) => found.skipped.push((name, reason)),
            }
        }
        Ok(found)
    }
}

/// Groups whose members are looked at, and members of each: layouts of others are told by the first.
const LOOKED_AT: usize = 16;

impl Members {
    /// Names of what is at the root, and, as `group/name`, of some objects in groups there. What cannot be listed has none.
    pub(super) fn names(file: &h5::File) -> Vec<String> {
        let links = file.links(IndexType::Name, IterationOrder::Native).unwrap_or_default();
        // A link to another file would open that.
        let own = links.iter().filter(|(_, link)| link.link_type == LinkType::Hard).map(|(name, _)| name);
        let is_group = |name: &&String| matches!(file.loc_type_by_name(name), Ok(LocationType::Group));
        let groups: Vec<String> = own.filter(is_group).take(LOOKED_AT).cloned().collect();
        let mut names: Vec<String> = links.into_iter().map(|(name, _)| name).collect();
        for group in groups {
            let members = file.group(&group).and_then(|group| group.member_names()).unwrap_or_default();
            names.extend(members.into_iter().take(LOOKED_AT).map(|member| format!("{group}/{member}")));
        }
        names
    }
}

/// Why values of a dataset would come from elsewhere than the file, if they would. Nothing is read of them for that.
pub(super) fn foreign_part(dataset: &h5::Dataset) -> Result<Option<String>> {
    let storage = dataset.dcpl().map_err(library_error)?;
    if storage.get_layout().map_err(library_error)? == Layout::Virtual {
        let reason = "it is a virtual dataset, made of pieces of others, which are not read; copy its values into the file";
        return Ok(Some(reason.to_owned()));
    }
    if !storage.get_external().map_err(library_error)?.is_empty() {
        return Ok(Some(
            "its values lie in other files, which are not read; copy them into the file".to_owned(),
        ));
    }
    // The binding takes room for 32 parameters of a filter for granted.
    let filters = guarded(|| Ok(storage.get_filters()))
        .map_err(|_| unsupported("one of its filters has more than 32 parameters"))?;
    match filters {
        Ok(filters) => Ok(filters.iter().find_map(|filter| match filter {
            Filter::User(id, _) => {
                Some(format!("its filter {id} is unknown; write it with gzip, LZF or Blosc"))
            }
            _ => None,
        })),
        Err(error) => Err(invalid(format!("its filters: {}", library_error(error)))),
    }
}
