//! The experts that plan: every one that an environment names is a policy, and gets more reward than chance does.

use serde_json::Value as Json;

use crate::support::{swm_fails, swm_json};

fn returns(env: &str, policy: &str, steps: &str) -> Vec<f64> {
    let args =
        ["eval", env, "--policy", policy, "--episodes", "2", "--budget", steps, "--seed", "3", "--quiet"];
    let all = swm_json(&args)["episode_returns"].clone();
    all.as_array().expect("a list").iter().filter_map(Json::as_f64).collect()
}

#[test]
fn experts_that_plan_beat_chance() {
    // Short episodes of what is simulated quickly; docs/envs/suite.md has whole ones of all.
    for (env, steps, least) in [
        ("swm/CheetahDMControl-v0", "60", 20.0),
        ("swm/ReacherDMControl-v0", "60", 40.0),
        ("swm/PendulumDMControl-v0", "250", 50.0),
    ] {
        let (expert, random) = (returns(env, "expert", steps), returns(env, "random", steps));
        assert_eq!((expert.len(), random.len()), (2, 2));
        for (expert, random) in expert.iter().zip(&random) {
            assert!(expert - random > least, "{env}: {expert} is not {least} above {random}");
        }
    }
}

#[test]
fn every_planner_that_an_environment_names_is_a_policy() {
    let envs = swm_json(&["envs"]);
    let named: Vec<&Json> =
        envs.as_array().unwrap().iter().filter(|env| env["planner"].is_string()).collect();
    assert!(named.len() >= 12, "the domains of the suite");
    for env in named {
        let id = env["id"].as_str().unwrap();
        assert!(env["policies"].as_array().unwrap().iter().any(|policy| policy["name"] == "expert"), "{id}");
        // One step. Where the planner is the expert, too: settings that are given override.
        let planner = env["planner"].as_str().unwrap();
        let (asked, begin) = if id.contains("DMControl") {
            ("expert:samples=13,seed=1".to_owned(), "icem:samples=13,")
        } else {
            (format!("{planner},seed=1"), planner.split(':').next().unwrap())
        };
        let result =
            swm_json(&["eval", id, "--policy", &asked, "--episodes", "1", "--budget", "1", "--quiet"]);
        let policy = result["setup"]["policy"].as_str().unwrap();
        assert!(policy.starts_with(begin) && policy.contains("seed=1"), "{id}: {policy}");
    }
}

#[test]
fn an_expert_that_does_not_exist_or_a_wrong_setting_is_told() {
    let message = swm_fails(2, &["eval", "swm/CheetahDMControl-v0", "--policy", "expert:sample=3"]);
    assert!(message.contains("did you mean `samples`"), "{message}");
    let message = swm_fails(2, &["eval", "swm/CheetahDMControl-v0", "--policy", "exprt"]);
    assert!(message.contains("did you mean `expert`"), "{message}");
}
