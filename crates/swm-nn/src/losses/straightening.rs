//! Temporal straightening: consecutive changes of an embedding shall point the same way (arXiv 2603.12231).

use burn::tensor::Tensor;

/// The least length that a cosine divides by, PyTorch's.
const EPSILON: f32 = 1e-8;

/// Of embeddings `[B, T, W]` with T of 3 or more: the mean of minus the cosine between changes.
pub fn straightening(states: Tensor<3>) -> Tensor<1> {
    let steps = states.dims()[1];
    let changes = states.clone().narrow(1, 1, steps - 1) - states.narrow(1, 0, steps - 1);
    let (before, after) = (changes.clone().narrow(1, 0, steps - 2), changes.narrow(1, 1, steps - 2));
    // Under the root: where nothing changes from frame to frame, the slope of a root of 0 would be infinite.
    let length = |change: &Tensor<3>| change.clone().square().sum_dim(2).clamp_min(EPSILON * EPSILON).sqrt();
    let lengths = length(&before) * length(&after);
    ((before * after).sum_dim(2) / lengths).mean() * -1.0
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};

    use super::*;
    use crate::params::host;

    fn of(path: &[[f32; 2]]) -> f32 {
        let values: Vec<f32> = path.iter().flatten().copied().collect();
        let states = Tensor::from_data(TensorData::new(values, [1, path.len(), 2]), &Device::flex());
        host(straightening(states))[0]
    }

    #[test]
    fn a_path_that_stands_still_has_a_gradient_of_zero() {
        let values = vec![1.0_f32, 2.0, 1.0, 2.0, 1.0, 2.0];
        let states = Tensor::<3>::from_data(TensorData::new(values, [1, 3, 2]), &Device::flex());
        let states = states.autodiff().require_grad();
        let gradients = straightening(states.clone()).backward();
        let gradient = host(states.grad(&gradients).expect("it is tracked"));
        assert_eq!(gradient, [0.0; 6]);
    }

    #[test]
    fn straight_paths_have_the_least_and_turns_cost_their_cosine() {
        // Straight on at any speed; a right angle; there and back; a turn by 60 degrees, then straight on.
        let turn = [0.5, 0.75_f32.sqrt()];
        for (path, wanted) in [
            (&[[0.0, 0.0], [1.0, 0.0], [4.0, 0.0]][..], -1.0),
            (&[[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]], 0.0),
            (&[[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], 1.0),
            (
                &[[0.0, 0.0], [1.0, 0.0], [1.0 + turn[0], turn[1]], [1.0 + 2.0 * turn[0], 2.0 * turn[1]]],
                -0.75,
            ),
        ] {
            let found = of(path);
            assert!((found - wanted).abs() < 1e-6, "{path:?}: {found} is not {wanted}");
        }
    }
}
