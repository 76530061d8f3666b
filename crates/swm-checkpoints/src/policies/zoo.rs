//! Models of the zoo by name: `zoo:NAME` is the policy that its receipt evaluated, `mpc:zoo:NAME` another one over its run.

use swm_core::registry::Setting;
use swm_core::{PolicyArgs, PolicyEntry, PolicyError};
use swm_tasks::zoo;

use super::table::POLICIES;

/// The policy of a model of the zoo.
pub(super) const POLICY: PolicyEntry = PolicyEntry::new(
    zoo::ZOO,
    "acts or plans by a model of the zoo (`zoo:NAME`; `swm zoo` lists them), with settings of its own policy",
    |context, args| {
        let (entry, args) = policy(args)?;
        entry.make(context, &args)
    },
)
.settings(&[Setting::new("NAME", "Model of the zoo", "required")])
.image(|args| policy(args).ok().and_then(|(entry, args)| entry.image_size(&args)))
.trained(|args| policy(args).ok().and_then(|(entry, args)| entry.trained_in(&args)))
.files(|args| {
    let (entry, args) = policy(args)?;
    entry.model_files(&args)
})
.companions(|args| {
    let (entry, args) = policy(args)?;
    entry.companion_files(&args)
})
.oracle(|context, args| policy(args).ok().and_then(|(entry, args)| entry.oracle_args(context, &args)));

/// The entry and the arguments that a name means.
fn policy(args: &PolicyArgs) -> Result<(&'static PolicyEntry, PolicyArgs), PolicyError> {
    let policy = zoo::policy_of(args).map_err(|error| args.wrong(error.to_string()))?;
    let known = POLICIES.iter().find(|entry| entry.name == policy.name && entry.name != zoo::ZOO);
    let entry = known
        .ok_or_else(|| args.wrong(format!("its policy `{}` is none of a trained model", policy.name)))?;
    Ok((entry, policy))
}
