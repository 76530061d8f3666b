//! Single steps of a model from any state: what solvers need that search for states beside actions.

use crate::error::PlanError;
use crate::problem::Candidates;

/// Blocks of candidates, each with the state that it is taken from, whatever the blocks before it lead to.
#[derive(Clone, Copy, Debug)]
pub struct StepBatch<'a> {
    /// `[B, S, H, D]`: the blocks. Episode `b` is environment `b` of the prepared context.
    pub candidates: Candidates<'a>,
    /// `[B, S, H, W]`: the state before each block.
    pub states: &'a [f32],
    /// `[B, S, H, W]`: what the state after each block is compared with.
    pub targets: &'a [f32],
}

/// A model that predicts the state after one block of actions from any state, with the derivative by the actions alone.
///
/// A prediction depends on its own state and block only, never on others in the batch.
pub trait StateSteps {
    /// W: values of a state, such as a latent.
    fn state_dim(&mut self) -> usize;

    /// Fills `starts` and `goals`, `[B, W]` each, with the states that the prepared plans start in and should reach.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn ends(&mut self, starts: &mut [f32], goals: &mut [f32]) -> Result<(), PlanError>;

    /// Fills `next`, `[B, S, H, W]`, with the state after each block, and `gradient`, `[B, S, H, D]`, with the derivative of
    /// Σ ‖next − target‖² with respect to the blocks.
    ///
    /// # Errors
    ///
    /// The model fails.
    fn step_toward(
        &mut self,
        steps: &StepBatch<'_>,
        next: &mut [f32],
        gradient: &mut [f32],
    ) -> Result<(), PlanError>;
}
