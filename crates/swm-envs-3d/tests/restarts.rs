//! Episodes that start at recorded steps continue as the recorded ones did, and images of recorded goals are the recorded frames;
//! what is lost is listed here, with the reason, and told by the environment's page.

use swm_core::testing::{Inexact, goals_look_as_recorded, restarts_continue};
use swm_core::{EnvConfig, ImageSize};
use swm_envs_3d::ENVS;

fn config() -> EnvConfig {
    EnvConfig { image: Some(ImageSize { height: 48, width: 64 }), ..EnvConfig::default() }
}

/// What differs, by environment.
const INEXACT: &[(&str, &[Inexact<'_>])] =
    &[("swm/PFRocketLanding-v0", &[noise("observation", 0.5), noise("state", 0.5), noise("pixels", 255.0)])];

/// The throttle's noise is keyed by the seed and the steps since the reset.
const fn noise(column: &str, later: f64) -> Inexact<'_> {
    Inexact { column, first: 0.0, later, reason: "the throttle has other noise" }
}

/// Pixels of a goal that differ from the recorded frame, and by how much, by environment and reason.
const OTHER_GOALS: &[(&str, [usize; 2], &str)] =
    &[("swm/TablePush3D-v0", [40, 200], "the object stands as at the start, and so does the pusher")];

#[test]
fn restarts_of_all_environments_continue_as_recorded() {
    let of = |id: &str| INEXACT.iter().find(|(env, _)| *env == id).map_or(&[][..], |(_, columns)| columns);
    let failures = ENVS.iter().filter_map(|entry| restarts_continue(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn goals_of_all_environments_look_as_recorded() {
    let of = |id: &str| OTHER_GOALS.iter().find(|(env, ..)| *env == id).map_or([0, 0], |(_, most, _)| *most);
    let failures =
        ENVS.iter().filter_map(|entry| goals_look_as_recorded(entry, &config(), of(entry.id)).err());
    let failures: Vec<String> = failures.collect();
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
