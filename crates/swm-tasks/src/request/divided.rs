//! Requests whose work several machines share: what they need, the request of a part, and the one that joins the parts.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::Registry;
use swm_core::settings::{Setting, Settings as _};

use super::{Evaluate, Fix, Message, Record, Report, Request, Shard, Sweep, TaskError, Train, wrong};

/// A request that can be divided into parts, or several. Its JSON has the settings that differ from their defaults, by the name of the
/// request: `{"record": {"env": "swm/PushT-v1", "episodes": 1000}}`, `{"train": [{"baseline": "lewm", "dataset": "a.h5"}]}`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "Map<String, Json>", try_from = "Map<String, Json>")]
#[non_exhaustive]
pub enum Divided {
    /// A recording; its parts are datasets to be merged in order.
    Record(Box<Record>),
    /// An evaluation on a manifest; its parts lie in the folder of the result.
    Evaluate(Box<Evaluate>),
    /// A sweep, as an evaluation.
    Sweep(Box<Sweep>),
    /// Trainings, each of which is a part, with a run of its own.
    Train(Vec<Train>),
}

/// What a request that is divided needs, found out before it begins.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Needs {
    /// Episodes of all parts.
    pub episodes: u64,
    /// Files and folders that are read.
    pub inputs: Vec<PathBuf>,
}

/// A kind of request that can be divided.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct DividedKind {
    /// The name of the request.
    pub name: &'static str,
    /// All of its settings.
    pub settings: &'static [Setting],
    /// Those that whoever divides or places the request gives.
    pub placed: &'static [&'static str],
}

impl Divided {
    /// The kinds of requests.
    pub const KINDS: &[DividedKind] = &[
        DividedKind {
            name: Record::NAME,
            settings: Record::SETTINGS,
            placed: &["shard", "mode", "mix", "out"],
        },
        DividedKind {
            name: Evaluate::NAME,
            settings: Evaluate::SETTINGS,
            placed: &["shard", "join", "again", "out"],
        },
        DividedKind {
            name: Sweep::NAME,
            settings: Sweep::SETTINGS,
            placed: &["shard", "join", "again", "out"],
        },
        DividedKind { name: Train::NAME, settings: Train::SETTINGS, placed: &["resume", "out"] },
    ];

    /// The name of the request.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Record(_) => Record::NAME,
            Self::Evaluate(_) => Evaluate::NAME,
            Self::Sweep(_) => Sweep::NAME,
            Self::Train(_) => Train::NAME,
        }
    }

    /// The settings that differ from their defaults; of trainings, those of each.
    pub fn changed(&self) -> Vec<Map<String, Json>> {
        match self {
            Self::Record(request) => vec![request.changed()],
            Self::Evaluate(request) => vec![request.changed()],
            Self::Sweep(request) => vec![request.changed()],
            Self::Train(runs) => runs.iter().map(Train::changed).collect(),
        }
    }

    /// Whether its parts are runs of their own, which are not joined.
    pub fn is_of_runs(&self) -> bool {
        matches!(self, Self::Train(_))
    }

    /// Threads of one process.
    pub fn threads(&self) -> Option<usize> {
        match self {
            Self::Record(request) => request.threads,
            Self::Evaluate(request) => request.threads,
            Self::Sweep(request) => request.threads,
            Self::Train(runs) => runs.first().and_then(|run| run.threads),
        }
    }

    /// Refuses settings by which parts are told apart: whoever divides the request gives them.
    ///
    /// # Errors
    ///
    /// [`TaskError::Request`], which names the setting.
    pub fn check_undivided(&self) -> Result<(), TaskError> {
        let mut placed =
            Self::KINDS.iter().filter(|kind| kind.name == self.name()).flat_map(|kind| kind.placed);
        let changed = self.changed();
        let is_given = |name: &&&str| changed.iter().any(|changed| changed.contains_key(**name));
        placed.find(is_given).map_or(Ok(()), |&name| {
            let text = "the job's folder fixes where results go, and each task which part of them it makes";
            Err(Message::about_setting(name, text).fix(Fix::Leave(name)).into())
        })
    }

    /// What all parts need; environment and policy are made. A part of the request is asked.
    ///
    /// # Errors
    ///
    /// The request is wrong, or not one that can be divided.
    pub fn needs(&self, registry: &Registry, report: &mut dyn Report) -> Result<Needs, TaskError> {
        match self {
            Self::Record(request) => request.needs(registry, report),
            Self::Evaluate(request) => request.needs(registry),
            Self::Sweep(request) => request.needs(registry),
            Self::Train(runs) => {
                let mut all = Needs { episodes: 0, inputs: Vec::new() };
                for run in runs {
                    all.inputs.extend(run.needs(registry)?.inputs);
                }
                Ok(all)
            }
        }
    }

    /// The request of a part, begun or not. `out`: of a recording its own dataset, of a training its own run; of others the folder of
    /// the result.
    #[must_use]
    pub fn part(&self, shard: Shard, out: PathBuf) -> Self {
        let mut part = match self {
            Self::Train(runs) => {
                let (index, _) = shard.numbers();
                Self::Train(runs.get(index as usize - 1).cloned().into_iter().collect())
            }
            whole => whole.clone(),
        }
        .at(out);
        match &mut part {
            Self::Record(request) => {
                (request.shard, request.mode) = (Some(shard), swm_data::WriteMode::Append);
            }
            Self::Evaluate(request) => request.shard = Some(shard),
            Self::Sweep(request) => request.shard = Some(shard),
            Self::Train(_) => {}
        }
        part
    }

    /// The whole request, undivided, with its result at `out`: a dataset, a run's folder, or the folder of a result. A run that is there
    /// is resumed. Only the first of several trainings.
    #[must_use]
    pub fn at(&self, out: PathBuf) -> Self {
        let mut whole = self.clone();
        match &mut whole {
            Self::Record(request) => request.out = out,
            Self::Evaluate(request) => request.out = Some(out),
            Self::Sweep(request) => request.out = Some(out),
            Self::Train(runs) => *runs = runs.first().map(|run| run.in_folder(out)).into_iter().collect(),
        }
        whole
    }

    /// Does what is asked for. What comes out lies in files.
    ///
    /// # Errors
    ///
    /// As of [`Request::run`].
    pub fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<(), TaskError> {
        match self {
            Self::Record(request) => request.run(registry, report).map(drop),
            Self::Evaluate(request) => request.run(registry, report).map(drop),
            Self::Sweep(request) => request.run(registry, report).map(drop),
            Self::Train(runs) => runs.iter().try_for_each(|run| run.run(registry, report).map(drop)),
        }
    }

    /// The request that joins the parts in the folder `out`; `None` of recordings, which are merged, and of trainings.
    #[must_use]
    pub fn join(&self, out: PathBuf) -> Option<Self> {
        let mut joined = self.at(out);
        match &mut joined {
            Self::Record(_) | Self::Train(_) => return None,
            Self::Evaluate(request) => request.join = true,
            Self::Sweep(request) => request.join = true,
        }
        Some(joined)
    }
}

impl From<Divided> for Map<String, Json> {
    fn from(request: Divided) -> Self {
        let mut changed = request.changed().into_iter().map(Json::Object);
        let settings =
            if request.is_of_runs() { changed.collect() } else { changed.next().unwrap_or_default() };
        Self::from_iter([(request.name().to_owned(), settings)])
    }
}

impl TryFrom<Map<String, Json>> for Divided {
    type Error = TaskError;

    fn try_from(json: Map<String, Json>) -> Result<Self, TaskError> {
        let mut requests = json.into_iter();
        let no_request = || wrong("it is one request by its name, with its settings");
        let (Some((name, given)), None) = (requests.next(), requests.next()) else {
            return Err(no_request());
        };
        if let (Train::NAME, Json::Array(runs)) = (name.as_str(), &given) {
            let run = |run: &Json| Train::from_json(run.as_object().ok_or_else(no_request)?);
            return Ok(Self::Train(runs.iter().map(run).collect::<Result<_, _>>()?));
        }
        let Json::Object(given) = given else { return Err(no_request()) };
        match name.as_str() {
            Record::NAME => Ok(Self::Record(Box::new(Record::from_json(&given)?))),
            Evaluate::NAME => Ok(Self::Evaluate(Box::new(Evaluate::from_json(&given)?))),
            Sweep::NAME => Ok(Self::Sweep(Box::new(Sweep::from_json(&given)?))),
            other => Err(wrong(format!("`{other}` is no request that can be divided"))),
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use swm_core::testing::TOY;

    use super::*;

    fn toy() -> Record {
        let env = TOY.id.to_owned();
        Record { env, episodes: Some(8), seed: 3, image_size: None, ..Record::default() }
    }

    #[test]
    fn a_request_is_read_as_it_was_written() {
        let sweep = Sweep { policy: "random".to_owned(), points: Some(3), ..Sweep::default() };
        let evaluate = Evaluate { policy: "random".to_owned(), budget: Some(9), ..Evaluate::default() };
        let train = Train { baseline: "lewm".to_owned(), seed: Some(3), ..Train::default() };
        for request in [
            Divided::Record(Box::new(toy())),
            Divided::Sweep(Box::new(sweep)),
            Divided::Evaluate(Box::new(evaluate)),
            Divided::Train(vec![train.clone(), Train { seed: None, ..train.clone() }]),
        ] {
            let json = serde_json::to_string(&request).unwrap();
            assert_eq!(serde_json::from_str::<Divided>(&json).unwrap(), request, "{json}");
        }
        let json = serde_json::to_value(Divided::Record(Box::new(toy()))).unwrap();
        let given = json!({ "env": TOY.id, "episodes": 8, "seed": 3, "image_size": null });
        assert_eq!(json, json!({ "record": given }));
        let json = serde_json::to_value(Divided::Train(vec![train])).unwrap();
        assert_eq!(json, json!({ "train": [{ "baseline": "lewm", "seed": 3 }] }));
        for (wrong, reason) in [
            (json!({}), "one request by its name"),
            (json!({ "train": ["lewm"] }), "one request by its name"),
            (json!({ "train": [{ "baselin": "lewm" }] }), "did you mean `baseline`?"),
            (json!({ "record": {}, "sweep": {} }), "one request by its name"),
            (json!({ "plan": {} }), "`plan` is no request that can be divided"),
            (json!({ "record": { "epsodes": 3 } }), "did you mean `episodes`?"),
        ] {
            let error = serde_json::from_value::<Divided>(wrong).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn what_the_parts_get_is_refused_in_the_whole() {
        let (out, shard) = (Some(PathBuf::from("a")), "1/2".parse().ok());
        let record = |changed: Record| Divided::Record(Box::new(changed));
        let evaluate = |changed: Evaluate| Divided::Evaluate(Box::new(changed));
        for (request, setting) in [
            (record(Record { out: "a.h5".into(), ..toy() }), "out"),
            (record(Record { mix: true, ..toy() }), "mix"),
            (record(Record { shard, ..toy() }), "shard"),
            (record(Record { mode: swm_data::WriteMode::Append, ..toy() }), "mode"),
            (evaluate(Evaluate { out: out.clone(), ..Evaluate::default() }), "out"),
            (evaluate(Evaluate { again: true, ..Evaluate::default() }), "again"),
            (Divided::Sweep(Box::new(Sweep { join: true, ..Sweep::default() })), "join"),
            (Divided::Train(vec![Train::default(), Train { resume: out, ..Train::default() }]), "resume"),
        ] {
            let error = request.check_undivided().unwrap_err();
            assert_eq!(error.fix(), Some(&Fix::Leave(setting)), "{error}");
        }
        assert!(record(toy()).check_undivided().is_ok());
    }

    #[test]
    fn a_training_is_begun_in_its_folder_and_resumed_there() {
        let folder = tempfile::tempdir().unwrap();
        let run = |seed| Train {
            seed: Some(seed),
            device: "cuda:1".to_owned(),
            threads: Some(2),
            ..Train::default()
        };
        let both = Divided::Train(vec![run(1), run(2)]);
        let part = || both.part(Shard::new(2, 2).unwrap(), folder.path().to_owned());
        assert_eq!(part(), Divided::Train(vec![Train { out: folder.path().to_owned(), ..run(2) }]));
        std::fs::write(folder.path().join("config.json"), "{}").unwrap();
        let resumed = Train { resume: Some(folder.path().to_owned()), seed: None, ..run(2) };
        assert_eq!(part(), Divided::Train(vec![resumed]));
    }

    #[test]
    fn image_files_by_the_million_are_refused_before_they_are_written() {
        let registry = Registry::new().with(swm_data::FORMATS).with(&[TOY]);
        let folder = tempfile::tempdir().unwrap();
        let needs = |format: &str, episodes: u64| {
            let out = folder.path().join("part.h5");
            let format = Some(format.to_owned());
            let request = Record { format, episodes: Some(episodes), out, ..toy() };
            Divided::Record(Box::new(request)).needs(&registry, &mut ())
        };
        assert_eq!(needs("hdf5", 1 << 20).unwrap(), Needs { episodes: 1 << 20, inputs: Vec::new() });
        assert!(needs("folder", 10_000).is_ok());
        let error = needs("folder", 10_001).unwrap_err();
        assert!(error.to_string().contains("up to 1000100 image files"), "{error}");
        assert_eq!(error.fix(), Some(&Fix::Leave("format")));
    }
}
