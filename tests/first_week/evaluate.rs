//! Defining a task, evaluating planners on it, asking how robust they are, and showing it.

use crate::home::Home;

const QUICK: &str = "samples=8,elites=3,iterations=2,horizon=2,receding_horizon=2,action_block=4";

/// A folder with a dataset and a task of six pairs.
fn task() -> Home {
    let home = Home::new();
    home.ok("collect swm/PushT-v1 --policy weak --episodes 20 --seed 3 --max-steps 40 --image-size none --out a.h5");
    home.ok(
        "manifest make swm/PushT-v1 --dataset a.h5 --tier moderate --held-out 1 --episodes 6 --budget 16 --out task.toml",
    );
    home
}

#[test]
fn planners_are_compared_on_a_task_and_results_are_kept() {
    let home = task();
    home.ok(&format!("eval --manifest task.toml --policy cem:{QUICK} --out results/cem"));
    let receipt = std::fs::read(home.path("results/cem/receipt.json")).unwrap();
    home.refused(
        "eval --manifest task.toml --policy random --out results/cem",
        &["holds the result of another evaluation", "--again"],
    );
    let again = home.ok(&format!("eval --manifest task.toml --policy cem:{QUICK} --out results/cem"));
    assert!(again.err.contains("already done"), "{}", again.err);
    assert_eq!(std::fs::read(home.path("results/cem/receipt.json")).unwrap(), receipt);
    let receipt: serde_json::Value = serde_json::from_slice(&receipt).unwrap();
    let pair = home.json(&format!("plan --manifest task.toml --pair 5 --policy cem:{QUICK} --trace pair"));
    assert_eq!(pair["episodes"][0]["steps"], receipt["episodes"][5]["steps"]);
    assert_eq!(pair["episodes"][0]["success"], receipt["episodes"][5]["success"]);
    home.ok("eval --manifest task.toml --policy random --out results/random");
    let compared = home.json("compare results/cem results/random");
    assert_eq!(compared[1]["test"]["pairs"], 6);
    assert_eq!(home.json("verify-result results/random")["equal"], true);
    home.ok(
        "report results/cem results/random --videos 1 --video-format gif --plans 1 --out page/report.html",
    );
    let page = std::fs::read_to_string(home.path("page/report.html")).unwrap();
    assert!(page.contains("results/cem") || page.contains(">cem"), "results go by their folders");
}

#[test]
fn a_sweep_says_what_a_policy_depends_on() {
    let home = task();
    home.ok("sweep --manifest task.toml --policy weak --factors agent.scale,*.color --values extremes --out sweep");
    let sweep: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(home.path("sweep/sweep.json")).unwrap()).unwrap();
    for cell in sweep["cells"].as_array().unwrap() {
        assert_eq!(cell["summary"]["episodes"], 6, "{cell}");
    }
    home.ok("report sweep --out sweep.html");
}

#[test]
fn few_samples_have_few_elites() {
    let home = task();
    let eval = "eval --manifest task.toml --reference none --policy";
    let quick = "iterations=1,horizon=2,receding_horizon=2,action_block=4";
    let few = home.json(&format!("{eval} cem:samples=8,{quick}"));
    let same = home.json(&format!("{eval} cem:samples=8,elites=4,{quick}"));
    assert_eq!(few["episodes"], same["episodes"], "half of the samples");
    for solver in ["mppi", "icem", "full-cem"] {
        home.ok(&format!("{eval} {solver}:samples=8,{quick}"));
    }
    home.refused(&format!("{eval} cem:samples=8,elites=9,{quick}"), &["setting `elites`: 9 of 8 samples"]);
}

#[test]
fn what_is_printed_of_a_policy_can_be_asked_for_again() {
    let home = task();
    home.ok(&format!("eval --manifest task.toml --policy cem:{QUICK} --reference none --out first"));
    let shown = home.ok("compare first").out;
    let policy = shown.split_whitespace().find(|word| word.starts_with("cem:")).expect("it names its policy");
    let again =
        home.json(&format!("eval --manifest task.toml --policy {policy} --reference none --out second"));
    assert_eq!(home.json("compare first second")[1]["test"]["difference"], 0.0);
    assert_eq!(again["candidate"]["policy"]["name"], "cem");
    // One result is shown, and what a comparison needs is said.
    assert!(home.ok("compare first").err.contains("name a second one"));
}

#[test]
fn success_at_reset_is_told_next_to_the_rates() {
    let home = Home::new();
    home.ok("collect swm/PushT-v1 --policy weak --episodes 8 --seed 3 --max-steps 12 --image-size none --out a.h5");
    home.ok("manifest make swm/PushT-v1 --dataset a.h5 --tier historic --goal-offset 1 --episodes 6 --budget 2 --out near.toml");
    let receipt = home.json("eval --manifest near.toml --policy random --reference none --out near");
    let solved = receipt["summary"]["solved_at_start"].as_u64().unwrap();
    assert!(solved > 0 && receipt["summary"]["successes"].as_u64() >= Some(solved), "{receipt}");
    let told = format!("({solved} with success at reset, which counts for every policy)");
    for line in ["eval --manifest near.toml --policy random --reference none --out near", "compare near"] {
        let shown = home.ok(line).out;
        assert!(shown.contains(&told), "{shown}");
    }
}
