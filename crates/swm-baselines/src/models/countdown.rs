//! The loss of policies that know how many decisions are left: they imitate how each frame of a clip was reached from those before it.

use burn::tensor::Tensor;

use swm_nn::losses::{Terms, mean_squared_error};
use swm_nn::{CountdownPredictor, Looks};

/// The squared error of actions `[B, K + 1, D]` at each frame of clips for each later frame as the goal: its mean over clips, then over
/// the pairs of equally many decisions, then over their number.
pub(crate) fn imitation(policy: &CountdownPredictor, looks: Looks, taken: &Tensor<3>) -> Terms {
    let Looks { from, to } = looks;
    let horizon = policy.horizon();
    let pairs = |left: usize| {
        let frames = horizon + 1 - left;
        policy.join(from.clone().narrow(1, 0, frames), to.clone().narrow(1, left, frames), left)
    };
    let actions = policy.decide(Tensor::cat((1..=horizon).map(pairs).collect(), 1));
    let mut errors = Vec::with_capacity(horizon);
    let mut first = 0;
    for left in 1..=horizon {
        let frames = horizon + 1 - left;
        let taken = taken.clone().narrow(1, 0, frames);
        errors.push(mean_squared_error(actions.clone().narrow(1, first, frames), taken));
        first += frames;
    }
    let (near, far) = (errors[0].clone(), errors[horizon - 1].clone());
    Terms { total: Tensor::cat(errors, 0).mean(), parts: vec![("near", near), ("far", far)] }
}
