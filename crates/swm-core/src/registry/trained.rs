//! The environment that the model behind a policy was trained in, compared with the one that it is used in.

use std::path::PathBuf;

use serde_json::{Map, Value as Json};

use super::PolicyContext;
use crate::settings::text;

/// The environment that a model was trained in, as far as its run says.
///
/// ```
/// use swm_core::{EnvConfig, EnvEntry, PolicyContext, Setting, testing::TOY};
/// use swm_core::registry::TrainedIn;
///
/// const WALKER: EnvEntry = EnvEntry::new("demo/Walker-v0", "it walks or runs", |config| TOY.make(config))
///     .settings(&[Setting::new("task", "what is rewarded", "walk")]);
/// let settings = [("task".to_owned(), "run".into())].into_iter().collect();
/// let trained = TrainedIn::new(WALKER.id).settings(settings).frame_skip(1);
/// let config = EnvConfig::default();
/// let [task] = &trained.differences(&PolicyContext::new(&WALKER, &config))[..] else { panic!("one setting differs") };
/// assert_eq!((task.name.as_str(), task.trained.as_str(), task.used.as_str()), ("task", "run", "walk"));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct TrainedIn {
    /// The environment's id.
    pub env: String,
    /// Its settings that were given; `None`: not recorded.
    pub settings: Option<Map<String, Json>>,
    /// Environment steps per action; `None`: not recorded.
    pub frame_skip: Option<u32>,
    /// The dataset that it learned from; `None`: none, or not recorded.
    pub dataset: Option<TrainedOn>,
}

/// The dataset that a model was trained on.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct TrainedOn {
    /// Where it was.
    pub path: PathBuf,
    /// Episodes that it held.
    pub episodes: usize,
    /// Rows of all of them.
    pub rows: usize,
    /// The share of them that was left out of the training, from 0 to 1: [`crate::evaluate::is_held_out`].
    pub held_out: f64,
}

impl TrainedOn {
    /// A dataset of `episodes` with `rows` in all, of which the share `held_out` of the episodes was left out.
    pub fn new(path: impl Into<PathBuf>, (episodes, rows): (usize, usize), held_out: f64) -> Self {
        Self { path: path.into(), episodes, rows, held_out }
    }

    /// Whether it trained on episodes that a share `held_out` of the same dataset holds out. A share of 1 holds out nothing: it takes
    /// all episodes.
    ///
    /// ```
    /// use swm_core::registry::TrainedOn;
    ///
    /// let trained = TrainedOn::new("pusht.h5", (100, 5000), 0.2);
    /// assert!(trained.has_seen(0.25));
    /// assert!(!trained.has_seen(0.2) && !trained.has_seen(1.0));
    /// ```
    pub fn has_seen(&self, held_out: f64) -> bool {
        held_out < 1.0 && self.held_out < held_out
    }
}

/// A setting that was another in training.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct TrainingDifference {
    /// Its name, or [`FRAME_SKIP`].
    pub name: String,
    /// Its value in training, as on a command line; of a setting that was not given, the default.
    pub trained: String,
    /// Its value now.
    pub used: String,
}

/// The name of a [`TrainingDifference`] that is no setting of the environment.
pub const FRAME_SKIP: &str = "frame skip";

impl TrainedIn {
    /// The environment `env`; nothing is known of its settings.
    pub fn new(env: impl Into<String>) -> Self {
        Self { env: env.into(), ..Self::default() }
    }

    /// Its settings that were given.
    #[must_use]
    pub fn settings(self, settings: Map<String, Json>) -> Self {
        Self { settings: Some(settings), ..self }
    }

    /// Environment steps per action.
    #[must_use]
    pub fn frame_skip(self, frame_skip: impl Into<Option<u32>>) -> Self {
        Self { frame_skip: frame_skip.into(), ..self }
    }

    /// The dataset that it learned from.
    #[must_use]
    pub fn dataset(self, dataset: TrainedOn) -> Self {
        Self { dataset: Some(dataset), ..self }
    }

    /// What is another in `context` than in training. Nothing where the environments are two: their settings mean different things.
    pub fn differences(&self, context: &PolicyContext<'_>) -> Vec<TrainingDifference> {
        let PolicyContext { env, config, frame_skip: used, .. } = *context;
        if self.env != env.id {
            return Vec::new();
        }
        let default = |name: &str| {
            let setting = env.settings.iter().find(|setting| setting.name == name);
            setting.map(|setting| Json::from(setting.default))
        };
        let mut differences = Vec::new();
        if let Some(trained) = &self.settings {
            let more = config.settings.keys().filter(|name| !trained.contains_key(*name));
            for name in trained.keys().chain(more) {
                let value =
                    |settings: &Map<String, Json>| settings.get(name).cloned().or_else(|| default(name));
                let (then, now) = (value(trained), value(&config.settings));
                if then.as_ref().map(plain) != now.as_ref().map(plain) {
                    let text = |value: Option<Json>| {
                        value.map_or_else(|| "its default".to_owned(), |value| text(&value))
                    };
                    differences.push(TrainingDifference {
                        name: name.clone(),
                        trained: text(then),
                        used: text(now),
                    });
                }
            }
        }
        if let Some(trained) = self.frame_skip.filter(|&trained| trained != used) {
            let [trained, used] = [trained, used].map(|times| times.to_string());
            differences.push(TrainingDifference { name: FRAME_SKIP.to_owned(), trained, used });
        }
        differences
    }
}

/// A value with all its numbers as `f64`, whether it was written as a value or, as defaults are, as a text.
fn plain(value: &Json) -> Json {
    match value {
        Json::String(text) => match serde_json::from_str::<Json>(text) {
            Ok(Json::String(text)) => text.into(),
            Ok(value) => plain(&value),
            Err(_) => value.clone(),
        },
        Json::Number(number) => number.as_f64().into(),
        Json::Array(values) => values.iter().map(plain).collect(),
        Json::Object(values) => values.iter().map(|(name, value)| (name.clone(), plain(value))).collect(),
        other => other.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::env::EnvConfig;
    use crate::registry::{EnvEntry, Setting};
    use crate::testing::TOY;

    const ENV: EnvEntry = EnvEntry::new("demo/Walker-v0", "it walks or runs", |config| TOY.make(config))
        .settings(&[
            Setting::new("task", "what is rewarded", "walk"),
            Setting::new("speed", "how fast", "0.10"),
            Setting::new("colors", "how many", "as many as there are"),
        ]);

    fn settings(json: &str) -> Map<String, Json> {
        serde_json::from_str(json).unwrap()
    }

    fn told(trained: &TrainedIn, used: &str, frame_skip: u32) -> Vec<String> {
        let config = EnvConfig { settings: settings(used), ..EnvConfig::default() };
        let differences = trained.differences(&PolicyContext::new(&ENV, &config).frame_skip(frame_skip));
        let line = |found: TrainingDifference| format!("{}: {} / {}", found.name, found.trained, found.used);
        differences.into_iter().map(line).collect()
    }

    #[test]
    fn settings_are_compared_by_value_and_defaults_count() {
        let trained =
            TrainedIn::new(ENV.id).settings(settings(r#"{"task": "run", "speed": 0.1}"#)).frame_skip(2);
        assert_eq!(told(&trained, r#"{"task": "run"}"#, 2), [] as [&str; 0]);
        assert_eq!(told(&trained, "{}", 2), ["task: run / walk"]);
        assert_eq!(
            told(&trained, r#"{"colors": 3, "speed": 1}"#, 1),
            ["task: run / walk", "speed: 0.1 / 1", "colors: as many as there are / 3", "frame skip: 2 / 1"]
        );
        assert_eq!(
            told(&TrainedIn::new(ENV.id).settings(Map::new()), r#"{"task": "walk"}"#, 9),
            [] as [&str; 0]
        );
    }

    #[test]
    fn what_is_not_recorded_differs_from_nothing() {
        assert_eq!(told(&TrainedIn::new(ENV.id), r#"{"task": "run"}"#, 3), [] as [&str; 0]);
        let elsewhere =
            TrainedIn::new("demo/Other-v0").settings(settings(r#"{"task": "run"}"#)).frame_skip(4);
        assert_eq!(told(&elsewhere, "{}", 1), [] as [&str; 0]);
        let unknown = TrainedIn::new(ENV.id).settings(settings(r#"{"gone": 1}"#));
        assert_eq!(told(&unknown, "{}", 1), ["gone: 1 / its default"]);
    }
}
