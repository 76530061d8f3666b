//! Two datasets are compared, of whatever formats.

use std::path::PathBuf;

use swm_core::Registry;
use swm_data::OpenOptions;
use swm_data::adapt::Watched;
use swm_data::tools::compare::{Comparison, compare};

use super::copies::{check_exists, ended};
use super::{
    Fix, Message, Report, Request, Stage, TaskError, apart, check_tolerance, must_be_given, open_dataset,
    open_dataset_with, wrong,
};

swm_core::settings! {
    /// Compare two datasets: columns, episodes and values.
    pub struct Diff {
        /// The first dataset.
        first: PathBuf = PathBuf::new() => "must be given",
        /// The second dataset.
        second: PathBuf = PathBuf::new() => "must be given",
        /// Largest accepted absolute difference of values.
        tolerance: f64 = 0.0,
        /// Only these columns.
        columns: Vec<String> = Vec::new() => "all",
        /// All columns but these.
        ignore: Vec<String> = Vec::new() => "none",
        /// How the first dataset is opened, where it is of another program: map, camera, flip, split, … by name.
        opening: OpenOptions = OpenOptions::default() => "none",
    }
}

impl Request for Diff {
    const NAME: &'static str = "diff";
    type Outcome = Comparison;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        let is_missing = |path: &PathBuf| path.as_os_str().is_empty();
        must_be_given(&[("first", is_missing(&self.first)), ("second", is_missing(&self.second))])?;
        check_tolerance(self.tolerance)?;
        if !self.columns.is_empty() && !self.ignore.is_empty() {
            let message = Message::about("ignore", self.ignore.clone(), "columns are chosen already");
            return Err(message.fix(Fix::Any(vec![Fix::Leave("columns"), Fix::Leave("ignore")])).into());
        }
        self.opening.check().map_err(wrong)?;
        [&self.first, &self.second].into_iter().try_for_each(|path| check_exists(path))
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Comparison, TaskError> {
        self.check(registry)?;
        let open = || {
            let first = open_dataset_with(registry, &self.first, &self.opening)?;
            Ok::<_, TaskError>([first, open_dataset(registry, &self.second)?])
        };
        let [first, second] = apart(report, open)??;
        for name in self.columns.iter().chain(&self.ignore) {
            let schema = first.schema();
            if second.schema().index(name).is_none() {
                schema.require(name).map_err(wrong)?;
            }
        }
        let wanted = |name: &str| match self.columns.is_empty() {
            true => !self.ignore.iter().any(|ignored| ignored == name),
            false => self.columns.iter().any(|column| column == name),
        };
        let rows: usize = (0..first.num_episodes()).map(|episode| first.episode_len(episode)).sum();
        let name = self.first.display().to_string();
        let progress = report.begin(&Stage { name: &name, role: None, unit: "rows", total: rows as u64 })?;
        let [mut first, mut second] = [first, second].map(|dataset| Watched::new(dataset, report.cancel()));
        let watch = &mut |rows: usize| progress.advance(rows as u64);
        let work = || compare(&mut first, &mut second, &wanted, self.tolerance, watch);
        apart(report, work)?.map_err(|error| ended(error.into(), report))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};
    use swm_data::WriteMode;
    use swm_data::testing::record;

    use super::*;

    fn ask(given: &Json) -> Result<Comparison, TaskError> {
        let registry = Registry::new().with(swm_data::FORMATS);
        Diff::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, &mut ()))
    }

    #[test]
    fn datasets_are_compared_and_every_refusal_names_its_setting() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second) = (folder.path().join("a.h5"), folder.path().join("b.mcap"));
        record(&first, WriteMode::Error, 0..3).unwrap();
        record(&second, WriteMode::Error, 0..2).unwrap();
        let all = ask(&json!({ "first": first, "second": second })).unwrap();
        assert!(!all.equal && all.episodes == [3, 2], "{all:?}");
        let same = ask(&json!({ "first": first, "second": first, "columns": ["action"] })).unwrap();
        assert!(same.equal && same.columns.len() == 1, "{same:?}");
        for (given, text) in [
            (json!({ "second": second }), "first: must be given"),
            (json!({ "first": first, "second": second, "tolerance": -0.5 }), "tolerance=-0.5: use a number"),
            (
                json!({ "first": first, "second": second, "columns": ["action"], "ignore": ["pixels"] }),
                "ignore=pixels: columns are chosen already; leave out columns, or leave out ignore",
            ),
            (json!({ "first": first, "second": second, "columns": ["acton"] }), "did you mean `action`?"),
            (json!({ "first": first, "second": folder.path().join("c.h5") }), "c.h5"),
        ] {
            match ask(&given) {
                Err(error @ TaskError::Request(_)) => {
                    assert!(error.to_string().contains(text), "{text}: {error}");
                }
                other => panic!("{given}: {other:?}"),
            }
        }
    }
}
