//! Lists of the files of a folder.

use std::collections::BTreeMap;

use super::client::Client;
use super::error::{RemoteError, RemoteErrorKind as Kind};
use super::s3;
use crate::folders::is_plain_name;

/// Files of a folder are never more.
pub(super) const MAX_FILES: usize = 1 << 20;

/// A file of a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) size: u64,
    /// The tag that its server gives with it.
    pub(super) tag: Option<String>,
    /// What tells it from other versions.
    pub(super) version: String,
    /// Its hash, where the list has it.
    pub(super) sha256: Option<String>,
}

/// The files of a folder, by their paths in it.
pub(super) type Files = BTreeMap<String, Entry>;

/// The objects of a bucket below a key.
pub(super) fn of_bucket(client: &Client, bucket: &str, folder: &str) -> Result<Files, RemoteError> {
    let prefix = if folder.is_empty() { String::new() } else { format!("{folder}/") };
    let (mut files, mut next) = (Files::new(), None);
    loop {
        let link = s3::list(&client.settings.s3, bucket, &prefix, next.as_deref());
        let (text, _) = client.text(&link)?;
        let page = String::from_utf8(text).ok().and_then(|text| s3::page(&text));
        let Some((listed, more)) = page else {
            let reason = "the server gives no list of its objects";
            return Err(RemoteError::new(Kind::Answer, &link.name, reason, "check AWS_ENDPOINT_URL"));
        };
        for object in listed {
            let Some(path) =
                object.key.strip_prefix(&prefix).filter(|path| !path.is_empty() && !path.ends_with('/'))
            else {
                continue;
            };
            let version = object.tag.clone().unwrap_or_default();
            files
                .insert(path.to_owned(), Entry { size: object.size, tag: object.tag, version, sha256: None });
        }
        if files.len() > MAX_FILES {
            let reason = format!("it has more than {MAX_FILES} objects");
            return Err(RemoteError::new(Kind::Answer, &link.name, reason, "name a folder of it"));
        }
        match more {
            Some(more) if next.as_ref() != Some(&more) => next = Some(more),
            _ => return Ok(files),
        }
    }
}

/// Refuses names that lead out of the folder that they are written to.
pub(super) fn check_names(name: &str, files: &Files) -> Result<(), RemoteError> {
    match files.keys().find(|path| !path.split('/').all(is_plain_name)) {
        Some(path) => {
            let reason = format!("its file `{}` has a name that no file can have here", path.escape_debug());
            Err(RemoteError::new(Kind::Answer, name, reason, "rename it there"))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_lead_elsewhere() {
        let of = |path: &str| {
            let entry = Entry { size: 0, tag: None, version: String::new(), sha256: None };
            check_names("s3://b", &Files::from([(path.to_owned(), entry)]))
        };
        assert!(of("data/img/0.0").is_ok() && of(".zgroup").is_ok());
        for path in ["../x", "a/../b", "/etc/x", "a//b", "a\\b", "C:/x"] {
            assert!(of(path).is_err(), "{path}");
        }
    }
}
