//! Adam on the plan itself: step sizes independent of the scale of the cost.
//!
//! Source: Kingma & Ba, *Adam: A Method for Stochastic Optimization* (2015).

use crate::descent::{Descent, Rule, WeightDecay};

swm_core::settings! {
    /// Settings of Adam. The learning rate is that of the reference's published runs, the rest are PyTorch's defaults.
    pub struct Adam {
        ..descent: Descent,
        /// Clip plans to the action bounds. The reference does not.
        clip: bool = false,
        /// Learning rate.
        lr: f64 = 0.1,
        /// Decay rate of the mean of gradients.
        beta1: f64 = 0.9,
        /// Decay rate of the mean of squared gradients.
        beta2: f64 = 0.999,
        /// Added to the root of the mean of squares.
        eps: f64 = 1e-8,
        /// L2 penalty, part of the gradient.
        weight_decay: f64 = 0.0,
    }
}

impl Adam {
    fn rule(&self) -> Rule {
        Rule::Adam {
            lr: self.lr,
            betas: [self.beta1, self.beta2],
            eps: self.eps,
            weight_decay: WeightDecay::InGradient(self.weight_decay),
        }
    }
}

crate::descent::one_rule!(Adam, "adam", "Adam with restarts");
