//! Published results, repeated: a recipe names checkpoint, dataset, protocol and reported figures; what it needs is looked for, imported,
//! evaluated and compared.
//!
//! | file | duty |
//! |---|---|
//! | `recipe`, `recipes/` | what a result takes, as data |
//! | `needs` | what must be downloaded, and where it is looked for |
//! | `table` | ours and theirs |

mod needs;
mod recipe;
mod table;

use std::path::{Path, PathBuf};

use swm_baselines::train::{RunConfig, RunFolder};
use swm_core::settings::assignments;
use swm_core::{ImageSize, Manifest, Registry};
use swm_tasks::evaluation::Receipt;
use swm_tasks::request::{
    Evaluate, Evaluated, Fix, MakeManifest, ManifestSource, Message, NUM_ENVS, Report, Request, TaskError,
    make_folder,
};

use crate::import::{Import, weights_of};

pub use needs::Need;
pub use recipe::{Checkpoint, Clear, ClearFile, Data, Figure, Made, Recipe, recipes};
pub use table::{Repetition, Reproduced, Row};

swm_core::settings! {
    /// Repeat a published result: import its checkpoint, evaluate it, and compare with what was reported.
    pub struct Reproduce {
        /// The recipe, such as lewm-pusht.
        name: String = String::new() => "must be given",
        /// A recipe in a file of TOML, in place of a named one.
        recipe: Option<PathBuf> = None => "none",
        /// The folder that downloads lie in.
        folder: Option<PathBuf> = None => "$STABLEWM_HOME, or ~/.stable_worldmodel",
        /// Fetch what is missing into that folder, by the programs hf and curl.
        fetch: bool = false,
        /// The checkpoint: its folder or file, or hf:USER/REPO in a local cache.
        checkpoint: Option<String> = None => "looked for",
        /// The dataset.
        dataset: Option<PathBuf> = None => "looked for",
        /// Only these of the reported figures, by name.
        figure: Vec<String> = Vec::new() => "all",
        /// Only the first pairs of each manifest.
        pairs: Option<usize> = None => "all",
        /// Device of the networks: cpu, cuda, cuda:1 ….
        device: String = "cpu".to_owned() => "cpu",
        /// Environments stepped in parallel; results do not depend on it.
        num_envs: usize = NUM_ENVS => "8",
        /// Threads; results do not depend on it.
        threads: Option<usize> = None => "one per core",
        /// The folder for the run, the manifests, the receipts and the table.
        out: PathBuf = PathBuf::new() => "must be given",
        /// Evaluate again what the folder holds already.
        again: bool = false,
        /// Look for what is needed, and do nothing.
        check_only: bool = false,
    }
}

impl Request for Reproduce {
    const NAME: &'static str = "reproduce";
    type Outcome = Reproduced;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        let recipe = self.read_recipe()?;
        self.figures(&recipe)?;
        registry.env(&recipe.env).map_err(|error| Message::new(error.to_string()))?;
        if self.out.as_os_str().is_empty() && !self.check_only {
            let fixes = vec![Fix::give("out"), Fix::set("check_only", true)];
            return Err(Message::new("a folder for the results must be named").fix(Fix::Any(fixes)).into());
        }
        for (name, is_zero) in [("pairs", self.pairs == Some(0)), ("num_envs", self.num_envs == 0)] {
            if is_zero {
                return Err(Message::about(name, 0, "use 1 or more").into());
            }
        }
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Reproduced, TaskError> {
        self.check(registry)?;
        let recipe = self.read_recipe()?;
        let figures = self.figures(&recipe)?;
        let folder = self.downloads()?;
        let find = || needs::find(self, &recipe, &figures, &folder);
        let mut needs = find();
        if self.check_only {
            return Ok(Reproduced::new(&recipe, &folder, needs));
        }
        if self.fetch {
            needs::fetch(&needs, &mut needs::start)?;
            needs = find();
        }
        needs::check_found(&recipe, &needs)?;
        let [checkpoint, dataset, ..] = &needs[..] else {
            unreachable!("a checkpoint and a dataset are always needed")
        };
        let given = |need: &Need| need.found.clone().unwrap_or_default();
        let (checkpoint, dataset) = (given(checkpoint), PathBuf::from(given(dataset)));
        make_folder(&self.out)?;
        let run = self.import(&recipe, checkpoint, &dataset, registry, report)?;
        let mut done = Reproduced::new(&recipe, &folder, needs);
        done.run = Some(run.clone());
        for figure in figures {
            let tasks = self.manifests(&recipe, figure, &folder, &dataset, registry, report)?;
            let mut receipts = Vec::new();
            for (seed, place, manifest) in tasks {
                let receipt = self.evaluate(&recipe, &run, &manifest, &place, registry, report)?;
                receipts.push((seed, place.join("receipt.json"), receipt));
            }
            done.rows.push(Row::new(figure, &receipts));
        }
        done.write(&self.out)?;
        Ok(done)
    }
}

impl Reproduce {
    fn read_recipe(&self) -> Result<Recipe, TaskError> {
        match (&self.recipe, self.name.is_empty()) {
            (Some(path), true) => Recipe::read(path),
            (Some(path), false) => {
                let message =
                    Message::about("recipe", path.display().to_string(), "is in place of a named one");
                Err(message.fix(Fix::Any(vec![Fix::Leave("recipe"), Fix::Leave("name")])).into())
            }
            (None, false) => Recipe::named(&self.name),
            (None, true) => {
                let names = recipes().into_iter().map(|recipe| recipe.name).collect();
                Err(Message::about_setting("name", "must be given").fix(Fix::Choose(names)).into())
            }
        }
    }

    /// The figures that are to be repeated.
    fn figures<'a>(&self, recipe: &'a Recipe) -> Result<Vec<&'a Figure>, TaskError> {
        let known = |name: &String| recipe.figures.iter().find(|figure| figure.name == *name);
        if self.figure.is_empty() {
            return Ok(recipe.figures.iter().collect());
        }
        let find = |name: &String| {
            known(name).ok_or_else(|| {
                let names = recipe.figures.iter().map(|figure| figure.name.clone()).collect();
                let reason = format!("is no figure of {}", recipe.name);
                TaskError::from(Message::about("figure", name.clone(), reason).fix(Fix::Choose(names)))
            })
        };
        self.figure.iter().map(find).collect()
    }

    /// Where downloads lie.
    fn downloads(&self) -> Result<PathBuf, TaskError> {
        let named = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let home = || named("STABLEWM_HOME").or_else(|| Some(named("HOME")?.join(".stable_worldmodel")));
        self.folder.clone().or_else(home).ok_or_else(|| {
            Message::new("nothing says in which folder downloads lie").fix(Fix::give("folder")).into()
        })
    }

    /// The checkpoint as a run: the one that is there already, if it is of these weights.
    fn import(
        &self,
        recipe: &Recipe,
        from: String,
        dataset: &Path,
        registry: &Registry,
        report: &mut dyn Report,
    ) -> Result<PathBuf, TaskError> {
        let out = self.out.join("run");
        let is_file = Path::new(&from).is_file();
        let file = (!is_file).then(|| recipe.checkpoint.weights.clone());
        let weights = weights_of(&from, file.as_deref())?;
        needs::check_weights(&weights, recipe)?;
        if out.join("config.json").is_file() {
            let held = RunFolder::open(&out).and_then(|run| RunConfig::read(&run))?;
            let hash = swm_tasks::evaluation::file_hash(&weights)?;
            if held.imported.is_some_and(|imported| imported.sha256 == hash) {
                return Ok(out);
            }
            let text = format!("{} is a run of other weights than {}", out.display(), weights.display());
            return Err(Message::new(text).fix(Fix::Change("out")).into());
        }
        let request = Import {
            from,
            kind: Some(recipe.checkpoint.model.clone()),
            file,
            env: Some(recipe.env.clone()),
            env_option: recipe.env_option.clone(),
            dataset: Some(dataset.to_owned()),
            opening: recipe.dataset.opening.clone(),
            out: out.clone(),
            ..Import::default()
        };
        request.run(registry, report)?;
        Ok(out)
    }

    /// The manifests of a figure, each with its seed and the folder for its results.
    fn manifests(
        &self,
        recipe: &Recipe,
        figure: &Figure,
        folder: &Path,
        dataset: &Path,
        registry: &Registry,
        report: &mut dyn Report,
    ) -> Result<Vec<(u64, PathBuf, Manifest)>, TaskError> {
        let image = ImageSize::new(recipe.image, recipe.image).map_err(Message::new)?;
        let plain = MakeManifest {
            env: recipe.env.clone(),
            env_option: recipe.env_option.clone(),
            dataset: Some(dataset.to_owned()),
            opening: recipe.dataset.opening.clone(),
            image_size: Some(image),
            // Receipts hold their manifest: a file of another one is of no result here.
            overwrite: true,
            ..MakeManifest::default()
        };
        let mut requests = Vec::new();
        for file in figure.clear.iter().flat_map(|clear| &clear.manifest) {
            let clear = needs::manifest(folder, &file.path, &file.sha256)?;
            requests.push((file.seed, MakeManifest { clear: Some(clear), ..plain.clone() }));
        }
        for (made, &seed) in
            figure.made.iter().flat_map(|made| made.seeds.iter().map(move |seed| (made, seed)))
        {
            let request = MakeManifest {
                tier: made.tier,
                episodes: made.episodes,
                goal_offset: made.goal_offset,
                budget: Some(made.budget),
                held_out: made.held_out.unwrap_or(plain.held_out),
                seed,
                ..plain.clone()
            };
            requests.push((seed, request));
        }
        let make = |(seed, request): (u64, MakeManifest)| {
            let place = self.out.join(format!("{}-seed{seed}", figure.name));
            let request = MakeManifest { out: place.join("task.toml"), ..request };
            let mut manifest = request.run(registry, report)?;
            note_other_rows(recipe, &manifest, report);
            manifest.pairs.truncate(self.pairs.unwrap_or(usize::MAX));
            Ok((seed, place, manifest))
        };
        requests.into_iter().map(make).collect()
    }

    fn evaluate(
        &self,
        recipe: &Recipe,
        run: &Path,
        manifest: &Manifest,
        place: &Path,
        registry: &Registry,
        report: &mut dyn Report,
    ) -> Result<Receipt, TaskError> {
        let device = (self.device != "cpu").then(|| format!("device={}", self.device));
        let settings: Vec<String> = assignments(&recipe.policy).chain(device).collect();
        let source = match serde_json::to_value(manifest) {
            Ok(serde_json::Value::Object(json)) => ManifestSource::Json(json),
            other => return Err(Message::new(format!("the manifest is no object: {other:?}")).into()),
        };
        let request = Evaluate {
            manifest: Some(source),
            policy: [format!("mpc:{}", run.display())]
                .into_iter()
                .chain(settings)
                .collect::<Vec<_>>()
                .join(","),
            reference: vec!["random".to_owned()],
            num_envs: self.num_envs,
            threads: self.threads,
            out: Some(place.to_owned()),
            again: self.again,
            ..Evaluate::default()
        };
        match request.run(registry, report)? {
            Evaluated::Receipt(receipt, _) => Ok(*receipt),
            other => Err(Message::new(format!("no receipt was made: {other:?}")).into()),
        }
    }
}

/// Notes where the dataset is another file than the recipe's.
fn note_other_rows(recipe: &Recipe, manifest: &Manifest, report: &mut dyn Report) {
    use swm_core::evaluate::PairSource::{Chosen, Dataset};
    let (Dataset { hash, .. } | Chosen { hash, .. }) = &manifest.source else { return };
    if let Some(wanted) = recipe.dataset.sha256.as_ref().filter(|wanted| *wanted != hash) {
        report.note(&Message::new(format!(
            "the dataset has the SHA-256 {hash}, and the published {} has {wanted}: it is another file",
            recipe.dataset.name
        )));
    }
}
