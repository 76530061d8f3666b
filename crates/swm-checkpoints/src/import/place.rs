//! The environment of a checkpoint, and how many of its actions a block holds.

use serde_json::{Map, Value as Json};
use swm_baselines::train::ACTION;
use swm_core::{EnvConfig, Registry};
use swm_tasks::request::{Fix, Message, TaskError};

use super::Import;
use super::recipe::Recipe;
use super::scales::{Known, Scales};
use super::source::Source;

/// Where a model acts.
pub(super) struct Place {
    pub(super) env: Option<String>,
    pub(super) env_settings: Option<Map<String, Json>>,
    pub(super) frame_skip: Option<u32>,
    /// Values of an action, where they are known.
    action: Option<usize>,
    /// Columns of the environment and their values, where it is known.
    columns: Vec<(String, usize)>,
}

impl Place {
    pub(super) fn find(
        request: &Import,
        registry: &Registry,
        source: &Source,
        dataset: Option<&Known>,
        scales: &Scales,
    ) -> Result<Self, TaskError> {
        let noted = |name: &str| source.notes.as_ref().and_then(|notes| notes.get(name));
        let env = request.env.clone().or_else(|| dataset?.env.clone());
        let env = env.or_else(|| Some(noted("env")?.as_str()?.to_owned()));
        let mut settings = dataset.and_then(|dataset| dataset.env_settings.clone());
        settings = settings.or_else(|| noted("env_settings")?.as_object().cloned());
        if !request.env_option.is_empty() {
            settings.get_or_insert_default().extend(request.env_option.clone());
        }
        let (mut action, mut columns) = (None, Vec::new());
        // What an export notes does not have to be known to describe it.
        let is_noted = request.env.is_none() && dataset.is_none_or(|dataset| dataset.env.is_none());
        let entry = match env.as_ref().map(|env| registry.env(env)).transpose() {
            Err(_) if request.check_only && is_noted => None,
            entry => entry.map_err(|error| Message::new(error.to_string()))?,
        };
        if let (Some(env), Some(entry)) = (&env, entry) {
            let config = EnvConfig { image: None, settings: settings.clone().unwrap_or_default() };
            let made = entry.make(&config).map_err(|error| Message::new(format!("{env}: {error}")))?;
            let spec = made.spec();
            action = Some(spec.action.dim());
            columns = spec.fields.iter().map(|field| (field.name.clone(), field.dim())).collect();
        }
        let action = action.or_else(|| dataset.map(|dataset| dataset.action).filter(|dim| *dim > 0));
        let action = action.or_else(|| scales.of.get(ACTION).map(|(scale, _)| scale.mean.len()));
        let env_settings = settings.or_else(|| env.as_ref().map(|_| Map::new()));
        let frame_skip = dataset.and_then(|dataset| dataset.frame_skip);
        let noted_skip = || u32::try_from(noted("frame_skip")?.as_u64()?).ok().filter(|skip| *skip > 0);
        let frame_skip = frame_skip.or_else(noted_skip);
        Ok(Self { env, env_settings, frame_skip, action, columns })
    }

    /// Refuses a model whose vector has another dim than the environment's.
    pub(super) fn check_vector(&self, recipe: &Recipe) -> Result<(), TaskError> {
        let (Some(env), Recipe { vector, column, .. }) = (&self.env, recipe) else { return Ok(()) };
        match self.columns.iter().find(|(name, dim)| name == column && dim != vector) {
            Some((_, dim)) if *vector > 0 => {
                let text = format!("the model takes {vector} values of `{column}`, and {env} has {dim}");
                Err(Message::new(text).fix(Fix::Change("env")).into())
            }
            _ => Ok(()),
        }
    }

    /// F: how many actions of the environment a block of the model holds.
    pub(super) fn frameskip(&self, recipe: &Recipe) -> Result<Option<usize>, TaskError> {
        let Some(action) = self.action else { return Ok(recipe.frameskip) };
        let env = self.env.as_deref().unwrap_or("the dataset");
        let fits = action > 0
            && recipe.block.is_multiple_of(action)
            && recipe.frameskip.is_none_or(|frameskip| frameskip * action == recipe.block);
        if fits {
            return Ok(Some(recipe.block / action));
        }
        let meant = if recipe.block.is_multiple_of(5) && recipe.block / 5 == 5 {
            ": was it trained in swm/OGBCube-v0 (5)?"
        } else {
            ""
        };
        let text = format!(
            "the model takes {} numbers a block, and actions of {env} have {action}{meant}",
            recipe.block
        );
        Err(Message::new(text).fix(Fix::Change("env")).into())
    }
}
