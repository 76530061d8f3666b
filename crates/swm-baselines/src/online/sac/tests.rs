//! The agent by itself: statistics, actions, refusals. `src/parity` compares its updates with PyTorch's.

use swm_core::LiveEpisode;

use super::*;
use crate::online::agent::Task;

fn agent(seed: u64) -> Sac {
    let changes = serde_json::json!({ "hidden": [8, 8], "batch": 4 });
    let settings = settings("small", &Task::online("x", 500), &changes).unwrap();
    let (agent, preset) = (NAME.to_owned(), "small".to_owned());
    let config =
        AgentConfig { agent, preset, settings, observation_dim: 2, image: None, action_dim: 1, seed };
    Sac::new(config, Device::Cpu).unwrap()
}

fn seen(vector: &[f32]) -> Observation<'_> {
    Observation { vector, image: None }
}

#[test]
fn statistics_are_those_of_all_observations() {
    let mut sac = agent(0);
    let values: Vec<f32> = (0..60).map(|index| (index as f32).sin() * 3.0 + 1.0).collect();
    [&values[..10], &values[10..46], &values[46..]].into_iter().for_each(|part| sac.observe(part));
    let [mean, variance, count] = sac.network.statistics();
    assert_eq!(count, [30.0]);
    for dim in 0..2 {
        let of_dim: Vec<f64> = values.iter().skip(dim).step_by(2).map(|value| f64::from(*value)).collect();
        let wanted = of_dim.iter().sum::<f64>() / 30.0;
        let spread = of_dim.iter().map(|value| (value - wanted).powi(2)).sum::<f64>() / 30.0;
        assert!((f64::from(mean[dim]) - wanted).abs() < 1e-5, "{mean:?}");
        assert!((f64::from(variance[dim]) - spread).abs() < 1e-5, "{variance:?}");
    }
}

#[test]
fn exploration_is_keyed_by_episode_and_step() {
    let mut sac = agent(3);
    let mut act = |episode: u64, step: u64, explore: bool| {
        let mut live = LiveEpisode::of(7, episode);
        live.step = step;
        let mut action = [0.0];
        sac.act(0, &live, explore, &seen(&[0.3, -0.2]), &mut action).unwrap();
        action[0]
    };
    assert_eq!(act(0, 0, true), act(0, 0, true));
    assert!(act(0, 0, true) != act(0, 1, true) && act(0, 0, true) != act(1, 0, true));
    assert_eq!(act(0, 0, false), act(5, 9, false));
    assert!((0..20).all(|step| act(2, step, true).abs() <= 1.0));
}

#[test]
fn clips_and_observations_of_another_form_are_refused() {
    let mut sac = agent(0);
    let clips = Transitions {
        rows: 4,
        steps: 3,
        observation: &[0.0; 24],
        images: None,
        action: &[0.0; 12],
        reward: &[0.0; 12],
        terminated: &[0.0; 12],
    };
    assert!(sac.update(&clips, 0).unwrap_err().to_string().contains("4 clips of 3 steps"));
    let refused = sac.act(0, &LiveEpisode::of(0, 0), false, &seen(&[0.0; 3]), &mut [0.0]).unwrap_err();
    assert!(refused.to_string().contains("takes 2 and gives 1"), "{refused}");
    let nan = Transitions {
        steps: 2,
        observation: &[f32::NAN; 16],
        action: &[0.0; 8],
        reward: &[0.0; 8],
        terminated: &[0.0; 8],
        ..clips
    };
    assert!(matches!(sac.update(&nan, 5), Err(BaselineError::NotFinite { step: 5, .. })));
}
