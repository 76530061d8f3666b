//! What draws the images that a model sees in its canonical look: a trained `canonical`.

use super::cost::described;
use crate::baseline::Canonicalizer;
use crate::error::BaselineError;
use crate::train::TrainedModel;

/// The setting of policies that names its run.
pub const CANONICAL: &str = "canonical";

/// What draws images, and which it is.
pub(super) fn canonicalizer(model: &TrainedModel) -> Result<(Box<dyn Canonicalizer>, String), BaselineError> {
    let baseline = model.baseline.as_ref();
    match baseline.canonicalizer() {
        Some(canonicalizer) => Ok((canonicalizer, described(baseline.name(), model.step, &model.weights))),
        None => {
            let reason = "draws no images in a canonical look; give a run of canonical";
            Err(BaselineError::Unfit { baseline: baseline.name(), reason })
        }
    }
}
