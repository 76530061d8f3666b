//! Sampling factors: selection, values, constraints, independence, saving.

use proptest::prelude::*;
use swm_core::env::Episode;
use swm_core::{Dtype, EnvError, EpisodeSeed, ResetOptions, Space, Value};
use swm_fov::{Constraint, Factor, Fov, FovSpace};

fn space() -> FovSpace {
    FovSpace::new(vec![
        Factor::rgb("wall.color", [1, 2, 3]).doc("color"),
        Factor::vector("agent.position", 0.0, 10.0, &[2.0, 2.0]).sampled_by_default(),
        Factor::scalar_f32("agent.radius", 1.0, 2.0, 1.0),
        Factor::vector("goal.position", 0.0, 10.0, &[8.0, 8.0]),
        Factor::integer("door.number", 1, 3, 1),
    ])
    .with_constraints(vec![Constraint {
        owner: "goal.position",
        reads: &["agent.position"],
        words: "on the other side of x = 5 than agent.position",
        holds: |fov| {
            let [agent, goal]: [[f64; 2]; 2] = [fov.vector("agent.position"), fov.vector("goal.position")];
            (agent[0] - 5.0) * (goal[0] - 5.0) < 0.0
        },
    }])
}

fn sample(seed: u64, options: &ResetOptions) -> Result<Fov, String> {
    space().sample("swm/Test-v0", &Episode::new(EpisodeSeed::new(seed), options)).map_err(|e| e.to_string())
}

#[test]
fn constraints_of_a_second_call_are_added() {
    let rule = |owner, reads, words, holds| Constraint { owner, reads, words, holds };
    let number_is_one = rule("door.number", &[], "1", |fov| fov.i64("door.number") == 1);
    let both = space().with_constraints(vec![number_is_one]).with_constraints(vec![]);
    let refusal = |options: ResetOptions| {
        let fov = both.sample("swm/Test-v0", &Episode::new(EpisodeSeed::new(0), &options.vary(["none"])));
        fov.unwrap_err().to_string()
    };
    let first = refusal(ResetOptions::default().set("goal.position", Value::vector(&[1.0, 1.0])));
    assert!(first.contains("`goal.position` must be on the other side"), "{first}");
    let second = refusal(ResetOptions::default().set("door.number", Value::scalar(2i64)));
    assert!(second.contains("`door.number` must be 1"), "{second}");
}

/// What refuses the construction of `make`'s space.
fn refusal(make: impl FnOnce() -> Factor + std::panic::UnwindSafe) -> String {
    let refused = std::panic::catch_unwind(|| FovSpace::new(vec![make()])).expect_err("it is no factor");
    *refused.downcast::<String>().expect("a message with its name")
}

#[test]
fn bounds_that_cannot_be_sampled_are_refused_by_name() {
    let reals = [
        (f64::MIN, f64::MAX, "low -1.7976931348623157e308 and high 1.7976931348623157e308"),
        (0.0, f64::INFINITY, "low 0e0 and high inf"),
        (f64::NEG_INFINITY, 0.0, "low -inf and high 0e0"),
        (f64::NAN, 1.0, "low NaN and high 1e0"),
        (2.0, 1.0, "low 2 and high 1: low must not be above high"),
    ];
    for (low, high, part) in reals {
        for refused in [
            refusal(|| Factor::scalar("a", low, high, 0.5)),
            refusal(|| Factor::scalar_f32("a", low, high, 0.5)),
            refusal(|| Factor::vector("a", low, high, &[0.5, 0.5])),
            refusal(|| Factor::vector_f32("a", low, high, &[0.5])),
        ] {
            assert!(refused.contains("factor `a`") && refused.contains(part), "{refused}");
        }
    }
    let refused = refusal(|| Factor::scalar_f32("a", -4e38, 4e38, 0.0));
    assert!(refused.contains("must be finite float32"), "{refused}");
    for (low, high) in [(i64::MIN, i64::MAX), (0, i64::MAX), (i64::MIN, 0), (3, 1)] {
        let part = format!("factor `a` has the bounds low {low} and high {high}");
        for refused in [
            refusal(|| Factor::integer("a", low, high, 2)),
            refusal(|| Factor::integers("a", low, high, &[2, 2])),
        ] {
            assert!(refused.starts_with(&part), "{refused}");
        }
    }
    let short = Space::Box { dtype: Dtype::F64, shape: vec![2], low: vec![0.0], high: vec![1.0, 1.0] };
    let refused = refusal(|| Factor::new("a", short, Value::vector(&[0.0, 0.0])));
    assert_eq!(refused, "factor `a` has 2 values and 1 lower and 2 upper bounds");
    let refused =
        refusal(|| Factor::new("a", Space::Discrete { n: i64::MAX, start: 5 }, Value::scalar(5i64)));
    assert!(refused.contains("factor `a`"), "{refused}");
    let wide = FovSpace::new(vec![Factor::integer("a", -(1 << 53), 1 << 53, 2)]);
    let options = ResetOptions::default().vary(["all"]);
    for seed in 0..9 {
        let fov = wide.sample("swm/Test-v0", &Episode::new(EpisodeSeed::new(seed), &options)).unwrap();
        assert_eq!(wide.recall(&fov.save()).unwrap(), fov);
    }
}

#[test]
fn groups_and_all_select_what_lies_below() {
    let fov = sample(3, &ResetOptions::default().vary(["goal", "wall.color"])).unwrap();
    assert!(fov.touched("goal.position") && fov.touched("wall.color"));
    assert!(!fov.touched("agent.position") && !fov.touched("door.number"));
    let all = sample(3, &ResetOptions::default().vary(["all"])).unwrap();
    assert!(all.iter().all(|(name, _)| all.touched(name)));
}

#[test]
fn default_and_ends_of_names_select_across_groups() {
    let touched = |asked: &[&str]| {
        let fov =
            sample(3, &ResetOptions::default().vary(asked).set("goal.position", Value::vector(&[9.0, 8.0])))?;
        Ok::<_, String>(["wall.color", "agent.position", "door.number"].map(|name| fov.touched(name)))
    };
    assert_eq!(touched(&["*.color"]).unwrap(), [true, false, false]);
    // The start is sampled on either side of the wall.
    let both = (0..9).find_map(|seed| {
        let options = ResetOptions::default().vary(["default", "goal", "*.number"]);
        sample(seed, &options).ok()
    });
    let fov = both.expect("some seeds put the agent left of the wall");
    assert!(fov.touched("agent.position") && fov.touched("door.number") && !fov.touched("wall.color"));
    assert!(touched(&["*.colors"]).unwrap_err().contains("did you mean `*.color`?"));
}

#[test]
fn without_a_list_the_default_list_is_sampled() {
    let failures = (0..40).filter(|&seed| sample(seed, &ResetOptions::default()).is_err()).count();
    assert!((5..35).contains(&failures), "the default goal is on one side: {failures} of 40 must fail");
}

#[test]
fn messages_name_the_factor_and_the_fix() {
    let message = sample(0, &ResetOptions::default().vary(["agent.positon"])).unwrap_err();
    assert!(message.contains("did you mean `agent.position`?"), "{message}");
    let message = sample(0, &ResetOptions::default().vary(["none"]).set("door.number", Value::scalar(9i64)))
        .unwrap_err();
    assert!(message.contains("`door.number` must be between 1 and 3, found 9"), "{message}");
    let message = sample(0, &ResetOptions::default().vary(["none"]).set("wall.color", Value::scalar(9i64)))
        .unwrap_err();
    assert!(message.contains("`wall.color` must be uint8 [3], found 1 value(s)"), "{message}");
    let both_left = ResetOptions::default().vary(["none"]).set("goal.position", Value::vector(&[1.0, 1.0]));
    let message = sample(0, &both_left).unwrap_err();
    assert!(
        message.contains("other side of x = 5") && message.contains("agent.position = [2.0,2.0]"),
        "{message}"
    );
}

#[test]
fn a_default_that_no_longer_fits_is_named_as_such() {
    let message =
        (0..40).find_map(|seed| sample(seed, &ResetOptions::default().vary(["agent.position"])).err());
    let message = message.expect("half of the samples lie on the default goal's side");
    assert!(message.contains("`goal.position` must be on the other side"), "{message}");
    assert!(message.contains("its default does not meet: sample or set it too"), "{message}");
}

#[test]
fn descriptions_list_every_factor() {
    let (tree, table) = (space().to_string(), swm_fov::markdown(&space().specs()));
    for spec in space().specs() {
        assert!(tree.contains(spec.name.rsplit('.').next().unwrap()), "{tree}");
        assert!(table.contains(&format!("`{}`", spec.name)), "{table}");
    }
    assert!(table.contains("must be on the other side"), "{table}");
}

proptest! {
    #[test]
    fn sampling_one_more_factor_moves_no_other(seed in 0u64..1 << 40) {
        let few = sample(seed, &ResetOptions::default().vary(["wall.color", "agent.radius"])).unwrap();
        let more = sample(seed, &ResetOptions::default().vary(["all"])).unwrap();
        prop_assert_eq!(few.rgb("wall.color"), more.rgb("wall.color"));
        prop_assert_eq!(few.f32("agent.radius"), more.f32("agent.radius"));
        prop_assert_eq!(few.i64("door.number"), 1);
    }

    #[test]
    fn a_saved_assignment_comes_back(seed in 0u64..1 << 40) {
        let fov = sample(seed, &ResetOptions::default().vary(["all"])).unwrap();
        let saved = serde_json::from_str(&serde_json::to_string(&fov.save()).unwrap()).unwrap();
        prop_assert_eq!(space().recall(&saved).unwrap(), fov);
    }
}

#[test]
fn none_and_added_names_select_as_in_the_command() {
    let touched = |names: &[&str]| {
        let options = ResetOptions::default().vary(names);
        (0..9)
            .find_map(|seed| sample(seed, &options).ok())
            .map(|fov| ["wall.color", "agent.position", "door.number"].map(|name| fov.touched(name)))
    };
    assert_eq!(touched(&["none"]), Some([false; 3]));
    assert_eq!(touched(&["+door.number"]), Some([false, true, true]));
    let refused = sample(0, &ResetOptions::default().vary(["none", "wall.color"])).unwrap_err();
    assert!(refused.contains("leave out `none`, or the others"), "{refused}");
}

#[test]
fn choices_are_set_by_name_and_named_in_tables() {
    let space = FovSpace::new(vec![
        Factor::integer("block.shape", 1, 3, 2).choices(&["L", "small T", "Z"]).doc("shape of the bLock"),
        Factor::integer("wall.axis", 0, 1, 1).choices(&["flat", "tall"]).doc("0: flat; 1: tall"),
    ]);
    let set = |value: Value| {
        let options = ResetOptions::default().vary(["none"]).set("block.shape", value);
        let fov = space.sample("swm/Test-v0", &Episode::new(EpisodeSeed::new(1), &options));
        fov.map(|fov| fov.i64("block.shape")).map_err(|error| error.to_string())
    };
    assert_eq!((set("small-t".into()), set("Z".into()), set(1.into())), (Ok(2), Ok(3), Ok(1)));
    let refused = set("X".into()).unwrap_err();
    assert!(refused.contains("a number or one of L, small T, Z, found `X`"), "{refused}");
    let table = swm_fov::markdown(&space.specs());
    assert!(table.contains("| shape of the bLock: 1 L, 2 small T, 3 Z |"), "{table}");
    assert!(table.contains("| 0: flat; 1: tall |"), "{table}");
}

#[test]
fn errors_of_factors_are_errors_of_environments() {
    let recall =
        || -> Result<Fov, EnvError> { Ok(space().recall(&FovSpace::new(vec![]).defaults().save())?) };
    let error = recall().unwrap_err();
    assert!(
        matches!(error, EnvError::Other(_)) && error.to_string().contains("the saved factors"),
        "{error}"
    );
}

#[test]
fn names_that_resets_read_otherwise_are_refused() {
    for name in ["", "none", "default", "all", "all.color", "a=b", "a,b", "+a", "*.a", "a b", "a."] {
        let made = std::panic::catch_unwind(|| FovSpace::new(vec![Factor::scalar(name, 0.0, 1.0, 0.5)]));
        let panic = made.unwrap_err();
        let message = panic.downcast_ref::<String>().unwrap();
        assert!(message.starts_with(&format!("the factor name `{name}` ")), "{message}");
    }
    for name in ["allowed", "none_left.size", "block.all"] {
        FovSpace::new(vec![Factor::scalar(name, 0.0, 1.0, 0.5)]);
    }
}

#[test]
fn none_stands_alone() {
    let space = FovSpace::new(vec![Factor::scalar("a", 0.0, 1.0, 0.5).sampled_by_default()]);
    let sample = |names: &[&str]| {
        let variation = Some(names.iter().map(|&name| name.to_owned()).collect());
        let options = ResetOptions { variation, ..ResetOptions::default() };
        space.sample("swm/Example-v0", &Episode::new(EpisodeSeed::new(1), &options))
    };
    assert_eq!(sample(&["none"]).unwrap(), space.defaults());
    let message = sample(&["none", "a"]).unwrap_err().to_string();
    assert!(message.contains("swm/Example-v0") && message.contains("leave out `none`"), "{message}");
}
