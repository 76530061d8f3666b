//! Runs as checkpoints that others load: `weights.pt` and `config.json` of stable-worldmodel's `load_pretrained`, with a model card.
//!
//! | file | duty |
//! |---|---|
//! | `form` | a run's tensors and config in the reference's words |
//! | `layout` | what the family of a model decides about them |
//! | `joint`, `tokens`, `tdmpc2` | the config of each family, and what of a run it cannot say |
//! | `backbone` | a frozen DINOv2 or ViT: by the name under which it is published, or as a folder beside |
//! | `names` | names of tensors in the two generations of transformers |
//! | `card` | the model card, and `swm.json`, which has what no other file contains |
//!
//! The inverse of [`crate::import`], which reads all of it.

mod backbone;
mod card;
mod form;
mod joint;
mod layout;
mod names;
mod tdmpc2;
#[cfg(test)]
mod tests;
mod tokens;

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value as Json;
use swm_baselines::BaselineError;
use swm_core::Registry;
use swm_core::evaluate::sha256_of;
use swm_tasks::request::{Assignment, Fix, Message, Report, Request, TaskError};

use form::Form;
use names::Generation;

/// The file of weights, which the reference takes as the only one of its ending.
const WEIGHTS: &str = "weights.pt";

swm_core::settings! {
    /// Write a run as a checkpoint that stable-worldmodel's `load_pretrained` takes.
    pub struct Export {
        /// The run's folder.
        run: PathBuf = PathBuf::new() => "must be given",
        /// Which checkpoint: last, best, or a step.
        checkpoint: String = "last".to_owned() => "last",
        /// The version of transformers, 4 or 5, whose names the tensors of its encoder get.
        transformers: Option<usize> = None => "that of the checkpoint that the run was imported from, else 4",
        /// The receipt of an evaluation of this checkpoint, for the card: its file or folder.
        receipt: Option<PathBuf> = None => "none",
        /// The folder, which must not be there yet.
        out: PathBuf = PathBuf::new() => "must be given",
    }
}

/// What was written.
#[derive(Clone, Debug, Default, Serialize)]
#[non_exhaustive]
pub struct Exported {
    /// The model: a baseline, or an agent.
    pub model: String,
    /// Its class in the reference.
    pub class: String,
    /// The folder.
    pub folder: PathBuf,
    /// The step of the run's checkpoint.
    pub step: u64,
    /// Tensors of `weights.pt`.
    pub tensors: usize,
    /// The version of transformers whose names the encoder's tensors have; `None`: there is no vision transformer.
    pub transformers: Option<usize>,
    /// SHA-256 of `weights.pt`.
    pub sha256: String,
    /// The files, by their places in the folder.
    pub files: Vec<String>,
    /// Parts of the run that the reference's model does not have, such as losses' networks.
    pub left_out: Vec<String>,
    /// What a user of the folder has to know.
    pub notes: Vec<String>,
}

impl Request for Export {
    const NAME: &'static str = "export";
    type Outcome = Exported;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        let missing = |name: &'static str, what: &str| -> TaskError {
            let setting = Assignment::name(name);
            Message::new(format!("{what} must be named")).fix(Fix::Set { setting, to: "" }).into()
        };
        if self.run.as_os_str().is_empty() {
            return Err(missing("run", "a run to export"));
        }
        if self.out.as_os_str().is_empty() {
            return Err(missing("out", "a folder for the checkpoint"));
        }
        if let Some(version) = self.transformers
            && Generation::of(version).is_none()
        {
            let reason = "is no version whose names are known";
            let known = Fix::Choose(vec!["4".to_owned(), "5".to_owned()]);
            return Err(Message::about("transformers", version, reason).fix(known).into());
        }
        if fs::symlink_metadata(&self.out).is_ok() {
            let reason = "there is something of that name already, which an export does not replace";
            return Err(Message::about("out", self.out.display().to_string(), reason)
                .fix(Fix::Change("out"))
                .into());
        }
        Ok(())
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Exported, TaskError> {
        self.check(registry)?;
        let form = Form::of_run(self)?;
        for note in &form.notes {
            report.note(&Message::new(note.clone()));
        }
        let draft = swm_files::draft(&self.out);
        let written = write(&form, &draft).and_then(|exported| {
            settle(&draft, &self.out)?;
            Ok(Exported { folder: self.out.clone(), ..exported })
        });
        if written.is_err() {
            let _ = fs::remove_dir_all(&draft);
        }
        Ok(written?)
    }
}

/// Fills the new folder `folder`.
fn write(form: &Form, folder: &Path) -> Result<Exported, BaselineError> {
    let failed = |path: &Path, source| BaselineError::Io { action: "write", path: path.to_owned(), source };
    let put = |name: &str, bytes: &[u8]| -> Result<(), BaselineError> {
        let path = folder.join(name);
        let all = || -> std::io::Result<()> {
            if let Some(parent) = path.parent() {
                fs::create_dir_all(parent)?;
            }
            fs::write(&path, bytes)?;
            File::open(&path)?.sync_all()
        };
        all().map_err(|source| failed(&path, source))
    };
    fs::create_dir_all(folder).map_err(|source| failed(folder, source))?;
    let path = folder.join(WEIGHTS);
    swm_weights::save(&path, &form.tensors).map_err(|source| failed(&path, source))?;
    let sha256 = File::open(&path).and_then(sha256_of).map_err(|source| failed(&path, source))?;
    put("config.json", &json(&form.config))?;
    let mut names: Vec<String> = [WEIGHTS, "config.json", "swm.json", "README.md"].map(str::to_owned).into();
    if let Some(backbone) = &form.backbone {
        put(&format!("{}/config.json", backbone::FOLDER), &json(&backbone.config))?;
        let path = folder.join(backbone::FOLDER).join("model.safetensors");
        swm_weights::write_for_transformers(&path, backbone.tensors.clone())?;
        names.push(format!("{}/config.json", backbone::FOLDER));
        names.push(format!("{}/model.safetensors", backbone::FOLDER));
    }
    put("swm.json", &json(&form.notes_file))?;
    let exported = Exported {
        model: form.model.clone(),
        class: form.config["_target_"].as_str().unwrap_or_default().to_owned(),
        folder: PathBuf::new(),
        step: form.step,
        tensors: form.tensors.len(),
        transformers: form.transformers,
        sha256,
        files: names,
        left_out: form.left_out.clone(),
        notes: form.notes.clone(),
    };
    put("README.md", card::text(form, &exported).as_bytes())?;
    Ok(exported)
}

/// Gives the finished folder its name, if nothing has it yet.
fn settle(draft: &Path, out: &Path) -> Result<(), BaselineError> {
    let free = match fs::symlink_metadata(out) {
        Ok(_) => Err(std::io::ErrorKind::AlreadyExists.into()),
        Err(_) => Ok(()),
    };
    let settled = free.and_then(|()| swm_files::settle(draft, out));
    settled.map_err(|source| BaselineError::Io { action: "write", path: out.to_owned(), source })
}

fn json(value: &Json) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(value).expect("plain data with text keys");
    text.push(b'\n');
    text
}
