//! PLDM: a joint-embedding world model kept from collapsing by the terms of VICReg (arXiv 2502.14819), in the form that
//! the reference gives it.

use burn::module::Module;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use crate::baseline::{Phase, PlanModel};
use crate::data::{DataDims, Inputs};
use crate::error::BaselineError;
use crate::models::auxiliary::Auxiliary;
use crate::models::joint::{Joint, JointConfig, JointPlanner, Predicted};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::{Terms, Vicreg, mean_squared_error, vicreg};
use swm_nn::optim::OptimConfig;
use swm_nn::{Drawing, InverseDynamics};

/// Its name.
pub(crate) const NAME: &str = "pldm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct PldmConfig {
    /// The network.
    pub model: JointConfig,
    /// Hidden dim of the inverse-dynamics MLP.
    pub inverse_hidden: usize,
    /// How many states are predicted on end for `weights.rollout`.
    #[serde(default = "rollout_steps")]
    pub rollout_steps: usize,
    /// What the terms are worth.
    pub weights: PldmWeights,
    /// The optimizer.
    pub optim: OptimConfig,
}

/// Weights of the regularization terms. A term of weight 0 is not computed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct PldmWeights {
    /// Std over the batch.
    pub std: f64,
    /// Std over time.
    pub std_t: f64,
    /// Covariances over the batch.
    pub cov: f64,
    /// Covariances over time.
    pub cov_t: f64,
    /// Closeness of consecutive states.
    pub alignment: f64,
    /// Inverse dynamics.
    pub inverse: f64,
    /// Straightness of the paths of states.
    pub straightening: f64,
    /// Predictions on end, from the first state of a clip; not in the reference.
    pub rollout: f64,
    /// The share of the variance of images that drawings from their places do not explain; of keypoints only, and not in the
    /// reference.
    pub drawing: f64,
}

fn rollout_steps() -> usize {
    3
}

impl Default for PldmWeights {
    /// The reference's.
    fn default() -> Self {
        Self {
            std: 18.0,
            std_t: 0.7,
            cov: 12.0,
            cov_t: 0.0,
            alignment: 0.2,
            inverse: 0.0,
            straightening: 0.0,
            rollout: 0.0,
            drawing: 0.0,
        }
    }
}

impl PldmConfig {
    /// The reference's settings.
    pub fn paper() -> Self {
        Self {
            model: JointConfig::paper(),
            inverse_hidden: 512,
            rollout_steps: rollout_steps(),
            weights: PldmWeights::default(),
            optim: OptimConfig::default(),
        }
    }

    /// Settings for a CPU.
    pub fn small() -> Self {
        Self {
            model: JointConfig::small(),
            optim: OptimConfig { lr: 1e-3, ..OptimConfig::default() },
            ..Self::paper()
        }
    }

    fn auxiliary(&self) -> Auxiliary {
        let PldmWeights { inverse, straightening, rollout, drawing, .. } = self.weights;
        Auxiliary { inverse, straightening, rollout, rollout_steps: self.rollout_steps, drawing }
    }
}

#[derive(Module, Debug)]
struct Pldm {
    model: Joint,
    inverse: InverseDynamics,
    /// Only where it has a weight: others' weights have none.
    drawing: Option<Drawing>,
    #[module(skip)]
    weights: PldmWeights,
    #[module(skip)]
    auxiliary: Auxiliary,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &PldmConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let auxiliary = config.auxiliary();
    let (image, places) = (config.model.image, config.model.encoder.places());
    auxiliary.check(places, image).map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let model = Joint::new(NAME, &config.model, dims, device)?;
    let form = config.model.form(dims);
    let phase = Phase::only(&config.optim, &[""]);
    let drawing = auxiliary.drawing(places, image, device);
    let inverse = InverseDynamics::new(config.model.latent_dim, config.inverse_hidden, form.action, device);
    Ok(Parts {
        network: Pldm { model, inverse, drawing, weights: config.weights, auxiliary },
        input_spec: config.model.input_spec(&auxiliary),
        form,
        phases: vec![phase],
    })
}

impl Network for Pldm {
    const DISPENSABLE: &'static [&'static str] = &["idm", "drawing"];

    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Predicted { states, predicted, places } = self.model.predict_batch(inputs, pass);
        let seen = predicted.dims()[1];
        let (before, after) = (states.clone().narrow(1, 0, seen), states.clone().narrow(1, 1, seen));
        let prediction = mean_squared_error(predicted, after.clone());
        let mut terms = Terms { total: prediction.clone(), parts: vec![("prediction", prediction)] };
        let mut add = |name, weight: f64, term: &dyn Fn() -> burn::tensor::Tensor<1>| {
            if weight != 0.0 {
                terms.add(name, weight, term());
            }
        };
        let weights = &self.weights;
        let Vicreg { std, std_t, cov, cov_t } = vicreg(states.clone());
        add("std", weights.std, &|| std.clone());
        add("std_t", weights.std_t, &|| std_t.clone());
        add("cov", weights.cov, &|| cov.clone());
        add("cov_t", weights.cov_t, &|| cov_t.clone());
        add("alignment", weights.alignment, &|| mean_squared_error(before.clone(), after.clone()));
        self.auxiliary.add_drawing(&mut terms, self.drawing.as_ref(), inputs, places.as_ref());
        self.auxiliary.add_to(&mut terms, Some(&self.inverse), &states, inputs, |first, actions| {
            self.model.roll_out(first, actions, pass)
        });
        Ok(terms)
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(JointPlanner::new(self.model.clone())))
    }
}
