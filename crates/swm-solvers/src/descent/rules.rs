//! Optimizers: one step of one sequence along its gradient.
//!
//! Rules and defaults are PyTorch's, to relevant rounding: Kingma & Ba,
//! *Adam* (2015); Loshchilov & Hutter, *Decoupled Weight Decay Regularization* (2019).

use crate::error::PlanError;
use crate::ranges::{check_below_one, check_not_negative, check_positive};

/// An update rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Rule {
    /// Against the gradient, with momentum.
    Sgd { lr: f64, momentum: f64, nesterov: bool },
    /// Against its mean, in units of the root of its mean square.
    Adam { lr: f64, betas: [f64; 2], eps: f64, weight_decay: WeightDecay },
}

/// Weight decay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum WeightDecay {
    /// Part of the gradient, as in Adam.
    InGradient(f64),
    /// Apart from it, as in AdamW.
    Decoupled(f64),
}

impl Rule {
    /// Checks the ranges.
    pub(crate) fn validate(&self) -> Result<(), PlanError> {
        let lr = match *self {
            Self::Sgd { lr, momentum, .. } => {
                check_below_one("momentum", momentum)?;
                lr
            }
            Self::Adam { lr, betas, eps, weight_decay } => {
                check_below_one("beta1", betas[0])?;
                check_below_one("beta2", betas[1])?;
                check_not_negative("eps", eps)?;
                let (WeightDecay::InGradient(decay) | WeightDecay::Decoupled(decay)) = weight_decay;
                check_not_negative("weight_decay", decay)?;
                lr
            }
        };
        check_positive("lr", lr)
    }

    /// Step `number`, from 1, of one sequence, whose optimizer state was zero before the first.
    pub(crate) fn step(
        &self,
        number: u32,
        values: &mut [f32],
        gradient: &[f32],
        [first, second]: [&mut [f32]; 2],
    ) {
        match *self {
            Self::Sgd { lr, momentum, nesterov } => {
                let (lr, momentum) = (lr as f32, momentum as f32);
                if momentum == 0.0 {
                    values.iter_mut().zip(gradient).for_each(|(value, g)| *value -= lr * g);
                    return;
                }
                for ((value, &g), mean) in values.iter_mut().zip(gradient).zip(first) {
                    *mean = momentum * *mean + g;
                    *value -= lr * if nesterov { g + momentum * *mean } else { *mean };
                }
            }
            Self::Adam { lr, betas, eps, weight_decay } => {
                let unbias = betas.map(|beta| 1.0 - beta.powi(number.try_into().unwrap_or(i32::MAX)));
                let (lr_now, root) = ((lr / unbias[0]) as f32, unbias[1].sqrt() as f32);
                let [beta1, beta2] = betas.map(|beta| beta as f32);
                let rest = betas.map(|beta| (1.0 - beta) as f32);
                let (keep, decay) = match weight_decay {
                    WeightDecay::InGradient(decay) => (1.0, decay as f32),
                    WeightDecay::Decoupled(decay) => ((1.0 - lr * decay) as f32, 0.0),
                };
                let memories = first.iter_mut().zip(second);
                for ((value, &g), (mean, square)) in values.iter_mut().zip(gradient).zip(memories) {
                    *value *= keep;
                    let g = g + decay * *value;
                    *mean = beta1 * *mean + rest[0] * g;
                    *square = beta2 * *square + rest[1] * g * g;
                    *value -= lr_now * *mean / (square.sqrt() / root + eps as f32);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where two steps lead from 1 with the gradients 2 and -1, computed by hand.
    fn two_steps(rule: Rule) -> f32 {
        let (mut value, mut first, mut second) = ([1.0], [0.0], [0.0]);
        rule.step(1, &mut value, &[2.0], [&mut first, &mut second]);
        rule.step(2, &mut value, &[-1.0], [&mut first, &mut second]);
        value[0]
    }

    #[test]
    fn rules_are_the_published_ones() {
        let near = |found: f32, expected: f64| {
            assert!((f64::from(found) - expected).abs() < 1e-6, "{found} is not {expected}");
        };
        near(two_steps(Rule::Sgd { lr: 0.1, momentum: 0.0, nesterov: false }), 1.0 - 0.2 + 0.1);
        // Buffers 2, then 0.5 × 2 - 1 = 0.
        near(two_steps(Rule::Sgd { lr: 0.1, momentum: 0.5, nesterov: false }), 1.0 - 0.2);
        near(two_steps(Rule::Sgd { lr: 0.1, momentum: 0.5, nesterov: true }), 1.0 - 0.3 + 0.1);

        let adam = |weight_decay| Rule::Adam { lr: 0.1, betas: [0.9, 0.999], eps: 1e-8, weight_decay };
        // The first step is lr whatever the gradient; the second lr × m/(1 - 0.9²) / sqrt(v/(1 - 0.999²)).
        let (m, v) = (0.9 * 0.2 - 0.1, 0.999 * 0.004 + 0.001);
        let second = 0.1 * (m / 0.19) / f64::sqrt(v / 0.001999);
        near(two_steps(adam(WeightDecay::InGradient(0.0))), 0.9 - second);
        let first = 1.0 * (1.0 - 0.1 * 0.5) - 0.1;
        near(two_steps(adam(WeightDecay::Decoupled(0.5))), first * (1.0 - 0.1 * 0.5) - second);
        // Gradients 2.5, then -1 + 0.5 × 0.9.
        let (g1, g2) = (2.5, -1.0 + 0.5 * 0.9);
        let (m, v) = (0.9 * 0.1 * g1 + 0.1 * g2, 0.999 * 0.001 * g1 * g1 + 0.001 * g2 * g2);
        near(two_steps(adam(WeightDecay::InGradient(0.5))), 0.9 - 0.1 * (m / 0.19) / f64::sqrt(v / 0.001999));
    }
}
