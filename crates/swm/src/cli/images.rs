//! Images of recordings that hold none: rendered by replaying the episodes.

use std::collections::BTreeMap;
use std::path::Path;

use swm_core::{Dtype, ImageSize, Registry, Value};
use swm_data::{Dataset, RenderOptions, Rendered};

use super::{Failure, usage};

/// Whether a dataset has a column of images.
pub(super) fn holds_images(dataset: &dyn Dataset) -> bool {
    let fields = dataset.schema().fields().iter();
    fields.filter(|field| field.dtype == Dtype::U8).any(|field| matches!(field.shape[..], [_, _, 1 | 3]))
}

/// The size of the images that a dataset holds.
pub(super) fn size(dataset: &dyn Dataset) -> Option<ImageSize> {
    let mut fields = dataset.schema().fields().iter().filter(|field| field.dtype == Dtype::U8);
    fields.find_map(|field| match field.shape[..] {
        [height, width, 1 | 3] => Some(ImageSize { height, width }),
        _ => None,
    })
}

/// The names of the columns of images.
fn names(dataset: &dyn Dataset) -> Vec<&str> {
    let fields = dataset.schema().fields().iter().filter(|field| field.dtype == Dtype::U8);
    let images = fields.filter(|field| matches!(field.shape[..], [_, _, 1 | 3]));
    images.map(|field| field.name.as_str()).collect()
}

/// Refuses to join datasets of which some hold no images, or others; `command` is what was called.
pub(super) fn check_alike(datasets: &[Box<dyn Dataset>], command: &str) -> Result<(), Failure> {
    let Some((first, rest)) = datasets.split_first() else { return Ok(()) };
    let wanted = size(first.as_ref());
    let Some(other) = rest.iter().find(|other| size(other.as_ref()) != wanted) else {
        return check_names(first.as_ref(), rest, command);
    };
    let told = |dataset: &dyn Dataset| {
        let images = size(dataset).map_or("no images".to_owned(), |size| format!("images of {size}"));
        format!("{} holds {images}", dataset.path().display())
    };
    let size = wanted.or_else(|| size(other.as_ref())).map_or(String::new(), |size| size.to_string());
    Err(usage(format!(
        "{}, {}; images of one size for all are rendered by: {command} --image-size {size}",
        told(first.as_ref()),
        told(other.as_ref())
    )))
}

/// Refuses to join datasets of which some lack a column of images that others have.
fn check_names(first: &dyn Dataset, rest: &[Box<dyn Dataset>], command: &str) -> Result<(), Failure> {
    let Some(size) = size(first) else { return Ok(()) };
    for other in rest.iter().map(AsRef::as_ref) {
        for (with, without) in [(first, other), (other, first)] {
            let there = names(without);
            let Some(name) = names(with).into_iter().find(|name| !there.contains(name)) else { continue };
            let (with, without) = (with.path().display(), without.path().display());
            return Err(usage(format!(
                "{with} holds images `{name}`, {without} holds none; the same images for all are rendered by: {command} \
                 --image-size {size}"
            )));
        }
    }
    Ok(())
}

/// The dataset with images of this size, in place of those that it holds, and with these factors in place of the recorded ones.
///
/// # Errors
///
/// It does not say how it was recorded, or its environment cannot be made, or has no such factors.
pub(super) fn rendered(
    dataset: Box<dyn Dataset>,
    registry: &Registry,
    size: ImageSize,
    look: BTreeMap<String, Value>,
) -> Result<Box<dyn Dataset>, Failure> {
    let options = RenderOptions::default().image(size).factors(look);
    Ok(Box::new(Rendered::new(dataset, registry, &options).map_err(usage)?))
}

/// What is said where images are rendered unasked; `why` they are of this size.
pub(super) fn note(path: &Path, size: ImageSize, why: &str) -> String {
    let ImageSize { height, width } = size;
    format!("note: {} holds no images; they are rendered at {height}x{width} ({why})", path.display())
}

/// Of a size that a flag changes.
pub(super) const BY_DEFAULT: &str = "--image-size changes that";
