//! Fingerprints of everything that a result depends on, measured one by one, so that a difference can be named.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use swm_core::evaluate::{sha256, witness};
use swm_core::seed::keyed;
use swm_core::{
    Batch, Column, Dtype, EnvConfig, EnvEntry, EnvError, EnvSpec, Episode, EpisodeSeed, FieldKind, Manifest,
    Schema, Space,
};

use crate::error::TaskError;

/// Actions of the probe.
const STEPS: u64 = 25;

/// What a result depends on, apart from the policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Fingerprints {
    /// What changes results of the environment's tables: names, types, shapes, spaces and default values of fields, actions,
    /// settings and factors, in order. Help texts do not count. Receipts of version 1 hold a hash over those texts, too.
    pub tables: String,
    /// The states that random actions lead to in the first pair, step by step.
    pub physics: String,
    /// The images of the same; none where the manifest has no images.
    #[serde(default, alias = "pictures", skip_serializing_if = "Option::is_none")]
    pub images: Option<String>,
    /// The noise that policies get in the first pair.
    pub noise: String,
    /// SHA-256 of the libraries and files that the environment was made from, by name. What differs here may still lead to
    /// the same states: `physics` decides.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub made_from: BTreeMap<String, String>,
}

/// Takes them.
///
/// # Errors
///
/// The manifest holds no pairs, or the environment cannot be made, reset or stepped. That it diverges is part of the
/// fingerprint.
pub fn fingerprints(
    entry: &EnvEntry,
    manifest: &Manifest,
    policy_seed: u64,
) -> Result<Fingerprints, TaskError> {
    let config = EnvConfig { image: manifest.image, settings: manifest.settings.clone() };
    let mut env = entry.make(&config)?;
    let spec = env.spec().clone();
    let mut row = Batch::new(Schema::new(spec.fields.clone())?, 1);
    let pixels = row.schema().index("pixels");
    let reset = manifest.pairs.first().ok_or("the manifest holds no pairs")?.reset()?;
    let seed = reset.seed.unwrap_or(EpisodeSeed::new(0));
    env.reset(&Episode::new(seed, &reset))?;
    env.write_episode(&mut row.rows_mut());
    let mut action = Column::zeros(spec.action.dtype().unwrap_or(Dtype::F32), spec.action.dim());
    let (mut rows, mut images) = (String::new(), Vec::new());
    for step in 0..=STEPS {
        env.observe(&mut row.rows_mut());
        rows += &witness(&spec, row.row(0));
        if let Some(image) = pixels.and_then(|index| row.row(0).at(index).get::<u8>())
            && (step == 0 || step == STEPS)
        {
            images.extend_from_slice(image);
        }
        let mut rng = keyed(0, "physics probe", [step, 0]);
        spec.action.sample_into(&mut rng, action.as_slice_mut());
        match env.step(action.as_slice()) {
            Ok(_) => {}
            Err(EnvError::Diverged { .. }) => break,
            Err(error) => return Err(error.into()),
        }
    }
    let noise_seed = match policy_seed {
        0 => seed,
        policy_seed => EpisodeSeed::of(policy_seed, seed.value() as u64),
    };
    Ok(Fingerprints {
        tables: sha256(tables(entry, &spec).to_string().as_bytes()),
        physics: sha256(rows.as_bytes()),
        images: manifest.image.map(|_| sha256(&images)),
        noise: sha256(&noise_seed.value().to_le_bytes()),
        made_from: spec.asset_hashes,
    })
}

/// What [`Fingerprints::tables`] is the hash of. Keys are fixed here, so that renamed fields of structs change nothing.
fn tables(entry: &EnvEntry, spec: &EnvSpec) -> Json {
    let fields = spec.fields.iter().filter(|field| field.shape.len() != 3);
    let fields: Vec<Json> = fields
        .map(|field| json!([field.name, field.kind == FieldKind::Episode, field.dtype.name(), field.shape]))
        .collect();
    let factors: Vec<Json> = spec
        .factors
        .iter()
        .map(|factor| {
            let shows_with: Vec<Json> =
                factor.shows_with.iter().map(|(name, value)| json!([name, numbers(value)])).collect();
            json!([
                factor.name,
                space(&factor.space),
                numbers(&factor.default),
                factor.sampled_by_default,
                shows_with
            ])
        })
        .collect();
    // A default that is a value, such as `0.10` or `[1, 2]`, counts as that value, any other as its text.
    let value = |text: &str| serde_json::from_str(text).map_or_else(|_| text.into(), |value| numbers(&value));
    let settings: Vec<Json> =
        entry.settings.iter().map(|setting| json!([setting.name, value(setting.default)])).collect();
    json!([
        spec.id,
        space(&spec.action),
        fields,
        factors,
        spec.time_step_s,
        spec.start_columns,
        spec.goal_columns,
        settings
    ])
}

/// Kind, type, shape and bounds of a space; of a dictionary, those of its parts.
fn space(space: &Space) -> Json {
    if let Space::Dict { spaces } = space {
        return spaces.iter().map(|(name, part)| json!([name, self::space(part)])).collect();
    }
    let (low, high) = space.bounds();
    // JSON has no infinity.
    let texts = |values: Vec<f64>| values.iter().map(f64::to_string).collect::<Vec<_>>();
    json!([space.kind(), space.dtype().map(Dtype::name), space.shape(), texts(low), texts(high)])
}

/// A value with all its numbers as `f64`: `1` and `1.0` are the same.
fn numbers(value: &Json) -> Json {
    match value {
        Json::Number(number) => number.as_f64().into(),
        Json::Array(values) => values.iter().map(numbers).collect(),
        Json::Object(values) => values.iter().map(|(name, value)| json!([name, numbers(value)])).collect(),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use swm_core::testing::TOY;
    use swm_core::{FactorSpec, Field, Setting};

    use super::*;

    #[test]
    fn help_texts_do_not_count_and_default_values_do() {
        const OLD: EnvEntry = TOY.settings(&[Setting::new("speed", "how fast", "0.1")]);
        const REWORDED: EnvEntry = TOY.settings(&[Setting::new("speed", "distance per step", "0.10")]);
        const OTHER: EnvEntry = TOY.settings(&[Setting::new("speed", "how fast", "0.2")]);
        let spec = |doc: &str, default: Json| {
            let factor =
                FactorSpec::new("point.gain", Space::uniform_box(Dtype::F64, &[], 0.0, 2.0), default);
            EnvSpec::new(
                "x",
                Space::Discrete { n: 3, start: 0 },
                vec![Field::step("state", Dtype::F64, &[2])],
            )
            .factors(vec![factor.doc(doc)])
        };
        let first = tables(&OLD, &spec("a gain", json!(1)));
        assert_eq!(first, tables(&REWORDED, &spec("distance per unit of action", json!(1.0))));
        assert_ne!(first, tables(&OTHER, &spec("a gain", json!(1))));
        assert_ne!(first, tables(&OLD, &spec("a gain", json!(1.5))));
    }
}
