//! Policies that plan on the true simulator, for any environment that has a task cost.

use swm_core::{EnvEntry, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Registry};

use crate::solvers::SOLVERS;

/// A policy for every solver of [`SOLVERS`] that can plan on the true simulator, under the solver's name. Its arguments are
/// the settings of the solver, of [`crate::PlanConfig`] and of [`crate::SimulatorOptions`], in one flat list.
pub const PLANNERS: &[PolicyEntry] = &{
    let mut all = [SOLVERS[0].on_simulator; COUNT];
    let (mut count, mut index) = (0, 0);
    while index < SOLVERS.len() {
        if SOLVERS[index].plans_on_simulator {
            all[count] = SOLVERS[index].on_simulator;
            count += 1;
        }
        index += 1;
    }
    all
};

/// The policy `expert` of environments without a scripted one: the planner that [`EnvEntry::planner`] names. Its arguments
/// override single settings. `expert:learned` is the environment's policy `learned-expert`, which does not plan.
///
/// [`EnvEntry::planner`]: swm_core::EnvEntry::planner
pub const EXPERT: PolicyEntry = PolicyEntry::new(
    "expert",
    "plans on the true dynamics with the settings of the environment; settings of its planner override",
    |context, args| {
        if args.positional.first().is_some_and(|value| value == "learned") {
            return learned(context, args);
        }
        let args = expert_args(context.env, args)?;
        let known = context.registry.into_iter().flat_map(Registry::all::<PolicyEntry>).chain(PLANNERS);
        let mut planners = known.filter(|entry| entry.on_true_dynamics && entry.name != EXPERT.name);
        let planner = planners.find(|entry| entry.name == args.name);
        planner
            .ok_or_else(|| PolicyError::Argument {
                policy: EXPERT.name.to_owned(),
                reason: format!("there is no planner `{}`", args.name),
            })?
            .make(context, &args)
    },
)
.on_true_dynamics()
.only_for(|env| env.planner.is_some());

/// The planner and its settings that [`EXPERT`] with `args` stands for.
///
/// # Errors
///
/// [`PolicyError::Argument`]: the environment names no planner.
fn expert_args(env: &EnvEntry, args: &PolicyArgs) -> Result<PolicyArgs, PolicyError> {
    let Some(planner) = env.planner else {
        return Err(args.wrong(format!("{} names no planner; use one by its name", env.id)));
    };
    let mut all = PolicyArgs::parse(planner)?;
    all.positional.extend(args.positional.iter().cloned());
    all.named.extend(args.named.clone());
    Ok(all)
}

/// The environment's policy `learned-expert`, asked for as `expert:learned`.
fn learned(context: &PolicyContext<'_>, args: &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError> {
    const NAME: &str = "learned-expert";
    let entry = context.env.policies.iter().find(|entry| entry.name == NAME);
    let entry =
        entry.ok_or_else(|| args.wrong(format!("{} has no `{NAME}`; `expert` plans", context.env.id)))?;
    let mut rest = PolicyArgs::new(NAME, args.named.clone());
    rest.positional.extend_from_slice(&args.positional[1..]);
    entry.make(context, &rest)
}

const COUNT: usize = {
    let (mut count, mut index) = (0, 0);
    while index < SOLVERS.len() {
        count += SOLVERS[index].plans_on_simulator as usize;
        index += 1;
    }
    count
};

#[cfg(test)]
mod tests {
    use swm_core::testing::{DISCRETE_TOY, TOY};
    use swm_core::{EnvConfig, PolicyContext, policies};

    use super::*;

    fn describe_in(env: &EnvEntry, text: &str) -> Result<String, PolicyError> {
        let registry = Registry::new().with(PLANNERS);
        Ok(registry.policy(text, PolicyContext::new(env, &EnvConfig::default()))?.describe())
    }

    fn describe(text: &str) -> Result<String, PolicyError> {
        describe_in(&TOY, text)
    }

    #[test]
    fn documented_defaults_are_the_defaults() {
        for entry in PLANNERS {
            let all: Vec<String> =
                entry.settings.iter().map(|s| format!("{}={}", s.name, s.default)).collect();
            let text = format!("{}:{}", entry.name, all.join(","));
            // Some solvers plan real actions, others integers.
            let described = describe(&text).or_else(|_| describe_in(&DISCRETE_TOY, &text));
            assert_eq!(described.unwrap(), entry.name);
        }
    }

    #[test]
    fn a_description_makes_the_same_policy_again() {
        let text = "cem:samples=64,sigma=0.5,return_best=true,horizon=7,aggregate=mean";
        assert_eq!(describe(text).unwrap(), text);
    }

    #[test]
    fn few_samples_have_few_elites() {
        let described = |text: &str| describe(text).unwrap();
        assert_eq!(described("cem:samples=20"), "cem:samples=20,elites=10");
        assert_eq!(described("mppi:samples=5"), "mppi:samples=5,elites=2");
        assert_eq!(described("mppi:samples=1"), "mppi:samples=1,elites=1", "no more than samples");
        assert_eq!(described("cem:samples=30"), "cem:samples=30", "as many as there are by default");
        assert_eq!(described("cem:samples=20,elites=5"), "cem:samples=20,elites=5", "what is given stays");
    }

    #[test]
    fn former_names_of_settings_are_read() {
        assert_eq!(describe("icem:normalise=analytic").unwrap(), "icem:normalize=analytic");
        let message = describe("icem:normalise=analytic,normalize=analytic").unwrap_err().to_string();
        assert!(message.contains("the former name of `normalize`"), "{message}");
    }

    #[test]
    fn an_expert_is_the_planner_of_its_environment() {
        const ENV: EnvEntry = EnvEntry::new(TOY.id, TOY.summary, |config| TOY.make(config));
        const PLANNED: EnvEntry = ENV.planner("icem:horizon=7,samples=40");
        let registry = Registry::new().with(PLANNERS).with(&[EXPERT]);
        let describe = |env: &EnvEntry, text: &str| {
            let config = EnvConfig::default();
            Ok::<_, PolicyError>(registry.policy(text, PolicyContext::new(env, &config))?.describe())
        };
        assert_eq!(describe(&PLANNED, "expert").unwrap(), "icem:samples=40,horizon=7");
        assert_eq!(describe(&PLANNED, "expert:samples=50").unwrap(), "icem:samples=50,horizon=7");
        assert!(
            describe(&PLANNED, "expert:sample=50")
                .unwrap_err()
                .to_string()
                .contains("did you mean `samples`")
        );
        assert!(describe(&ENV, "expert").unwrap_err().to_string().contains("unknown policy `expert`"));
    }

    #[test]
    fn a_learned_expert_is_asked_for_by_a_word() {
        const LEARNED: PolicyEntry =
            PolicyEntry::new("learned-expert", "", |_, _| Ok(Box::new(policies::random())));
        const PLANNED: EnvEntry =
            EnvEntry::new(TOY.id, TOY.summary, |config| TOY.make(config)).planner("icem:horizon=7");
        const BOTH: EnvEntry = PLANNED.policies(&[LEARNED]);
        let registry = Registry::new().with(PLANNERS).with(&[EXPERT]);
        let config = EnvConfig::default();
        let made = |env: &EnvEntry| registry.policy("expert:learned", PolicyContext::new(env, &config));
        assert_eq!(made(&BOTH).unwrap().describe(), "random");
        let message = made(&PLANNED).map(|policy| policy.describe()).unwrap_err().to_string();
        assert!(message.contains("has no `learned-expert`; `expert` plans"), "{message}");
    }

    #[test]
    fn bad_settings_are_named() {
        let message = |text: &str| describe(text).unwrap_err().to_string();
        assert!(message("cem:sample=1").contains("setting `sample`: unknown (did you mean `samples`?)"));
        assert!(message("cem:horizon=0").contains("setting `horizon`: 0 is too small"));
        assert!(message("cem:samples=20,elites=30").contains("setting `elites`: 30 of 20 samples"));
        assert!(message("cem:elites=1").contains("setting `elites`: 1 is too few"));
        assert!(message("cem:samples=many").contains("setting `samples`: must be a whole number"));
        assert!(message("cem:horizon=3").contains("5 blocks of a plan of 3"));
        assert!(message("cem:sigma=-1").contains("setting `sigma`: -1 is not a positive number"));
        let message_of_large = message("cem:sigma=1e300");
        let expected = "setting `sigma`: 1e300 is too large for plans, whose values are f32; use at most 3.4";
        assert!(message_of_large.contains(expected), "{message_of_large}");
        assert!(
            message("cem:sigma_min=-1").contains("setting `sigma_min`: -1 is not a number from 0 on; use 0")
        );
        assert!(message("cem:success_bonus=-1").contains("setting `success_bonus`"));
        assert!(message("cem:aggregate=worst").contains("`last`, `mean`, `best`"));
        assert!(message("cem:300").contains("write key=value"));
    }
}
