//! How a latent changes in a step: an MLP over the latent, what was done last and what is done now.

use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use swm_core::moments::{Moments, of_rows};

use super::linear::{Linear, parameter};
use crate::params;

/// What is added to a std before anything is divided by it: for values that hardly vary, in units of latents.
const LEAST_STD: f64 = 0.02;
/// The same of the std of changes.
const LEAST_CHANGE: f64 = 1e-4;

/// Statistics of latents, found once, in the first batch of a training, and stored with the weights.
#[derive(Module, Debug)]
struct LatentScale {
    /// `[Z]`.
    mean: Param<Tensor<1>>,
    /// `[Z]`.
    std: Param<Tensor<1>>,
    /// `[Z]`: the std of what changes from a step to the next.
    change: Param<Tensor<1>>,
}

/// The sizes of a [`LatentChange`].
#[derive(Clone, Copy, Debug)]
pub struct LatentChangeSizes {
    /// Z.
    pub latent: usize,
    /// D: values of an action.
    pub action: usize,
    /// Whether the last change is seen, too.
    pub velocity: bool,
    /// Values of a hidden layer.
    pub hidden: usize,
    /// Hidden layers.
    pub depth: usize,
}

/// The latent and a change, whose values have the std of the data's where the last layer gives 1.
#[derive(Module, Debug)]
pub struct LatentChange {
    scale: LatentScale,
    layers: Vec<Linear>,
    output: Linear,
}

impl LatentChange {
    /// With fresh weights.
    pub fn new(sizes: LatentChangeSizes, device: &Device) -> Self {
        let LatentChangeSizes { latent, action, velocity, hidden, depth } = sizes;
        let seen = latent + 2 * action + if velocity { latent } else { 0 };
        let inputs = |layer| if layer == 0 { seen } else { hidden };
        Self {
            scale: LatentScale {
                mean: parameter([latent], device),
                std: parameter([latent], device),
                change: parameter([latent], device),
            },
            layers: (0..depth).map(|layer| Linear::new(inputs(layer), hidden, device)).collect(),
            output: Linear::new(inputs(depth), latent, device),
        }
    }

    /// Latents `[N, Z]`, the actions before them and those after them `[N, D]`, and, of a network that sees it, how they have changed
    /// last `[N, Z]` → the next latents, `[N, Z]`.
    pub fn forward(
        &self,
        latents: Tensor<2>,
        before: Tensor<2>,
        after: Tensor<2>,
        changed: Option<Tensor<2>>,
    ) -> Tensor<2> {
        let LatentScale { mean, std, change } = &self.scale;
        let row = |values: &Param<Tensor<1>>| values.val().unsqueeze::<2>();
        let scaled = (latents.clone() - row(mean)) / row(std);
        let changed = changed.map(|changed| changed / row(change));
        let first = Tensor::cat([scaled, after, before].into_iter().chain(changed).collect(), 1);
        let hidden = self.layers.iter().fold(first, |hidden, layer| layer.forward_gelu(hidden));
        latents + self.output.forward(hidden) * row(change)
    }

    /// `[1]`: the mean square of changes in the data, which makes errors shares of what there is to explain.
    pub fn mean_square_change(&self) -> Tensor<1> {
        self.scale.change.val().square().mean()
    }

    /// A network with the statistics of these latents, `[B, T, Z]`.
    pub fn find<M: Module>(network: M, latents: &Tensor<3>) -> M {
        let [_, steps, dim] = latents.dims();
        let columns = |rows: Tensor<3>| {
            let values: Vec<f64> = params::host(rows).into_iter().map(f64::from).collect();
            of_rows(&values, dim)
        };
        let before = latents.clone().narrow(1, 0, steps - 1);
        let changes = columns(latents.clone().narrow(1, 1, steps - 1) - before);
        let all = columns(latents.clone());
        let stds = |columns: &[Moments], least: f64| -> Vec<f32> {
            columns.iter().map(|column| (column.std() + least) as f32).collect()
        };
        let mean: Vec<f32> = all.iter().map(|column| column.mean() as f32).collect();
        let (std, change) = (stds(&all, LEAST_STD), stds(&changes, LEAST_CHANGE));
        params::map(network, |spec, tensor| {
            let found = match (spec.place.0, spec.place.1.as_str()) {
                ("LatentScale", "mean") => &mean,
                ("LatentScale", "std") => &std,
                ("LatentScale", _) => &change,
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

    const SIZES: LatentChangeSizes =
        LatentChangeSizes { latent: 2, action: 1, velocity: false, hidden: 3, depth: 2 };

    #[test]
    fn statistics_are_those_of_the_first_batch() {
        let device = Device::flex();
        // Two clips of two steps: values 0, 2 and 4, 6 (a change of 2 both times); 1, 1 and 1, 5 (0 and 4).
        let latents = TensorData::new(vec![0.0f32, 1.0, 2.0, 1.0, 4.0, 1.0, 6.0, 5.0], [2, 2, 2]);
        let network = initialize(LatentChange::new(SIZES, &device), 1);
        let found = LatentChange::find(network, &Tensor::from_data(latents, &device));
        let near = |values: &Param<Tensor<1>>, wanted: [f64; 2]| {
            let found = host(values.val());
            let apart = |(found, wanted): (&f32, f64)| (f64::from(*found) - wanted).abs();
            assert!(found.iter().zip(wanted).map(apart).all(|apart| apart < 1e-5), "{found:?}");
        };
        near(&found.scale.mean, [3.0, 2.0]);
        near(&found.scale.std, [5.0f64.sqrt() + 0.02, 3.0f64.sqrt() + 0.02]);
        near(&found.scale.change, [1e-4, 2.0 + 1e-4]);
        let square = f64::from(host(found.mean_square_change())[0]);
        assert!((square - (1e-8 + 2.0001f64.powi(2)) / 2.0).abs() < 1e-5, "{square}");
    }

    #[test]
    fn a_network_of_zeros_predicts_no_change_and_its_bias_one_of_the_data() {
        let device = Device::flex();
        let mut network = initialize(LatentChange::new(SIZES, &device), 1);
        network.scale.change = Param::from_tensor(Tensor::from_floats([0.5, 3.0], &device));
        let zeros = |spec: &params::Spec, tensor: Tensor<1>| match spec.name.as_str() {
            "output.weight" => tensor.zeros_like(),
            "output.bias" => tensor.ones_like(),
            _ => tensor,
        };
        let network = params::map(network, zeros);
        let latents = Tensor::<2>::from_floats([[1.0, -1.0]], &device);
        let action = Tensor::<2>::from_floats([[0.3]], &device);
        let next = host(network.forward(latents, action.clone(), action, None));
        assert!((next[0] - 1.5).abs() < 1e-6 && (next[1] - 2.0).abs() < 1e-6, "{next:?}");
    }
}
