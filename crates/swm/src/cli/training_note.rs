//! Notes of requests about how a policy's model was trained, printed.

use swm_core::registry::TrainedIn;
use swm_core::{EnvEntry, Manifest, PolicyArgs, PolicyContext, Registry};
pub(super) use swm_tasks::request::Ask;
use swm_tasks::request::{note_training, note_training_of, note_training_on};

use super::Output;

/// As [`note_training`].
pub(super) fn of_policy(
    registry: &Registry,
    args: &PolicyArgs,
    context: &PolicyContext<'_>,
    ask: Ask,
    output: &Output,
) {
    note_training(registry, args, context, ask, &mut &*output);
}

/// As [`note_training_on`].
pub(super) fn of_policy_on(
    registry: &Registry,
    env: &EnvEntry,
    manifest: &Manifest,
    args: &PolicyArgs,
    output: &Output,
) {
    note_training_on(registry, env, manifest, args, &mut &*output);
}

/// As [`note_training_of`].
pub(super) fn of_model(
    args: &PolicyArgs,
    trained: Option<&TrainedIn>,
    context: &PolicyContext<'_>,
    ask: Ask,
    output: &Output,
) {
    note_training_of(args, trained, context, ask, &mut &*output);
}
