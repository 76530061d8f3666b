//! A checkpoint, its environment and its scales, put together.

use std::fs::File;
use std::path::Path;

use serde_json::{Map, Value as Json, json};
use swm_baselines::online::{
    AgentConfig, Interface, LearnedData, OnlineAgent, OnlineConfig, agent_of, restore_agent,
};
use swm_baselines::train::{ACTION, DataConfig, Imported, RunConfig, Scale, Split, TrainedModel};
use swm_baselines::{BaselineError, DataDims, MakeOptions, make, weights};
use swm_core::Registry;
use swm_core::evaluate::sha256_of;
use swm_tasks::request::{Fix, Message, TaskError};
use swm_weights::{Contents, Of};

use super::config::{KNOWN, Model, Node};
use super::notes::{noted_bounds, noted_scales};
use super::place::Place;
use super::recipe::{Given, Recipe, lay_over, nested};
use super::scales::{self, Scales};
use super::shapes::Shapes;
use super::source::{self, Source, give};
use super::{Description, Import, joint, tdmpc2, tokens};

/// A checkpoint that can be used.
pub enum Loaded {
    /// A world model or a policy.
    Model(Box<TrainedModel>),
    /// An agent.
    Agent {
        /// It.
        agent: Box<dyn OnlineAgent>,
        /// What its run's `config.json` will say.
        config: Box<OnlineConfig>,
    },
}

/// Published weights, by the beginning of their hash.
const PUBLISHED: [(&str, &str); 4] = [
    ("48938400ae3464c9", "quentinll/lewm-pusht at 22b330c28c27"),
    ("2839a907362f403f", "quentinll/lewm-cube at b0747c5002e8"),
    ("566f223624ea4bfb", "quentinll/lewm-tworooms at 77adaae0bc31"),
    ("eb70b1fd5409f8f8", "quentinll/lewm-reacher at 62adae4b71dc"),
];

/// Describes a checkpoint, and loads it unless it is only checked.
pub(super) fn load(
    request: &Import,
    registry: &Registry,
) -> Result<(Description, Option<Loaded>), TaskError> {
    let source = source::find(&request.from, request.file.as_deref())?;
    let found = source.weights.as_deref().map(shapes_in).transpose()?;
    let set = set_of(request, &source);
    let recipe = recipe(request, &source, found.as_ref(), &set)?;
    let mut description = describe(&recipe, &source, found.as_ref())?;
    if let Some(encoder) = request.encoder.as_deref().filter(|_| recipe.without_encoder) {
        generation(&shapes_in(encoder)?).clone_into(&mut description.names);
    }
    let columns: Vec<&str> = match (recipe.name, recipe.vector) {
        ("tdmpc2", 0) => Vec::new(),
        ("tdmpc2", _) => vec![&recipe.column],
        (_, 0) => vec![ACTION],
        _ => vec![ACTION, &recipe.column],
    };
    let mut scales = scales::find(request, registry, &columns)?;
    noted_scales(&source, &columns, &mut scales);
    if let Some((mean, std, from)) = recipe.action_scale.clone() {
        let scale = Scale { mean, std };
        scales.of.entry(ACTION.to_owned()).or_insert_with(|| (scale, from.to_owned()));
    }
    let place = Place::find(request, registry, &source, scales.dataset.as_ref(), &scales)?;
    description.env.clone_from(&place.env);
    description.scales =
        scales.of.iter().map(|(name, (scale, from))| (name.clone(), scale.clone(), from.clone())).collect();
    let mut wants: Vec<Message> = columns
        .iter()
        .filter(|name| !scales.of.contains_key(**name))
        .map(|name| scales::unsaid(name))
        .collect();
    if place.env.is_none() {
        let text = "no file says which environment it was trained in";
        wants.push(Message::new(text).fix(give("env", "")));
    }
    if let (None, Some(config)) = (&source.weights, &source.config) {
        let text = format!("{}: no file of weights is beside it; put the published one there", config.name);
        wants.insert(0, Message::new(text));
    }
    place.check_vector(&recipe)?;
    let frameskip = place.frameskip(&recipe)?;
    description.frameskip = frameskip;
    description.missing.clone_from(&wants);
    let action = frameskip.map_or(recipe.block, |frameskip| recipe.block / frameskip.max(1));
    for (name, (scale, _)) in &scales.of {
        scales::check(name, scale, if name == ACTION { action } else { recipe.vector })?;
    }
    if !request.check_only
        && let Some(wanted) = wants.into_iter().next()
    {
        return Err(wanted.into());
    }
    let Some(path) = source.weights.clone() else {
        description.tensors = [0, tensors(&recipe, action, frameskip.unwrap_or(1), &set)?];
        return Ok((description, None));
    };
    let imported = Imported {
        source: request.from.clone(),
        file: path.clone(),
        sha256: description.sha256.clone().unwrap_or_default(),
        format: description.format.clone(),
        names: description.names.clone(),
        config_sha256: source.config.as_ref().map(|config| config.sha256.clone()),
        action_scale: scales.of.get(ACTION).map(|(_, from)| from.clone()),
        lacks: Vec::new(),
    };
    let bounds = noted_bounds(&source, action);
    let parts = Parts { request, recipe, place, scales, imported, action, frameskip, set, bounds };
    let loaded = match parts.recipe.name {
        "tdmpc2" => {
            let agent = parts.agent(&path, &mut description)?;
            // An agent takes all tensors of a file.
            let stored = found.map_or(0, |found| weights::to_ours(found.tensors).len());
            description.tensors = [stored, stored];
            agent
        }
        _ => parts.model(&path, &mut description)?,
    };
    Ok((description, Some(loaded)))
}

/// The tensors of a file, without their values.
fn shapes_in(path: &Path) -> Result<Contents, BaselineError> {
    Ok(swm_weights::contents(path, Of::Shapes)?)
}

/// Settings of the model that were given; where its settings have no `model.` before them, that is left out.
fn set_of(request: &Import, source: &Source) -> Json {
    let mut set = json!({});
    if let Some(noted) = source.notes.as_ref().and_then(|notes| notes.get("set")) {
        lay_over(&mut set, noted);
    }
    for (place, value) in &request.set {
        lay_over(&mut set, &nested(place, value.clone()));
    }
    set
}

fn recipe(
    request: &Import,
    source: &Source,
    found: Option<&Contents>,
    set: &Json,
) -> Result<Recipe, TaskError> {
    let shapes =
        found.map_or_else(Shapes::default, |found| Shapes::of(weights::to_ours(found.tensors.clone())));
    if let Some(found) = found {
        tokens::check_names(&Shapes::of(found.tensors.clone()))?;
        tokens::check_names(&shapes)?;
    }
    let encoder = request.encoder.as_deref().map(shapes_in).transpose()?;
    let encoder = encoder.map_or_else(Shapes::default, |found| Shapes::of(weights::to_ours(found.tensors)));
    let config = source.config.as_ref().map(|config| Node::root(&config.name, &config.value)).transpose()?;
    let model = config.as_ref().map(Node::model).transpose()?.flatten();
    let is_archive = config.as_ref().is_some_and(|config| config.get("num_hist").is_some());
    let noted = |name: &str| source.notes.as_ref().and_then(|notes| notes.get(name));
    let image = request.image.or_else(|| Some(noted("image")?.as_u64()? as usize));
    let in_parts = found.is_some_and(|found| weights::is_archive(found.tensors.keys()));
    let folder = source.folder.as_deref();
    let given = Given { config, shapes, is_archive: in_parts, encoder, folder, set, image };
    let kind = request.kind.as_deref().or_else(|| {
        let kind = noted("kind")?.as_str()?;
        KNOWN.contains(&kind).then_some(kind)
    });
    if let (Some(model), Some(kind)) = (model, kind)
        && !model.is_of(kind)
    {
        let reason = format!("is another model than its config.json names, which is {}", model.names());
        let fix = match KNOWN.contains(&model.names()) {
            true => Fix::set("kind", model.names()),
            false => Fix::Leave("kind"),
        };
        return Err(Message::about("kind", kind, reason).fix(fix).into());
    }
    match (model, kind) {
        (_, Some("lewm")) | (Some(Model::Lewm), None) => joint::recipe(&given, "lewm"),
        (_, Some("pldm")) | (Some(Model::Pldm), None) => joint::recipe(&given, "pldm"),
        (_, Some("dino-wm")) | (Some(Model::DinoWm), None) => tokens::dino_wm(&given),
        (None, None) if is_archive => tokens::dino_wm(&given),
        (_, Some("gcbc")) => tokens::goal(&given, Some("gcbc")),
        (_, Some("gciql")) => tokens::goal(&given, Some("gciql")),
        (_, Some("gcivl")) => tokens::goal(&given, Some("gcivl")),
        (_, Some("hilp")) => tokens::goal(&given, Some("hilp")),
        (Some(Model::Goal), None) => tokens::goal(&given, None),
        (_, Some("tdmpc2")) | (Some(Model::Tdmpc2), None) => {
            tdmpc2::recipe(&given, found.iter().flat_map(|found| found.tensors.keys()))
        }
        (None, _) => Err(unnamed(&given, source)),
        (Some(_), Some(kind)) => {
            Err(Message::about("kind", kind, "is no model that this program has").into())
        }
    }
}

/// Parts of the names that trainers give, and which models these are. Policies have the name of their encoder's model before their own.
const NAMES: [(&str, &str); 9] = [
    ("gciql", "gciql"),
    ("gcivl", "gcivl"),
    ("hilp", "hilp"),
    ("gcbc", "gcbc"),
    ("lewm", "lewm"),
    ("pldm", "pldm"),
    ("tdmpc2", "tdmpc2"),
    ("dinowm", "dino-wm"),
    ("prejepa", "dino-wm"),
];

/// Names of tensors that one model has, and which that is.
const PARTS: [(&str, &str); 6] = [
    ("predictor.transformer.layers.0.0.", "dino-wm"),
    ("value_predictor.student.embed_proj.", "hilp"),
    ("critic_predictor.", "gciql"),
    ("value_predictor.", "gcivl"),
    ("action_predictor.", "gcbc"),
    ("dynamics.", "tdmpc2"),
];

/// The model that tensors are most likely those of.
fn by_shapes(shapes: &Shapes) -> Option<&'static str> {
    PARTS.iter().find(|(part, _)| shapes.has_below(part)).map(|(_, kind)| *kind)
}

/// Where no file says what a checkpoint is.
fn unnamed(given: &Given<'_>, source: &Source) -> TaskError {
    let training = given.config.as_ref().and_then(|config| config.text("output_model_name").ok()?);
    let (text, kind) = match (&source.config, training) {
        (Some(config), Some(name)) => {
            let kind = NAMES.iter().find(|(part, _)| name.contains(part)).map(|(_, kind)| *kind);
            let kind = kind.or_else(|| by_shapes(&given.shapes));
            (format!("{} is a training config ({name}), not a model's", config.name), kind)
        }
        (Some(config), None) => {
            let text = format!("{}: has no _target_, which would say what model it is", config.name);
            (text, by_shapes(&given.shapes).or(Some("lewm")))
        }
        (None, _) => {
            let folder = source.folder.as_ref().map_or(String::new(), |folder| folder.display().to_string());
            let text = format!(
                "{folder} has no config.json; name what it is and, where sizes differ from the paper's, settings of the model"
            );
            (text, by_shapes(&given.shapes).or(Some("lewm")))
        }
    };
    let any = || Fix::Any(KNOWN.iter().map(|kind| Fix::set("kind", *kind)).collect());
    Message::new(text).fix(kind.map_or_else(any, |kind| Fix::set("kind", kind))).into()
}

/// What is known before the weights are read.
fn describe(recipe: &Recipe, source: &Source, found: Option<&Contents>) -> Result<Description, TaskError> {
    let hash = |path: &Path| {
        let hash = File::open(path).and_then(sha256_of);
        hash.map_err(|error| TaskError::from(Message::new(format!("{}: {error}", path.display()))))
    };
    let sha256 = source.weights.as_deref().map(hash).transpose()?;
    let known =
        sha256.as_deref().and_then(|hash| PUBLISHED.iter().find(|(start, _)| hash.starts_with(start)));
    let file = source.weights.as_ref().map_or(String::new(), |path| path.display().to_string());
    let calls = found.iter().flat_map(|found| &found.calls).map(|name| {
        let name =
            name.strip_prefix("builtins.").or_else(|| name.strip_prefix("__builtin__.")).unwrap_or(name);
        format!("{file} would call {name} if Python loaded it; ignored here. Do not load it with torch.load")
    });
    let objects = found.iter().flat_map(|found| &found.passed_over);
    let objects = objects.map(|class| format!("{file}: the tensors of its {class} were passed over"));
    let averaged = found.and_then(|found| weights::averaged(found.tensors.keys()));
    let averaged = averaged.map(|name| {
        format!("{file}: the averaged copy of the weights ({name}, …) was passed over, and the model's own are read")
    });
    Ok(Description {
        model: recipe.name.to_owned(),
        format: found.map_or("", |found| found.format).to_owned(),
        names: found.map_or("", generation).to_owned(),
        image: recipe.image,
        block: recipe.block,
        history: recipe.history,
        known: known.map(|(_, known)| (*known).to_owned()),
        sha256,
        ignored: calls.chain(objects).chain(averaged).collect(),
        settings: recipe.settings.clone(),
        ..Description::default()
    })
}

/// Whose names the tensors of a vision transformer have.
fn generation(found: &Contents) -> &'static str {
    let any = |part: &str| found.tensors.keys().any(|name| name.contains(part));
    match () {
        () if any(".attention.attention.query.") => "transformers 4",
        () if any(".attention.q_proj.") => "transformers 5",
        () if any("blocks.0.attn.qkv.") => "facebookresearch/dinov2",
        () => "PyTorch",
    }
}

/// Settings of a model, whole.
fn settings(recipe: &Recipe, frameskip: usize, set: &Json) -> Json {
    let mut settings = recipe.settings.clone();
    if let Some(place) = recipe.frameskip_at {
        lay_over(&mut settings, &nested(place, frameskip.into()));
    }
    // Settings of some models have no `model.` before them.
    let set = match (settings.get("model"), set.get("model")) {
        (None, Some(inner)) => inner,
        _ => set,
    };
    lay_over(&mut settings, set);
    settings
}

/// How many tensors a model has.
fn tensors(recipe: &Recipe, action_dim: usize, frameskip: usize, set: &Json) -> Result<usize, TaskError> {
    if recipe.name == "tdmpc2" {
        return Ok(0);
    }
    let dims = DataDims { action_dim, proprio_dim: recipe.vector };
    let options =
        MakeOptions { changes: settings(recipe, frameskip, set), ..MakeOptions::new("paper", dims) };
    Ok(make(recipe.name, &options)?.tensors().len())
}

/// All that a run is made of.
struct Parts<'a> {
    request: &'a Import,
    recipe: Recipe,
    place: Place,
    scales: Scales,
    imported: Imported,
    /// Values of an action.
    action: usize,
    frameskip: Option<usize>,
    set: Json,
    /// Lower and upper bounds of actions; `None`: -1 and 1.
    bounds: Option<[Vec<f64>; 2]>,
}

impl Parts<'_> {
    fn model(self, path: &Path, description: &mut Description) -> Result<Loaded, TaskError> {
        let Self { request, recipe, place, scales, mut imported, action, frameskip, set, .. } = self;
        let dims = DataDims { action_dim: action, proprio_dim: recipe.vector };
        let changes = settings(&recipe, frameskip.unwrap_or(1), &set);
        let options = MakeOptions { changes, ..MakeOptions::new("paper", dims) };
        let mut baseline = make(recipe.name, &options)?;
        let encoder = request.encoder.as_deref().filter(|_| recipe.without_encoder);
        let lacks = baseline.load_for_use(path, encoder)?;
        let all = baseline.tensors().len();
        description.tensors = [all - lacks.len(), all];
        imported.lacks = lacks;
        description.lacks.clone_from(&imported.lacks);
        description.settings = baseline.model_config().settings.clone();
        let dataset = scales.dataset.as_ref();
        let path = request.dataset.clone().unwrap_or_default();
        let of = scales.of.into_iter().map(|(name, (scale, _))| (name, scale)).collect();
        let mut data = DataConfig::new(path, recipe.image, action, of);
        data.opening.clone_from(&request.opening);
        (data.env, data.env_settings, data.frame_skip) = (place.env, place.env_settings, place.frame_skip);
        data.episodes = dataset.map_or(0, |dataset| dataset.episodes);
        data.rows = dataset.map_or(0, |dataset| dataset.rows);
        data.split = Split { train: 1.0, ..Split::default() };
        let mut config = RunConfig::new(baseline.model_config().clone(), data);
        config.imported = Some(imported.clone());
        Ok(Loaded::Model(Box::new(TrainedModel::new(baseline, config, 0, imported.sha256))))
    }

    fn agent(self, path: &Path, description: &mut Description) -> Result<Loaded, TaskError> {
        let Self { request, recipe, place, scales, imported, action, set, bounds, .. } = self;
        let env = place.env.clone().unwrap_or_default();
        let has_vector = recipe.vector > 0;
        let image = (recipe.image > 0).then_some(recipe.image);
        let made = agent_of("tdmpc2", &env, &settings(&recipe, 1, &set))?;
        let config = AgentConfig {
            agent: "tdmpc2".to_owned(),
            preset: "paper".to_owned(),
            settings: made,
            observation_dim: recipe.vector,
            image,
            action_dim: action,
            seed: 0,
        };
        let mut agent = restore_agent(&config, &Map::new(), swm_baselines::Device::Cpu)?;
        agent.load_weights(path)?;
        description.settings = config.settings.clone();
        let scale = scales.of.get(&recipe.column).map(|(scale, _)| scale.clone());
        let bounds = bounds.unwrap_or_else(|| [vec![-1.0; action], vec![1.0; action]]);
        let columns = has_vector.then(|| recipe.column.clone()).into_iter().collect();
        let mut interface = Interface::of_vectors(columns, recipe.vector, bounds);
        (interface.image, interface.scale) = (image, scale);
        let data = request.dataset.as_ref().zip(scales.dataset.as_ref()).map(|(path, known)| {
            let mut data = LearnedData::new(path.clone(), known.episodes, known.rows);
            data.opening.clone_from(&request.opening);
            data.frame_skip = known.frame_skip;
            data
        });
        let mut config = OnlineConfig::new(config, env, interface);
        config.env_settings = place.env_settings.unwrap_or_default();
        (config.data, config.imported) = (data, Some(imported));
        Ok(Loaded::Agent { agent, config: Box::new(config) })
    }
}
