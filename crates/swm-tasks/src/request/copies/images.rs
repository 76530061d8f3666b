//! Whether datasets that are joined have the same images.

use swm_core::{Dtype, ImageSize};
use swm_data::Dataset;

use super::{Fix, Message, TaskError, size_json};

/// Names and sizes of the columns of images.
fn images(dataset: &dyn Dataset) -> impl Iterator<Item = (&str, ImageSize)> {
    let fields = dataset.schema().fields().iter().filter(|field| field.dtype == Dtype::U8);
    fields.filter_map(|field| match field.shape[..] {
        [height, width, 1 | 3] => Some((field.name.as_str(), ImageSize { height, width })),
        _ => None,
    })
}

/// Whether a dataset has a column of images.
pub fn holds_images(dataset: &dyn Dataset) -> bool {
    images(dataset).next().is_some()
}

/// The size of a dataset's first column of images.
pub(super) fn first_size(dataset: &dyn Dataset) -> Option<ImageSize> {
    images(dataset).next().map(|(_, size)| size)
}

/// Refuses to join datasets of which some hold no images, or others.
pub(super) fn check_alike(datasets: &[Box<dyn Dataset>]) -> Result<(), TaskError> {
    let Some((first, rest)) = datasets.split_first() else { return Ok(()) };
    let wanted = first_size(first.as_ref());
    let of_one_size = |size: ImageSize, text: String| -> Result<(), TaskError> {
        Err(Message::new(text)
            .fix(Fix::set_to("image_size", size_json(size), "for images of one size"))
            .into())
    };
    if let Some(other) = rest.iter().find(|other| first_size(other.as_ref()) != wanted) {
        let described = |dataset: &dyn Dataset| {
            let images =
                first_size(dataset).map_or("no images".to_owned(), |size| format!("images of {size}"));
            format!("{} holds {images}", dataset.path().display())
        };
        let text = format!("{}, {}", described(first.as_ref()), described(other.as_ref()));
        let Some(size) = wanted.or_else(|| first_size(other.as_ref())) else { return Ok(()) };
        return of_one_size(size, text);
    }
    let Some(wanted) = wanted else { return Ok(()) };
    for other in rest {
        for (with, without) in [(first.as_ref(), other.as_ref()), (other.as_ref(), first.as_ref())] {
            let lacks = |name: &str| images(without).all(|(there, _)| there != name);
            let Some((name, _)) = images(with).find(|(name, _)| lacks(name)) else { continue };
            let (with, without) = (with.path().display(), without.path().display());
            return of_one_size(wanted, format!("{with} holds images `{name}`, {without} holds none"));
        }
    }
    Ok(())
}
