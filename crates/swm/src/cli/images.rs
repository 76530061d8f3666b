//! Images of recordings that hold none: rendered by replaying the episodes.

use std::path::Path;

use swm_core::{ImageSize, Registry};
use swm_data::{Dataset, RenderOptions, Rendered};

use super::{Failure, usage};

pub(super) use swm_tasks::request::holds_images;

/// The dataset with images of this size, in place of those that it holds.
///
/// # Errors
///
/// It does not say how it was recorded, or its environment cannot be made.
pub(super) fn rendered(
    dataset: Box<dyn Dataset>,
    registry: &Registry,
    size: ImageSize,
) -> Result<Box<dyn Dataset>, Failure> {
    let options = RenderOptions::default().image(size);
    Ok(Box::new(Rendered::new(dataset, registry, &options).map_err(usage)?))
}

/// What is said where images are rendered unasked; `why` they are of this size.
pub(super) fn note(path: &Path, size: ImageSize, why: &str) -> String {
    let ImageSize { height, width } = size;
    format!("note: {} holds no images; they are rendered at {height}x{width} ({why})", path.display())
}

/// Of a size that a flag changes.
pub(super) const BY_DEFAULT: &str = "--image-size changes that";
