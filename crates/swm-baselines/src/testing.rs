//! Values of networks that are not seen at the boundary, for tests of other crates.

use std::path::Path;

use burn::tensor::{Device as TensorDevice, Tensor, TensorData};
use swm_nn::params::host;

use crate::data::{Images, Normalization, Vectors};
use crate::error::BaselineError;
use crate::images::to_tensor;
use crate::online::AgentConfig;
use crate::online::tdmpc2::{Observed, Tdmpc2Config, Tdmpc2Network};
use crate::weights::load_network;

/// Latents of a TD-MPC2 of this config and these weights, `[N, D]` for N observations; and the returns of candidates, `[C]` for their
/// actions `[C, H, A]`, from the first observation.
///
/// # Errors
///
/// The weights are not those of the config, or the images not of a size that it takes.
///
/// # Panics
///
/// The config is none of TD-MPC2's, or shapes do not fit together.
pub fn tdmpc2_values(
    config: &AgentConfig,
    weights: &Path,
    pixels: Option<&Images<'_>>,
    vector: Vectors<'_>,
    (candidates, shape): (&[f32], [usize; 3]),
) -> Result<(Vec<f32>, Vec<f32>), BaselineError> {
    let device = TensorDevice::flex();
    let settings: Tdmpc2Config =
        serde_json::from_value(config.settings.clone()).expect("settings of TD-MPC2");
    let network = load_network(&Tdmpc2Network::new(config, &settings, &device), weights)?;
    let images = config.image.zip(pixels).map(|(side, pixels)| {
        let tensor = to_tensor("pixels", pixels, (side, Normalization::Imagenet), &device)?;
        Ok::<_, BaselineError>(tensor.reshape([pixels.rows, 3, side, side]))
    });
    let data = TensorData::new(vector.values.to_vec(), [vector.rows, vector.dim]);
    let vector = Some(Tensor::from_data(data, &device));
    let latents = network.encode(Observed { images: images.transpose()?, vector });
    let plans = Tensor::<3>::from_data(TensorData::new(candidates.to_vec(), shape), &device);
    let first = latents.clone().narrow(0, 0, 1).repeat_dim(0, shape[0]);
    let discount = settings.discount.expect("a checkpoint's discount is known");
    let returns = network.returns(first, &plans, discount, settings.plan.uncertainty_penalty);
    Ok((host(latents), host(returns)))
}
