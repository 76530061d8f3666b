//! The agent by itself: plans, noise, refusals. `src/parity` compares its losses and costs with PyTorch's.

use serde_json::{Value as Json, json};
use swm_core::LiveEpisode;

use super::*;
use crate::online::agent::Task;

const OBSERVATION: [f32; 2] = [0.3, -0.2];

fn agent_with(changes: &Json, seed: u64) -> Tdmpc2 {
    let task = Task::online("x", 500);
    let settings = settings("small", &task, changes).unwrap();
    let (agent, preset) = (NAME.to_owned(), "small".to_owned());
    let config =
        AgentConfig { agent, preset, settings, observation_dim: 2, image: None, action_dim: 1, seed };
    Tdmpc2::new(config, Device::Cpu).unwrap()
}

fn agent(seed: u64) -> Tdmpc2 {
    let mut agent = agent_with(
        &json!({ "latent_dim": 16, "encoder_dim": 16, "mlp_dim": 16, "num_bins": 21, "batch": 4, "horizon": 2 }),
        seed,
    );
    // Rewards and values begin at 0 everywhere: other weights, so that plans differ in what they are worth.
    agent.network = params::map(agent.network, |spec, tensor| {
        let is_last = spec.name.ends_with(".2.weight");
        let values =
            (0..tensor.dims()[0]).map(|index| ((index * 37 + 11) % 23) as f32 / 23.0 - 0.5).collect();
        if is_last { params::from_host(spec, values, &tensor) } else { tensor }
    });
    agent
}

fn act(agent: &mut Tdmpc2, slot: usize, [episode, step]: [u64; 2], explore: bool) -> f32 {
    let mut live = LiveEpisode::of(7, episode);
    live.step = step;
    let mut action = [0.0];
    agent.act(slot, &live, explore, &seen(&OBSERVATION), &mut action).unwrap();
    action[0]
}

fn seen(vector: &[f32]) -> Observation<'_> {
    Observation { vector, image: None }
}

#[test]
fn an_action_does_not_depend_on_other_environments() {
    let mut alone = agent(3);
    let wanted = [0, 1, 2].map(|step| act(&mut alone, 0, [4, step], true));
    assert!(wanted.iter().all(|action| action.abs() <= 1.0) && wanted[0] != wanted[1], "{wanted:?}");
    // In another slot, among others, whose episodes are at other steps.
    let mut together = agent(3);
    act(&mut together, 5, [9, 0], true);
    let found = [0, 1, 2].map(|step| {
        act(&mut together, 0, [1, step + 7], true);
        let action = act(&mut together, 2, [4, step], true);
        act(&mut together, 5, [9, step + 1], false);
        action
    });
    assert_eq!(wanted, found);
    // An episode that begins in the slot of another has no plan yet.
    assert_eq!(wanted[0], act(&mut together, 5, [4, 0], true));
    // On any number of threads.
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| {
            let mut agent = agent(3);
            [0, 1, 2].map(|step| act(&mut agent, 0, [4, step], true))
        });
        assert_eq!(wanted, found);
    }
}

#[test]
fn a_plan_begins_with_the_rest_of_the_last_one() {
    let (mut one, mut other) = (agent(3), agent(3));
    act(&mut one, 0, [4, 0], false);
    assert_ne!(act(&mut one, 0, [4, 1], false), act(&mut other, 0, [4, 1], false));
}

#[test]
fn plans_are_worth_more_than_the_policy_prior() {
    for temperature in [Json::Null, json!(0.5)] {
        let mut agent = agent(1);
        agent.settings.plan = Tdmpc2Plan {
            temperature: temperature.as_f64(),
            samples: 200,
            iterations: 6,
            ..agent.settings.plan
        };
        let latent = agent.network.encode(Observed {
            images: None,
            vector: Some(tensor(OBSERVATION.to_vec(), [1, 2], &agent.device)),
        });
        let episode = LiveEpisode::of(0, 0);
        let Tdmpc2 { network, settings, device, .. } = &agent;
        let planner = Planner { network, plan: &settings.plan, discount: 0.9, device, episode: &episode };
        let worth = |iterations| {
            let found = planner.search(&latent, &[], settings.plan.samples, iterations).unwrap();
            let actions = tensor(found.mean, [1, settings.plan.horizon, 1], device);
            (params::host(network.returns(latent.clone(), &actions, 0.9, 0.0))[0], found.std)
        };
        let (prior, planned) = (worth(0), worth(6));
        assert!(planned.0 > prior.0 + 0.01, "{} instead of {}", planned.0, prior.0);
        assert!(planned.1.iter().all(|std| (0.049..1.1).contains(std)), "{:?}", planned.1);
    }
}

#[test]
fn the_policy_prior_acts_by_itself() {
    let mut agent = agent(3);
    agent.settings.plan.mpc = false;
    let best = act(&mut agent, 0, [0, 0], false);
    assert_eq!(best, act(&mut agent, 1, [5, 9], false));
    assert_ne!(best, act(&mut agent, 0, [0, 0], true));
    assert_ne!(act(&mut agent, 0, [0, 1], true), act(&mut agent, 0, [0, 0], true));
}

#[test]
fn noise_is_that_of_the_update() {
    let agent = agent(3);
    let noise = |index| agent.noise(4, index, &mut Pass::train(3, index));
    let (one, again, other) = (noise(5), noise(5), noise(6));
    assert_eq!(params::host(one.next.clone()), params::host(again.next));
    assert_ne!(params::host(one.next.clone()), params::host(one.policy));
    assert_ne!(params::host(one.next), params::host(other.next));
    assert_eq!((one.next_qs.clone(), one.policy_qs.clone()), (again.next_qs, again.policy_qs));
    let pairs: Vec<[usize; 2]> = (0..50).flat_map(|index| noise(index).policy_qs).collect();
    assert!(pairs.iter().all(|[one, other]| one != other && *one < 3 && *other < 3));
    assert!((0..3).all(|q| pairs.iter().any(|pair| pair[0] == q) && pairs.iter().any(|pair| pair[1] == q)));
}

#[test]
fn clips_become_steps() {
    let count = |values| (0..values).map(|value| value as f32).collect::<Vec<f32>>();
    let (observation, others) = (count(12), count(6));
    let clips = Transitions {
        rows: 2,
        steps: 3,
        observation: &observation,
        images: None,
        action: &others,
        reward: &others,
        terminated: &[0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    };
    let batch = agent(0).minibatch(&clips).unwrap();
    let wanted = [0.0, 1.0, 6.0, 7.0, 2.0, 3.0, 8.0, 9.0, 4.0, 5.0, 10.0, 11.0];
    assert_eq!(params::host(batch.observed.vector.unwrap()), wanted);
    assert_eq!(params::host(batch.action), [0.0, 3.0, 1.0, 4.0]);
    // The reward of an action comes with the observation after it, and so does the end of the task.
    assert_eq!(params::host(batch.reward), [1.0, 4.0, 2.0, 5.0]);
    assert_eq!(params::host(batch.goes_on), [1.0, 1.0, 1.0, 0.0]);
}

#[test]
fn clips_and_observations_of_another_form_are_refused() {
    let mut agent = agent(0);
    let clips = Transitions {
        rows: 4,
        steps: 2,
        observation: &[0.0; 16],
        images: None,
        action: &[0.0; 8],
        reward: &[0.0; 8],
        terminated: &[0.0; 8],
    };
    assert!(agent.update(&clips, 0).unwrap_err().to_string().contains("4 clips of 2 steps"));
    let episode = LiveEpisode::of(0, 0);
    let refused = agent.act(0, &episode, false, &seen(&[0.0; 3]), &mut [0.0]).unwrap_err();
    assert!(refused.to_string().contains("takes 2 and gives 1"), "{refused}");
    let refused = agent.act(0, &episode, false, &seen(&[f32::NAN; 2]), &mut [0.0]).unwrap_err();
    assert!(refused.to_string().contains("no plan of 96 has a finite return at step 0"), "{refused}");
    let nan = Transitions {
        steps: 3,
        observation: &[f32::NAN; 24],
        action: &[0.0; 12],
        reward: &[0.0; 12],
        terminated: &[0.0; 12],
        ..clips
    };
    assert!(matches!(agent.update(&nan, 5), Err(BaselineError::NotFinite { step: 5, .. })));
}

/// An agent that observes images, beside vectors of `dim` values or alone.
fn agent_of_images(dim: usize) -> Tdmpc2 {
    let changes = json!({ "latent_dim": 16, "mlp_dim": 16, "num_bins": 21, "batch": 2, "horizon": 1,
        "image": { "size": 40, "channels": 4 } });
    let config = AgentConfig { observation_dim: dim, image: Some(40), ..agent_with(&changes, 3).config };
    Tdmpc2::new(config, Device::Cpu).unwrap()
}

fn images(values: &[u8], rows: usize, steps: usize, side: usize) -> Images<'_> {
    Images { values, rows, steps, height: side, width: side, channels_last: true }
}

#[test]
fn images_are_observed_alone_and_beside_vectors() {
    let bytes: Vec<u8> = (0..4 * 40 * 40 * 3).map(|place| (place * 37 % 251) as u8).collect();
    for dim in [0, 2] {
        let mut agent = agent_of_images(dim);
        let clips = Transitions {
            rows: 2,
            steps: 2,
            observation: &[0.5; 8][..4 * dim],
            images: Some(images(&bytes, 2, 2, 40)),
            action: &[0.1; 4],
            reward: &[1.0; 4],
            terminated: &[0.0; 4],
        };
        let batch = agent.minibatch(&clips).unwrap();
        // All of a step together: the first clip's image of the second step is the third.
        let place = |step: usize, clip: usize| {
            params::host(batch.observed.narrow(step * 2 + clip, 1).images.unwrap())
        };
        let side = (40, Normalization::Imagenet);
        let alone = to_tensor(PIXELS, &images(&bytes[4_800..9_600], 1, 1, 40), side, &agent.device).unwrap();
        assert_eq!(place(1, 0), params::host(alone));
        let before = agent.parameters();
        let losses = agent.update(&clips, 0).unwrap();
        assert!(losses.total.is_finite() && agent.parameters() == before);

        let act = |agent: &mut Tdmpc2, bytes: &[u8], side| {
            let observation =
                Observation { vector: &[0.5; 2][..dim], image: Some(images(bytes, 1, 1, side)) };
            let mut action = [0.0];
            agent.act(0, &LiveEpisode::of(0, 0), false, &observation, &mut action).map(|()| action[0])
        };
        let action = act(&mut agent, &bytes[..4_800], 40).unwrap();
        assert_ne!(action, act(&mut agent, &bytes[4_800..9_600], 40).unwrap());
        assert!(act(&mut agent, &bytes[..80 * 80 * 3], 80).unwrap().abs() <= 1.0, "it is resized");
        let none = Observation { vector: &[0.5; 2][..dim], image: None };
        let refused = agent.act(0, &LiveEpisode::of(0, 0), false, &none, &mut [0.0]).unwrap_err().to_string();
        assert!(refused.contains("`pixels`: there are no images"), "{refused}");
        let refused = agent.update(&Transitions { images: None, ..clips }, 0).unwrap_err().to_string();
        assert!(refused.contains("`pixels`: no 2 rows of 2 images"), "{refused}");
    }
}

#[test]
fn convolutions_begin_as_pytorchs() {
    let agent = agent_of_images(0);
    params::visit(&agent.network, |spec, tensor| {
        let most = params::host(tensor).into_iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        match spec.name.as_str() {
            // Uniform within 1 / √(inputs of a kernel).
            "cnn.0.weight" => {
                assert!((0.9 / 147_f32.sqrt()..=1.0 / 147_f32.sqrt()).contains(&most), "{most}");
            }
            "cnn.2.bias" => assert!(most > 0.0 && most <= 0.1, "{most}"),
            "pixel_encoder.weight" => assert!((0.02..0.12).contains(&most), "{most}"),
            "pixel_encoder.bias" => assert_eq!(most, 0.0),
            name => assert!(!name.starts_with("extra_encoders"), "{name}"),
        }
    });
}
