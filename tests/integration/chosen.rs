//! Manifests of pairs that were chosen one by one.

use serde_json::Value as Json;

use crate::evaluation::{dataset, read};
use crate::support::{Folder, PUSHT, swm, swm_ok};

#[test]
fn pairs_are_chosen_one_by_one() {
    let folder = Folder::new();
    let (data, out) = (dataset(&folder), folder.path("chosen.json"));
    let make = |pairs: &'static str, tier: &'static str| -> Vec<String> {
        let words = ["manifest", "make", PUSHT, "--dataset", &data, "--pairs", pairs, "--tier", tier];
        [&words[..], &["--out", &out]].concat().iter().map(|&word| word.to_owned()).collect()
    };
    let run = |words: &[String], also: &[&str]| {
        let words: Vec<&str> = words.iter().map(String::as_str).chain(also.iter().copied()).collect();
        swm(&words).output().unwrap()
    };
    let refused = |pairs: &'static str, tier: &'static str, also: &[&str]| {
        let output = run(&make(pairs, tier), also);
        assert_eq!(output.status.code(), Some(2), "{pairs}: {}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    assert!(refused("3:10", "historic", &[]).contains("write EPISODE:START-GOAL"));
    assert!(refused("30:0-1", "historic", &[]).contains("names episode 30; the dataset holds 30"));
    assert!(refused("3:0-1000", "historic", &[]).contains("step 1000 of episode 3, which holds"));
    assert!(refused("3:0-5,3:0-5", "historic", &[]).contains("3:0-5 is given twice"));
    assert!(
        refused("3:5-5", "moderate", &[])
            .contains("3:5-5 is a success at its start by the rules of the tier moderate")
    );
    for also in [["--episodes", "2"], ["--goal-offset", "5"], ["--held-out", "1"]] {
        assert!(refused("3:0-5", "historic", &also).contains("cannot be used with"), "{also:?}");
    }
    assert!(!std::path::Path::new(&out).exists(), "nothing is written for a wrong request");

    assert!(run(&make("3:2-20,1:0-4:7", "historic"), &[]).status.success());
    let made = read(&out);
    assert_eq!(made["source"]["kind"], "chosen");
    assert_eq!(
        (&made["pairs"][0]["from"], &made["pairs"][0]["goal_episode"]),
        (&[3, 2, 20].into(), &Json::Null)
    );
    assert_eq!(
        (&made["pairs"][1]["from"], &made["pairs"][1]["goal_episode"]),
        (&[1, 0, 7].into(), &4.into())
    );
    let mut recorded = swm::data::open(data.as_ref()).unwrap();
    let schema = recorded.schema().clone();
    let mut rows = swm::core::Batch::new(schema, 0);
    for (pair, side, episode, step) in
        [(0, "start", 3, 2), (0, "goal", 3, 20), (1, "start", 1, 0), (1, "goal", 4, 7)]
    {
        rows.clear();
        recorded.read(episode, step..step + 1, &mut rows).unwrap();
        let state: Vec<f64> = serde_json::from_value(made["pairs"][pair][side]["state"].clone()).unwrap();
        assert_eq!(state, rows.get::<f64>("state").unwrap(), "{side} of pair {pair}");
    }
    assert!(swm_ok(&["manifest", "show", &out]).contains("pairs chosen one by one"));
    let again = run(&make("3:2-20,1:0-4:7", "historic"), &[]);
    assert!(again.status.success(), "the same manifest is there already");
    swm_ok(&["eval", "--manifest", &out, "--policy", "random", "--reference", "none", "--quiet"]);
}
