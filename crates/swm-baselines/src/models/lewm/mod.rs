//! LeWM: a joint-embedding world model that a test of normality keeps from collapsing (arXiv 2603.19312).
//!
//! Loss: squared error of the predicted states, plus SIGReg of the encoded ones. No target network, no stop-gradient.

use burn::module::Module;
use burn::tensor::Device;
use serde::{Deserialize, Serialize};

use crate::baseline::{Phase, PlanModel};
use crate::data::{DataDims, Inputs};
use crate::error::BaselineError;
use crate::losses::{SigregConfig, Terms, mean_squared_error, sigreg};
use crate::models::joint::{Joint, JointConfig, JointPlanner, Predicted};
use crate::network::{Network, Parts};
use crate::optim::OptimConfig;
use crate::pass::Pass;

/// Its name.
pub(crate) const NAME: &str = "lewm";

/// Its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LewmConfig {
    /// The network.
    pub model: JointConfig,
    /// What keeps states apart.
    pub sigreg: SigregConfig,
    /// The optimizer.
    pub optim: OptimConfig,
}

impl LewmConfig {
    /// The paper's settings, with the weight of SIGReg as the reference sets it.
    pub fn paper() -> Self {
        Self { model: JointConfig::paper(), sigreg: SigregConfig::default(), optim: OptimConfig::default() }
    }

    /// Settings for a CPU.
    pub fn small() -> Self {
        Self {
            model: JointConfig::small(),
            sigreg: SigregConfig { projections: 256, ..SigregConfig::default() },
            optim: OptimConfig { lr: 1e-3, ..OptimConfig::default() },
        }
    }
}

#[derive(Module, Debug)]
struct Lewm {
    model: Joint,
    #[module(skip)]
    sigreg: SigregConfig,
}

/// Network and training of these settings.
pub(crate) fn make(
    config: &LewmConfig,
    dims: &DataDims,
    device: &Device,
) -> Result<Parts<impl Network + use<>>, BaselineError> {
    config.sigreg.check().map_err(|reason| BaselineError::Settings { baseline: NAME, reason })?;
    let model = Joint::new(NAME, &config.model, dims, device)?;
    let phase = Phase {
        name: "train",
        optim: config.optim.clone(),
        goals: None,
        trains: &[""],
        targets: &[],
        momentum: 0.0,
    };
    Ok(Parts {
        network: Lewm { model, sigreg: config.sigreg },
        input_spec: config.model.input_spec(),
        form: config.model.form(dims),
        phases: vec![phase],
    })
}

impl Network for Lewm {
    fn loss(&self, _phase: usize, inputs: &Inputs, pass: &mut Pass) -> Result<Terms, BaselineError> {
        let Predicted { states, predicted } = self.model.predict_batch(inputs, pass);
        let targets = states.clone().narrow(1, 1, predicted.dims()[1]);
        let prediction = mean_squared_error(predicted, targets);
        let normality = sigreg(states, &self.sigreg, pass);
        Ok(Terms {
            total: prediction.clone() + normality.clone() * self.sigreg.weight,
            parts: vec![("prediction", prediction), ("sigreg", normality)],
        })
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        Some(Box::new(JointPlanner::new(self.model.clone())))
    }
}
