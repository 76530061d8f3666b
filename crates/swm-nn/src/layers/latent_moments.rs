//! Means and stds of latents, by which they are standardized.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use swm_core::moments::of_rows;

use super::linear::parameter;
use crate::params;

/// What is added to a std before anything is divided by it.
const LEAST_STD: f64 = 1e-3;

/// Statistics of latents, found once, in the first batch of a training, and stored with the weights.
#[derive(Module, Debug)]
pub struct LatentMoments {
    /// `[Z]`.
    mean: Param<Tensor<1>>,
    /// `[Z]`.
    std: Param<Tensor<1>>,
}

impl LatentMoments {
    /// Of latents of `dim` values.
    pub fn new(dim: usize, device: &Device) -> Self {
        Self { mean: parameter([dim], device), std: parameter([dim], device) }
    }

    /// Standardized latents, `[B, T, Z]`.
    pub fn forward(&self, latents: Tensor<3>) -> Tensor<3> {
        let row = |values: &Param<Tensor<1>>| values.val().unsqueeze::<3>();
        (latents - row(&self.mean)) / row(&self.std)
    }

    /// A network with the statistics of these latents, `[B, T, Z]`.
    pub fn find<M: Module>(network: M, latents: &Tensor<3>) -> M {
        let dim = latents.dims()[2];
        let values: Vec<f64> = params::host(latents.clone()).into_iter().map(f64::from).collect();
        let columns = of_rows(&values, dim);
        let mean: Vec<f32> = columns.iter().map(|column| column.mean() as f32).collect();
        let std: Vec<f32> = columns.iter().map(|column| (column.std() + LEAST_STD) as f32).collect();
        params::map(network, |spec, tensor| {
            let found = match (spec.place.0, spec.place.1.as_str()) {
                ("LatentMoments", "mean") => &mean,
                ("LatentMoments", _) => &std,
                _ => return tensor,
            };
            params::from_host(spec, found.clone(), &tensor)
        })
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::init::initialize;
    use crate::params::host;

    #[test]
    fn standardized_latents_have_the_moments_of_a_standard_normal() {
        let device = Device::flex();
        let values = TensorData::new(vec![0.0f32, 5.0, 2.0, 5.0, 4.0, 5.0, 6.0, 5.0], [2, 2, 2]);
        let latents = Tensor::<3>::from_data(values, &device);
        let moments = LatentMoments::find(initialize(LatentMoments::new(2, &device), 1), &latents);
        let found = host(moments.forward(latents));
        let wanted = [-3.0, 0.0, -1.0, 0.0, 1.0, 0.0, 3.0, 0.0].map(|value: f32| value / 5.0_f32.sqrt());
        assert!(found.iter().zip(wanted).all(|(found, wanted)| (found - wanted).abs() < 1e-3), "{found:?}");
    }
}
