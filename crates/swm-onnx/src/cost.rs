//! An exported model as the cost of plans.

use std::path::Path;

use ort::session::{Session, SessionInputValue};
use ort::value::{DynValue, Outlet, Tensor, TensorElementType, ValueType};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::{Row, Slice};
use swm_solvers::{ActionScale, Candidates, Cost, Outputs, PlanError, PlanningContext};

use crate::error::OnnxError;
use crate::history;
use crate::output::{Output, refuse_nan};
use crate::runtime::session;
use crate::weights::check_weights;

/// Settings in `model.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ModelSettings {
    /// The model's name, for reports.
    pub name: String,
    /// k: consecutive actions of a block; D = k × A.
    pub action_block: usize,
    /// The units of the actions that it was trained with; without it, the environment's.
    #[serde(default)]
    pub action_scale: Option<ActionScale>,
    /// Side of the images that it was trained with.
    #[serde(default)]
    pub image: Option<usize>,
    /// T: frames that the encoder is given of each of `history_fields`, `action_block` steps apart, the present one last; 0 and 1: the
    /// present alone.
    #[serde(default)]
    pub history: usize,
    /// The columns that it is given as `[1, T, …]`. The blocks between the frames are the input `action_history` `[1, T - 1, D]`.
    #[serde(default)]
    pub history_fields: Vec<String>,
}

impl ModelSettings {
    /// Those of the model in a folder.
    ///
    /// # Errors
    ///
    /// [`OnnxError::Model`]: there is no `model.json`, or it is no such description.
    pub fn read(folder: &Path) -> Result<Self, OnnxError> {
        let path = folder.join("model.json");
        let text = std::fs::read(&path).map_err(|error| OnnxError::unreadable(&path, &error))?;
        serde_json::from_slice(&text).map_err(|error| OnnxError::unreadable(&path, &error))
    }
}

/// Plans on an exported model.
pub struct OnnxCost {
    settings: ModelSettings,
    encode: Session,
    fields: Vec<Input>,
    cost: Model,
    gradient: Option<Model>,
    /// The encoded tensors of each environment.
    encoded: Vec<Vec<(String, DynValue)>>,
}

/// An input of the encoder.
struct Input {
    name: String,
    shape: Vec<i64>,
    kind: TensorElementType,
}

/// `cost.onnx` or `cost_grad.onnx`.
struct Model {
    session: Session,
    /// S, H, D.
    shape: [usize; 3],
    cost: Output,
    gradient: Option<Output>,
    actions: Vec<f32>,
}

/// S of a model that leaves it open. Fixed, so that the bits of a cost do not depend on how many candidates there are.
const OPEN_SAMPLES: usize = 128;

const ACTIONS: &str = "actions";
const COST: &str = "cost";
const GRADIENT: &str = "gradient";

impl OnnxCost {
    /// Loads the model in a folder.
    ///
    /// # Errors
    ///
    /// [`OnnxError::NoRuntime`]: ONNX Runtime is not there; [`OnnxError::Model`]: a file of the model is missing, or
    /// its inputs and outputs differ from the description.
    pub fn load(folder: &Path) -> Result<Self, OnnxError> {
        let settings = ModelSettings::read(folder)?;
        let path = folder.join("encode.onnx");
        let encode = session(&path)?;
        check_weights(&path)?;
        let wrong = |reason: String| OnnxError::Model { path: path.clone(), reason };
        let fields = encode.inputs().iter().map(|input| match input.dtype() {
            ValueType::Tensor { ty, shape, .. } if shape.first() == Some(&1) => {
                Ok(Input { name: input.name().to_owned(), shape: shape.to_vec(), kind: *ty })
            }
            _ => Err(wrong(format!(
                "input `{}` is no tensor [1, …]; export it for one environment",
                input.name()
            ))),
        });
        let fields = fields.collect::<Result<_, _>>()?;
        let encoded: Vec<&str> = encode.outputs().iter().map(Outlet::name).collect();
        let cost = Model::load(&folder.join("cost.onnx"), &encoded, false)?;
        let path = folder.join("cost_grad.onnx");
        let gradient = path.exists().then(|| Model::load(&path, &encoded, true)).transpose()?;
        Ok(Self { settings, encode, fields, cost, gradient, encoded: Vec::new() })
    }

    /// The settings in `model.json`.
    pub fn settings(&self) -> &ModelSettings {
        &self.settings
    }
}

impl Model {
    /// Loads a model that takes tensors of the encoder, whose outputs are `encoded`.
    fn load(path: &Path, encoded: &[&str], with_gradient: bool) -> Result<Self, OnnxError> {
        let wrong = |reason: String| OnnxError::Model { path: path.to_owned(), reason };
        let session = session(path)?;
        check_weights(path)?;
        let actions = session.inputs().iter().find(|input| input.name() == ACTIONS);
        let shape = match actions.map(Outlet::dtype) {
            Some(ValueType::Tensor { ty: TensorElementType::Float32, shape, .. }) => shape.to_vec(),
            _ => return Err(wrong(format!("it has no input `{ACTIONS}` [S, H, D] of 32-bit floats"))),
        };
        let fixed = |size: i64| usize::try_from(size).ok().filter(|&size| size > 0);
        let shape = match shape[..] {
            [samples, horizon, dim] if samples == -1 || fixed(samples).is_some() => fixed(horizon)
                .zip(fixed(dim))
                .map(|(horizon, dim)| [fixed(samples).unwrap_or(OPEN_SAMPLES), horizon, dim]),
            _ => None,
        }
        .ok_or_else(|| {
            wrong(format!("input `{ACTIONS}` is {shape:?}; export it as [S, H, D] with fixed H and D"))
        })?;
        let mut others = session.inputs().iter().map(Outlet::name).filter(|&name| name != ACTIONS);
        if let Some(unknown) = others.find(|name| !encoded.contains(name)) {
            return Err(wrong(format!(
                "its input `{unknown}` is no output of encode.onnx, which are `{}`",
                encoded.join("`, `")
            )));
        }
        let [samples, horizon, dim] = shape;
        let cost = Output::find(&session, COST, &[samples]).map_err(wrong)?;
        let gradient = with_gradient.then(|| Output::find(&session, GRADIENT, &[samples, horizon, dim]));
        let gradient = gradient.transpose().map_err(wrong)?;
        Ok(Self { session, shape, cost, gradient, actions: Vec::new() })
    }

    /// Fills `costs` `[n]`, and `gradient` `[n, H, D]`, of `plans` `[n, H, D]` for one environment.
    fn run(
        &mut self,
        encoded: &[(String, DynValue)],
        plans: &[f32],
        costs: &mut [f64],
        mut gradient: Option<&mut [f32]>,
    ) -> Result<(), OnnxError> {
        let Self { session, shape: [samples, horizon, dim], actions, cost, gradient: slopes } = self;
        let size = *horizon * *dim;
        for (part, (plans, costs)) in
            plans.chunks(*samples * size).zip(costs.chunks_mut(*samples)).enumerate()
        {
            actions.clear();
            actions.extend_from_slice(plans);
            actions.resize(*samples * size, 0.0);
            let shape = [*samples, *horizon, *dim];
            let tensor = Tensor::from_array((shape, actions.clone())).map_err(OnnxError::Run)?;
            let mut inputs: Vec<(&str, SessionInputValue<'_>)> =
                encoded.iter().map(|(name, value)| (name.as_str(), value.into())).collect();
            // Tensors of the encoder that this model does not take are left out.
            let taken = session.inputs().iter().map(|input| input.name().to_owned()).collect::<Vec<_>>();
            inputs.retain(|(name, _)| taken.iter().any(|known| known == name));
            inputs.push((ACTIONS, tensor.into()));
            let outputs = session.run(inputs).map_err(OnnxError::Run)?;
            cost.read(&outputs, |index, value| {
                costs.get_mut(index).into_iter().for_each(|cost| *cost = value);
            })?;
            if let (Some(gradient), Some(slopes)) = (gradient.as_deref_mut(), &slopes) {
                let out = &mut gradient[part * *samples * size..][..plans.len()];
                slopes.read(&outputs, |index, value| {
                    out.get_mut(index).into_iter().for_each(|out| *out = value as f32);
                })?;
            }
        }
        Ok(())
    }

    fn check(&self, candidates: &Candidates<'_>) -> Result<(), OnnxError> {
        let [_, horizon, dim] = self.shape;
        let fix = match (candidates.horizon == horizon, candidates.dim == dim) {
            (true, true) => return Ok(()),
            (false, true) => format!("set horizon={horizon}"),
            (_, false) => "take a model of this environment, or fix `action_block` of model.json".to_owned(),
        };
        let reason = format!(
            "plans are {} blocks of {} values, and the model was exported for {horizon} of {dim}; {fix}",
            candidates.horizon, candidates.dim
        );
        Err(OnnxError::Input { name: ACTIONS.to_owned(), reason })
    }
}

impl Input {
    /// The field of an environment as an input tensor.
    fn tensor(&self, row: Row<'_>) -> Result<DynValue, OnnxError> {
        let wrong = |reason: String| OnnxError::Input { name: self.name.clone(), reason };
        let index = row.schema().index(&self.name).ok_or_else(|| {
            wrong(
                "the environment has no such field; images need `image_size`, or a manifest with one"
                    .to_owned(),
            )
        })?;
        let (values, shape) = (row.at(index), &row.schema().fields()[index].shape);
        let wanted: Vec<usize> =
            self.shape[1..].iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect();
        if wanted != *shape {
            return Err(wrong(format!(
                "the environment gives {shape:?}, the model was exported for {wanted:?}; take a model of this environment{}",
                match shape.len() {
                    3 =>
                        ", or let `image_size` (of the manifest, where there is one) render images in its size",
                    _ => "",
                }
            )));
        }
        let shape = self.shape.clone();
        let made = match (self.kind, values) {
            (TensorElementType::Uint8, Slice::U8(values)) => {
                Tensor::from_array((shape, values.to_vec())).map(Tensor::into_dyn)
            }
            (TensorElementType::Float32, values) => {
                let values: Vec<f32> =
                    (0..values.len()).map(|at| values.as_f64(at).unwrap_or(f64::NAN) as f32).collect();
                Tensor::from_array((shape, values)).map(Tensor::into_dyn)
            }
            (kind, values) => {
                return Err(wrong(format!(
                    "{} is given as {kind:?}; export images as uint8 and vectors as float32",
                    values.dtype()
                )));
            }
        };
        made.map_err(OnnxError::Run)
    }
}

impl Cost for OnnxCost {
    fn prepare(&mut self, context: &PlanningContext<'_>) -> Result<(), PlanError> {
        self.encoded.clear();
        for index in 0..context.len() {
            let row = context.env(index).row;
            let input = |field: &Input| match self.settings.part(&field.name) {
                None => field.tensor(row),
                Some(part) => {
                    let Input { name, shape, kind } = field;
                    history::tensor(
                        &self.settings,
                        part,
                        context,
                        index,
                        (name.as_str(), shape.as_slice(), *kind),
                    )
                }
            };
            let inputs = self.fields.iter().map(|field| Ok((field.name.as_str(), input(field)?.into())));
            let inputs: Vec<(&str, SessionInputValue<'_>)> = inputs.collect::<Result<_, OnnxError>>()?;
            let outputs = self.encode.run(inputs).map_err(OnnxError::Run)?;
            let outputs: Vec<_> = outputs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
            // Reductions of ONNX Runtime lose a NaN that is not in the first place: costs may hide it.
            outputs.iter().try_for_each(|(name, value)| refuse_nan(name, value))?;
            self.encoded.push(outputs);
        }
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        let model = match (&gradient, &mut self.gradient) {
            (Some(_), Some(model)) => model,
            _ => &mut self.cost,
        };
        model.check(candidates)?;
        let size = candidates.samples * candidates.horizon * candidates.dim;
        for (row, encoded) in self.encoded.iter().enumerate() {
            let plans = &candidates.actions[row * size..][..size];
            let costs = &mut costs[row * candidates.samples..][..candidates.samples];
            let gradient = gradient.as_deref_mut().map(|all| &mut all[row * size..][..size]);
            model.run(encoded, plans, costs, gradient)?;
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        self.gradient.is_some()
    }

    fn history_fields(&self) -> Vec<String> {
        self.settings.history_fields.clone()
    }

    fn changed_settings(&self) -> Map<String, Json> {
        Map::from_iter([("model".to_owned(), self.settings.name.clone().into())])
    }
}
