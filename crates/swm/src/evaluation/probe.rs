//! Fingerprints of everything that a result depends on, each taken by trying it: so that a difference can be named.

use serde::{Deserialize, Serialize};
use serde_json::json;
use swm_core::error::BoxError;
use swm_core::evaluate::{sha256, sorted, witness};
use swm_core::seed::keyed;
use swm_core::{Batch, Column, Dtype, EnvConfig, EnvEntry, EnvError, Episode, EpisodeSeed, Manifest, Schema};

/// Actions of the try.
const STEPS: u64 = 25;

/// What a result depends on, apart from the policy.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fingerprints {
    /// The environment's fields, actions, settings and factor table.
    pub tables: String,
    /// What random actions lead to in the first pair, row by row.
    pub physics: String,
    /// The images of the same; none where the manifest has no images.
    #[serde(default, alias = "pictures", skip_serializing_if = "Option::is_none")]
    pub images: Option<String>,
    /// The noise that policies get in the first pair.
    pub noise: String,
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
) -> Result<Fingerprints, BoxError> {
    let config = EnvConfig { image: manifest.image, settings: manifest.settings.clone() };
    let mut env = entry.make(&config)?;
    let spec = env.spec().clone();
    let settings: Vec<_> = entry.settings.iter().map(|setting| [setting.name, setting.default]).collect();
    let tables = json!({
        "id": spec.id, "action": spec.action, "factors": spec.factors, "time_step_s": spec.time_step_s,
        "fields": spec.fields.iter().filter(|field| field.shape.len() != 3).collect::<Vec<_>>(),
        "start": spec.start_columns, "goal": spec.goal_columns, "settings": settings,
    });
    let mut row = Batch::new(Schema::new(spec.fields.clone())?, 1);
    let pixels = row.schema().index("pixels");
    let reset = manifest.pairs.first().ok_or("the manifest holds no pairs")?.reset()?;
    let seed = reset.seed.unwrap_or(EpisodeSeed::new(0));
    env.reset(&Episode { seed, options: &reset })?;
    env.write_episode(&mut row.rows_mut());
    let mut action = Column::zeros(spec.action.dtype().unwrap_or(Dtype::F32), spec.action.width());
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
        tables: sha256(sorted(tables).to_string().as_bytes()),
        physics: sha256(rows.as_bytes()),
        images: manifest.image.map(|_| sha256(&images)),
        noise: sha256(&noise_seed.value().to_le_bytes()),
    })
}
