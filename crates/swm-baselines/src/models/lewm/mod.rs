//! LeWM: a joint-embedding world model that a test of normality keeps from collapsing (arXiv 2603.19312).
//!
//! Loss: squared error of the predicted states, plus SIGReg of the encoded ones. No target network, no stop-gradient.
//! Beyond the paper, inverse dynamics, straightening and predictions on end can be added.

use burn::module::Module;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use crate::baseline::{Phase, PlanModel};
use crate::data::{DataDims, Inputs};
use crate::error::BaselineError;
use crate::models::auxiliary::{Auxiliary, AuxiliaryWeights};
use crate::models::joint::{Joint, JointConfig, JointPlanner, Predicted};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::losses::{SigregConfig, Terms, mean_squared_error, sigreg};
use swm_nn::optim::OptimConfig;
use swm_nn::{Drawing, InverseDynamics};

/// Its name.
pub(crate) const NAME: &str = "lewm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct LewmConfig {
    /// The network.
    pub model: JointConfig,
    /// What keeps states apart.
    pub sigreg: SigregConfig,
    /// Hidden dim of the inverse-dynamics MLP.
    #[serde(default = "inverse_hidden")]
    pub inverse_hidden: usize,
    /// How many states are predicted on end for `weights.rollout`.
    #[serde(default = "rollout_steps")]
    pub rollout_steps: usize,
    /// What additional terms are worth, which the paper does not have.
    #[serde(default)]
    pub weights: AuxiliaryWeights,
    /// The optimizer.
    pub optim: OptimConfig,
}

fn inverse_hidden() -> usize {
    512
}

fn rollout_steps() -> usize {
    3
}

impl LewmConfig {
    /// The paper's settings, with the weight of SIGReg as the reference sets it.
    pub fn paper() -> Self {
        Self {
            model: JointConfig::paper(),
            sigreg: SigregConfig::default(),
            inverse_hidden: inverse_hidden(),
            rollout_steps: rollout_steps(),
            weights: AuxiliaryWeights::default(),
            optim: OptimConfig::default(),
        }
    }

    fn auxiliary(&self) -> Auxiliary {
        Auxiliary::new(&self.weights, self.rollout_steps)
    }

    /// Settings for a CPU. SIGReg's statistic grows with the batch: on 64 clips, where the paper has 128, it weighs twice as
    /// much.
    pub fn small() -> Self {
        let sigreg = SigregConfig::default();
        Self {
            model: JointConfig::small(),
            sigreg: SigregConfig { projections: 256, weight: 2.0 * sigreg.weight, ..sigreg },
            optim: OptimConfig { lr: 1e-3, ..OptimConfig::default() },
            ..Self::paper()
        }
    }
}

#[derive(Module, Debug)]
struct Lewm {
    model: Joint,
    /// Only where it has a weight: others' weights have none.
    inverse: Option<InverseDynamics>,
    /// The same.
    drawing: Option<Drawing>,
    #[module(skip)]
    sigreg: SigregConfig,
    #[module(skip)]
    auxiliary: Auxiliary,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &LewmConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    let auxiliary = config.auxiliary();
    let (image, places) = (config.model.image, config.model.encoder.places());
    let checked = config.sigreg.check().and_then(|()| auxiliary.check(places, image));
    checked.map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let model = Joint::new(NAME, &config.model, dims, device)?;
    let form = config.model.form(dims);
    let inverse = auxiliary.inverse(config.model.latent_dim, config.inverse_hidden, form.action, device);
    let drawing = auxiliary.drawing(places, image, device);
    let phase = Phase::only(&config.optim, &[""]);
    Ok(Parts {
        network: Lewm { model, inverse, drawing, sigreg: config.sigreg, auxiliary },
        input_spec: config.model.input_spec(&auxiliary),
        form,
        phases: vec![phase],
    })
}

impl Network for Lewm {
    const DISPENSABLE: &'static [&'static str] = &["idm", "drawing"];

    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Predicted { states, predicted, places } = self.model.predict_batch(inputs, pass);
        let targets = states.clone().narrow(1, 1, predicted.dims()[1]);
        let prediction = mean_squared_error(predicted, targets);
        let normality = sigreg(states.clone(), &self.sigreg, pass);
        let mut terms = Terms { total: prediction.clone(), parts: vec![("prediction", prediction)] };
        terms.add("sigreg", self.sigreg.weight, normality);
        self.auxiliary.add_drawing(&mut terms, self.drawing.as_ref(), inputs, places.as_ref());
        self.auxiliary.add_to(&mut terms, self.inverse.as_ref(), &states, inputs, |first, actions| {
            self.model.roll_out(first, actions, pass)
        });
        Ok(terms)
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(JointPlanner::new(self.model.clone())))
    }
}
