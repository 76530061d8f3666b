//! Gradient descent on the plan itself, with optional momentum.
//!
//! Source: the reference's `GradientSolver` with its SGD; momentum as in Sutskever et al., *On the importance of
//! initialization and momentum in deep learning* (2013), in PyTorch's form.

use crate::descent::{Descent, Rule};

swm_core::settings! {
    /// Settings of gradient descent.
    pub struct Sgd {
        ..descent: Descent,
        /// Clip plans to the action bounds. The reference does not.
        clip: bool = false,
        /// Learning rate.
        ///
        /// The reference's 1 makes most problems diverge; what is small enough depends on the curvature of the cost.
        lr: f64 = 0.01,
        /// Fraction of the last step that is added to the next.
        momentum: f64 = 0.0,
        /// Nesterov momentum.
        nesterov: bool = false,
    }
}

impl Sgd {
    fn rule(&self) -> Rule {
        Rule::Sgd { lr: self.lr, momentum: self.momentum, nesterov: self.nesterov }
    }
}

crate::descent::one_rule!(Sgd, "sgd", "gradient descent with restarts and momentum");
