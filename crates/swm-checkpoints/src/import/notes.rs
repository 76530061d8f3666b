//! What an export of this program notes beside a checkpoint (`swm.json`), which no other file of it contains.

use std::collections::BTreeMap;

use swm_baselines::train::Scale;

use super::scales::Scales;
use super::source::Source;

/// The scales in what an export of this program notes.
pub(super) fn noted_scales(source: &Source, columns: &[&str], scales: &mut Scales) {
    let noted = source.notes.as_ref().and_then(|notes| notes.get("scales"));
    let Some(noted) =
        noted.and_then(|noted| serde_json::from_value::<BTreeMap<String, Scale>>(noted.clone()).ok())
    else {
        return;
    };
    for (name, scale) in noted.into_iter().filter(|(name, _)| columns.contains(&name.as_str())) {
        scales.of.entry(name).or_insert_with(|| (scale, "swm.json".to_owned()));
    }
}

/// The bounds of actions that an export of this program notes, where they are bounds of `dim` values.
pub(super) fn noted_bounds(source: &Source, dim: usize) -> Option<[Vec<f64>; 2]> {
    let notes = source.notes.as_ref()?;
    let of = |name: &str| serde_json::from_value::<Vec<f64>>(notes.get(name)?.clone()).ok();
    let bounds = [of("low")?, of("high")?];
    let sound = bounds.iter().all(|bound| bound.len() == dim)
        && bounds[0].iter().zip(&bounds[1]).all(|(low, high)| low < high && (high - low).is_finite());
    sound.then_some(bounds)
}
