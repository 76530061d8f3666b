//! A checkpoint's `config.json`, walked by name: which class it names is looked up in a table, and nothing of it is executed.

use std::fmt::Display;

use serde_json::{Map, Value as Json};
use swm_tasks::request::{Message, TaskError};

/// Classes of models, by the names that versions of the reference have had, and what they are here.
const CLASSES: &[(&str, Model)] = &[
    ("stable_worldmodel.wm.lewm.LeWM", Model::Lewm),
    ("stable_worldmodel.wm.lewm.lewm.LeWM", Model::Lewm),
    ("stable_worldmodel.wm.LeWM", Model::Lewm),
    ("jepa.JEPA", Model::Lewm),
    ("stable_worldmodel.wm.pldm.pldm.PLDM", Model::Pldm),
    ("stable_worldmodel.wm.pldm.PLDM", Model::Pldm),
    ("stable_worldmodel.wm.PLDM", Model::Pldm),
    ("stable_worldmodel.wm.PreJEPA", Model::DinoWm),
    ("stable_worldmodel.wm.prejepa.PreJEPA", Model::DinoWm),
    ("stable_worldmodel.wm.prejepa.prejepa.PreJEPA", Model::DinoWm),
    ("models.visual_world_model.VWorldModel", Model::DinoWm),
    ("stable_worldmodel.wm.gcrl.gcrl.GCRL", Model::Goal),
    ("stable_worldmodel.wm.gcrl.GCRL", Model::Goal),
    ("stable_worldmodel.wm.GCRL", Model::Goal),
    ("stable_worldmodel.wm.tdmpc2.TDMPC2", Model::Tdmpc2),
    ("stable_worldmodel.wm.tdmpc2.tdmpc2.TDMPC2", Model::Tdmpc2),
    ("stable_worldmodel.wm.TDMPC2", Model::Tdmpc2),
];

/// Classes that are known and not to be had.
const OTHERS: &[(&str, &str)] = &[
    ("stable_worldmodel.wm.gcbc.GCBC", "the GCBC of stable-worldmodel 0.0.3, another network than today's"),
    (
        "stable_worldmodel.wm.gcbc.gcbc.GCBC",
        "the GCBC of stable-worldmodel 0.0.3, another network than today's",
    ),
];

/// What the names of modules begin with.
const MODULES: [&str; 5] = ["stable_worldmodel.", "stable_pretraining.", "torch.nn.", "jepa.", "module."];

/// The models that can be had.
pub(super) const KNOWN: [&str; 8] = ["lewm", "pldm", "dino-wm", "gcbc", "gciql", "gcivl", "hilp", "tdmpc2"];

/// A family of models.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Model {
    /// LeWM.
    Lewm,
    /// PLDM.
    Pldm,
    /// DINO-WM, which the reference calls PreJEPA.
    DinoWm,
    /// A goal-conditioned policy: tensors say which.
    Goal,
    /// TD-MPC2.
    Tdmpc2,
}

impl Model {
    /// What it is called here.
    pub(super) fn names(self) -> &'static str {
        match self {
            Self::Lewm => "lewm",
            Self::Pldm => "pldm",
            Self::DinoWm => "dino-wm",
            Self::Goal => "gcbc, gciql, gcivl or hilp",
            Self::Tdmpc2 => "tdmpc2",
        }
    }

    /// Whether models of this kind are of this class.
    pub(super) fn is_of(self, kind: &str) -> bool {
        match self {
            Self::Lewm => kind == "lewm",
            Self::Pldm => kind == "pldm",
            Self::DinoWm => kind == "dino-wm",
            Self::Goal => ["gcbc", "gciql", "gcivl", "hilp"].contains(&kind),
            Self::Tdmpc2 => kind == "tdmpc2",
        }
    }
}

/// Whether a size of a config is so far above that of the weights that no model is made of it.
pub(super) fn is_far_above(said: usize, weights: usize) -> bool {
    said / 2 > weights
}

/// The deepest nesting of a config.
const DEEPEST: usize = 32;

/// A part of a config, and where it is.
#[derive(Clone, Debug)]
pub(super) struct Node<'a> {
    /// The file.
    file: &'a str,
    /// `predictor.num_frames`; empty for the whole.
    place: String,
    value: &'a Json,
}

impl<'a> Node<'a> {
    /// The whole of a file; of a training's, the model in it that has a class.
    pub(super) fn root(file: &'a str, value: &'a Json) -> Result<Self, TaskError> {
        let root = Self { file, place: String::new(), value };
        if !value.is_object() {
            return Err(root.wrong("holds no settings"));
        }
        let root = match root.get("model") {
            // The archive of DINO-WM's authors has a class there, too, and its settings beside it.
            Some(model) if model.get("_target_").is_some() && root.get("num_hist").is_none() => model,
            _ => root,
        };
        root.check(DEEPEST)?;
        Ok(root)
    }

    /// Refuses what training would have filled in, and nesting without end.
    fn check(&self, left: usize) -> Result<(), TaskError> {
        if left == 0 {
            return Err(self.wrong(&format!("is nested more than {DEEPEST} times")));
        }
        match self.value {
            Json::String(text) if text == "???" => Err(self.unfinished(text)),
            Json::Object(fields) => {
                fields.iter().try_for_each(|(name, value)| self.at(name, value).check(left - 1))
            }
            Json::Array(items) => items
                .iter()
                .enumerate()
                .try_for_each(|(index, value)| self.at(&index.to_string(), value).check(left - 1)),
            _ => Ok(()),
        }
    }

    fn at(&self, name: &str, value: &'a Json) -> Self {
        let place = if self.place.is_empty() { name.to_owned() } else { format!("{}.{name}", self.place) };
        Self { file: self.file, place, value }
    }

    fn told(&self, reason: &str) -> String {
        match self.place.is_empty() {
            true => format!("{}: {reason}", self.file),
            false => format!("{}: {} {reason}", self.file, self.place),
        }
    }

    fn unfinished(&self, text: &str) -> TaskError {
        self.wrong(&format!("is {text}: an unfinished Hydra config; take the one that training wrote"))
    }

    /// About this part.
    pub(super) fn wrong(&self, reason: &str) -> TaskError {
        Message::new(self.told(reason)).into()
    }

    /// A field, if it is there and not null.
    pub(super) fn get(&self, name: &str) -> Option<Self> {
        let value = self.value.get(name)?;
        (!value.is_null()).then(|| self.at(name, value))
    }

    /// A field that must be there.
    pub(super) fn need(&self, name: &str) -> Result<Self, TaskError> {
        self.need_or(name, "")
    }

    /// The same; `instead` says what else can be done where it is not there.
    pub(super) fn need_or(&self, name: &str, instead: &str) -> Result<Self, TaskError> {
        let reason = || format!("is missing or null: this program needs it{instead}");
        self.get(name).ok_or_else(|| self.wrong_field(name, &reason()))
    }

    /// A text about a field.
    pub(super) fn told_of(&self, name: &str, reason: &str) -> String {
        self.at(name, &Json::Null).told(reason)
    }

    /// About a field.
    pub(super) fn wrong_field(&self, name: &str, reason: &str) -> TaskError {
        self.at(name, &Json::Null).wrong(reason)
    }

    /// Its fields.
    pub(super) fn fields(&self) -> Option<&'a Map<String, Json>> {
        self.value.as_object()
    }

    /// A field that is used, if it is there.
    fn used(&self, name: &str) -> Result<Option<Self>, TaskError> {
        let field = self.get(name);
        match field.as_ref().and_then(|field| Some((field, field.value.as_str()?))) {
            Some((field, text)) if text.contains("${") => Err(field.unfinished(text)),
            _ => Ok(field),
        }
    }

    /// A whole number in a field, if it is there. Models have no size of 0.
    pub(super) fn number(&self, name: &str) -> Result<Option<usize>, TaskError> {
        let Some(field) = self.used(name)? else { return Ok(None) };
        let number = field.value.as_u64().filter(|number| (1..=1 << 20).contains(number));
        match number {
            Some(number) => Ok(Some(number as usize)),
            None => Err(field.wrong(&format!("is {}; a whole number from 1 on is wanted", field.value))),
        }
    }

    /// A real number in a field, if it is there.
    pub(super) fn real(&self, name: &str) -> Result<Option<f64>, TaskError> {
        let Some(field) = self.used(name)? else { return Ok(None) };
        field.value.as_f64().map(Some).ok_or_else(|| field.wrong("is no number"))
    }

    /// A text in a field, if it is there.
    pub(super) fn text(&self, name: &str) -> Result<Option<&'a str>, TaskError> {
        let Some(field) = self.used(name)? else { return Ok(None) };
        field.value.as_str().map(Some).ok_or_else(|| field.wrong("is no text"))
    }

    /// Whether a field is true.
    pub(super) fn is_true(&self, name: &str) -> bool {
        self.value.get(name) == Some(&Json::Bool(true))
    }

    /// Refuses a field that is there and not true.
    pub(super) fn check_true(&self, name: &str) -> Result<(), TaskError> {
        match self.get(name) {
            Some(field) if !self.is_true(name) => Err(self.other(name, field.value, true)),
            _ => Ok(()),
        }
    }

    /// Whether it is the config of a whole training: neither it nor a part of a model in it names a class.
    pub(super) fn is_training(&self) -> bool {
        let has_class = |node: &Self| node.get("_target_").is_some();
        let parts = ["encoder", "predictor", "action_predictor", "action_encoder"];
        !has_class(self) && !parts.iter().any(|part| self.get(part).as_ref().is_some_and(has_class))
    }

    /// The last part of the name of its class, if it has one.
    pub(super) fn class(&self) -> Result<Option<&'a str>, TaskError> {
        Ok(self.text("_target_")?.map(|class| class.rsplit('.').next().unwrap_or(class)))
    }

    /// The class of the model; `None` where the config has no `_target_`.
    pub(super) fn model(&self) -> Result<Option<Model>, TaskError> {
        let Some(class) = self.text("_target_")? else { return Ok(None) };
        if let Some((_, what)) = OTHERS.iter().find(|(known, _)| *known == class) {
            return Err(self.wrong(&format!("_target_ {class} is {what}, which this program does not have")));
        }
        let known = CLASSES.iter().find(|(known, _)| *known == class);
        known.map(|(_, model)| Some(*model)).ok_or_else(|| {
            let known = KNOWN.join(", ");
            self.wrong(&format!("_target_ {class} is no model that this program has; known are {known}"))
        })
    }

    /// Refuses a module that is none of these classes.
    pub(super) fn check_class(&self, classes: &[&str]) -> Result<(), TaskError> {
        let Some(class) = self.text("_target_")? else {
            return Err(self.wrong(&format!("has no _target_; {} is wanted", classes.join(" or "))));
        };
        let last = class.rsplit('.').next().unwrap_or(class);
        if !MODULES.iter().any(|module| class.starts_with(module)) {
            let reason = format!("{class} is no module of a known model; nothing of a config is executed");
            return Err(Message::new(format!("{}: {}: {reason}", self.file, self.place)).into());
        }
        if !classes.contains(&last) {
            let wanted = classes.join(" or ");
            return Err(self.wrong(&format!("is a {class}, and this program has {wanted} in its place")));
        }
        Ok(())
    }

    /// The same, and fields that are not among `fields`.
    pub(super) fn check_module(&self, classes: &[&str], fields: &[&str]) -> Result<(), TaskError> {
        self.check_class(classes)?;
        let known = |name: &&String| {
            ["_target_", "_partial_"].contains(&name.as_str()) || fields.contains(&name.as_str())
        };
        match self.fields().into_iter().flatten().find(|(name, value)| !known(name) && !value.is_null()) {
            Some((name, value)) => Err(self
                .at(name, value)
                .wrong("is a setting of the reference that this program does not have")),
            None => Ok(()),
        }
    }

    /// Refuses a field with another value than `wanted`, where it is there.
    pub(super) fn check_field(&self, name: &str, wanted: usize) -> Result<(), TaskError> {
        match self.number(name)? {
            Some(found) if found != wanted => Err(self.other(name, found, wanted)),
            _ => Ok(()),
        }
    }

    /// A size in a field, or else that of the weights. One that is far above theirs is refused before anything of it is made; others that differ are
    /// found where the weights are loaded, with the names of tensors.
    pub(super) fn size(&self, name: &str, weights: Option<usize>) -> Result<Option<usize>, TaskError> {
        match (self.number(name)?, weights) {
            (Some(said), Some(found)) if is_far_above(said, found) => {
                let reason =
                    format!("is {said}, and the weights have {found}; take the config that training wrote");
                Err(self.wrong_field(name, &reason))
            }
            (said, found) => Ok(said.or(found)),
        }
    }

    /// About a field whose value is another than that of this program.
    pub(super) fn other(&self, name: &str, found: impl Display, wanted: impl Display) -> TaskError {
        let reason = format!("is {found}, and this program has {wanted} in its place");
        self.wrong_field(name, &reason)
    }
}
