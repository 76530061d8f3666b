//! A dataset is divided at random into parts: training, validation.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use serde_json::json;
use swm_core::Registry;
use swm_data::OpenOptions;
use swm_data::adapt::split_episodes;
use swm_data::tools::copy::{Piece, all};

use super::super::{Message, Report, Request, TaskError, must_be_given, wrong};
use super::{CopyOptions, DatasetCopy, Target};

/// What stands for the name of a part in the path to write.
const NAME: &str = "{}";

swm_core::settings! {
    /// Divide a dataset at random into parts of whole episodes: training, validation.
    pub struct Split {
        /// The dataset to divide.
        source: PathBuf = PathBuf::new() => "must be given",
        /// Names and fractions of the parts; fractions need not sum to 1.
        parts: Parts = Parts::default() => "train=0.9,val=0.1",
        /// Seed of the division.
        seed: u64 = 0,
        /// The files or folders to write, with `{}` for the name of the part.
        out: String = String::new() => "must be given",
        /// How a dataset of another program is opened: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
        ..to: CopyOptions,
    }
}

/// Parts of a dataset: names and fractions. JSON is a list of texts, `["train=0.9", "val=0.1"]`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "Vec<String>", try_from = "Vec<String>")]
pub struct Parts(Vec<(String, f64)>);

impl Default for Parts {
    fn default() -> Self {
        Self(vec![("train".to_owned(), 0.9), ("val".to_owned(), 0.1)])
    }
}

impl fmt::Display for Parts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&Vec::from(self.clone()).join(","))
    }
}

impl From<Parts> for Vec<String> {
    fn from(Parts(parts): Parts) -> Self {
        parts.iter().map(|(name, fraction)| format!("{name}={fraction}")).collect()
    }
}

impl TryFrom<Vec<String>> for Parts {
    type Error = TaskError;

    fn try_from(texts: Vec<String>) -> Result<Self, TaskError> {
        let mut parts: Vec<(String, f64)> = Vec::with_capacity(texts.len());
        for text in &texts {
            let wrong = |why: &str| wrong(format!("{text}: {why}"));
            let (name, fraction) = text.split_once('=').ok_or_else(|| wrong("write NAME=FRACTION"))?;
            let fraction = fraction.trim().parse().map_err(|_| wrong("the fraction is no number"))?;
            let name = name.trim();
            if name.is_empty() || name.contains(['/', '\\']) || parts.iter().any(|(there, _)| there == name) {
                return Err(wrong("each part needs a name of its own, without slashes"));
            }
            parts.push((name.to_owned(), fraction));
        }
        Ok(Self(parts))
    }
}

impl FromStr for Parts {
    type Err = TaskError;

    fn from_str(text: &str) -> Result<Self, TaskError> {
        text.split(',').map(str::to_owned).collect::<Vec<_>>().try_into()
    }
}

impl Parts {
    fn fractions(&self) -> Vec<f64> {
        self.0.iter().map(|(_, fraction)| *fraction).collect()
    }
}

impl Request for Split {
    const NAME: &'static str = "split";
    type Outcome = Vec<DatasetCopy>;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("source", self.source.as_os_str().is_empty()), ("out", self.out.is_empty())])?;
        if !self.out.contains(NAME) {
            let text = "write `{}` where the name of the part belongs";
            return Err(Message::about("out", self.out.as_str(), text).into());
        }
        self.divided(1)?;
        self.opening.check().map_err(wrong)?;
        self.to.check(registry)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Vec<DatasetCopy>, TaskError> {
        self.check(registry)?;
        let mut sources =
            vec![self.to.open(registry, &self.source, Path::new(&self.out), &self.opening, report)?];
        let count = sources[0].num_episodes();
        let divided = self.divided(count)?;
        self.note_shares(report);
        let Parts(parts) = &self.parts;
        if let Some(((name, _), _)) = parts.iter().zip(&divided).find(|(_, episodes)| episodes.is_empty()) {
            let text = format!("`{name}` would get none of the {count} episodes");
            return Err(Message::about("parts", json!(self.parts), text).into());
        }
        let pieces = all(&sources);
        self.to.check_rate(&mut sources, &pieces, report)?;
        let mut copies = Vec::with_capacity(parts.len());
        for ((name, _), episodes) in parts.iter().zip(divided) {
            let out = PathBuf::from(self.out.replace(NAME, name));
            let pieces: Vec<Piece> = episodes.into_iter().map(|episode| (0, episode)).collect();
            let target = Target { setting: "out", path: &out };
            copies.push(self.to.copy(registry, &sources, &pieces, target, report)?);
        }
        Ok(copies)
    }
}

impl Split {
    /// The episodes of each part.
    fn divided(&self, count: usize) -> Result<Vec<Vec<usize>>, TaskError> {
        let divided = split_episodes(count, &self.parts.fractions(), self.seed);
        divided.map_err(|error| Message::about("parts", json!(self.parts), error.to_string()).into())
    }

    /// Notes what fractions are that do not sum to 1.
    fn note_shares(&self, report: &mut dyn Report) {
        let Parts(parts) = &self.parts;
        let sum: f64 = parts.iter().map(|(_, fraction)| fraction).sum();
        if (sum - 1.0).abs() > 1e-9 {
            let share = |(name, part): &(String, f64)| format!("{name} {:.1} %", 100.0 * part / sum);
            let shares: Vec<String> = parts.iter().map(share).collect();
            let text = format!("they sum to {sum}; the parts are {}", shares.join(", "));
            report.note(&Message::about_setting("parts", text));
        }
    }
}
