//! AdamW on the plan itself: Adam with decoupled weight decay.
//!
//! Source: Loshchilov & Hutter, *Decoupled Weight Decay Regularization* (2019).

use crate::descent::{Descent, Rule, WeightDecay};

swm_core::settings! {
    /// Settings of AdamW. The learning rate is that of the reference's published runs, the rest are PyTorch's defaults.
    pub struct AdamW {
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
        /// Weight decay, apart from the gradient.
        weight_decay: f64 = 0.01,
    }
}

impl AdamW {
    fn rule(&self) -> Rule {
        Rule::Adam {
            lr: self.lr,
            betas: [self.beta1, self.beta2],
            eps: self.eps,
            weight_decay: WeightDecay::Decoupled(self.weight_decay),
        }
    }
}

crate::descent::one_rule!(AdamW, "adamw", "AdamW (Adam with decoupled weight decay) with restarts");
