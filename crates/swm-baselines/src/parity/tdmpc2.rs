//! TD-MPC2: its functions, losses, gradients, the scale of values, all weights after one update, and costs of plans; from vectors,
//! and from images and vectors.

use serde_json::json;

use super::{Fixture, GRADIENT, LOSS, STEPPED, worst};
use crate::images::Images;
use crate::online::tdmpc2::{Noise, Tdmpc2, Tdmpc2Config, Tdmpc2Image, Tdmpc2Network, check_functions, loss};
use crate::online::{AgentConfig, OnlineAgent as _, Transitions};
use swm_nn::Pass;
use swm_nn::optim::Gradients;
use swm_nn::params;

const STEPS: usize = 2;
const CLIPS: usize = 5;
/// The side of images.
const SIDE: usize = 39;

/// The fixtures, and the side of the images that are observed in each.
const CASES: [(&str, Option<usize>); 2] = [("tdmpc2", None), ("tdmpc2_pixels", Some(SIDE))];

fn config() -> Tdmpc2Config {
    Tdmpc2Config {
        latent_dim: 8,
        encoder_dim: 7,
        image: Tdmpc2Image { size: SIDE, channels: 3, latent_dim: None },
        mlp_dim: 6,
        simnorm_dim: 4,
        num_q: 3,
        num_bins: 11,
        vmin: -3.0,
        vmax: 3.0,
        horizon: STEPS,
        discount: Some(0.97),
        lr: 0.01,
        policy_lr_scale: 0.1,
        clip: Some(0.5),
        ..Tdmpc2Config::paper()
    }
}

fn agent_config(image: Option<usize>) -> AgentConfig {
    AgentConfig {
        agent: "tdmpc2".to_owned(),
        preset: "paper".to_owned(),
        settings: json!(null),
        observation_dim: 3,
        image,
        action_dim: 2,
        seed: 0,
    }
}

fn agent(fixture: &Fixture, image: Option<usize>) -> Tdmpc2 {
    let agent = agent_config(image);
    let network = fixture.load(&Tdmpc2Network::new(&agent, &config(), &fixture.device), "weights");
    Tdmpc2::with(agent, config(), network, fixture.device.clone())
}

/// The bytes of all images: a function of their place, as in the script that makes the fixture.
fn bytes() -> Vec<u8> {
    let count = CLIPS * (STEPS + 1) * SIDE * SIDE * 3;
    (0..count as u64).map(|place| (place.wrapping_mul(2_654_435_761) as u32 >> 24) as u8).collect()
}

/// The clips of a fixture.
fn clips<'a>(fixture: &'a Fixture, image: Option<usize>, bytes: &'a [u8]) -> Transitions<'a> {
    let values = |name: &str| fixture.values(&format!("inputs.{name}"));
    let images = image.map(|side| Images {
        values: bytes,
        rows: CLIPS,
        steps: STEPS + 1,
        height: side,
        width: side,
        channels_last: true,
    });
    Transitions {
        rows: CLIPS,
        steps: STEPS + 1,
        observation: values("observation"),
        images,
        action: values("action"),
        reward: values("reward"),
        terminated: &[0.0; CLIPS * (STEPS + 1)],
    }
}

#[test]
fn functions_are_the_references() {
    let fixture = Fixture::open("tdmpc2");
    for (name, ours) in check_functions(&config(), |name| fixture.tensor(&format!("inputs.{name}"))) {
        let theirs = fixture.values(&format!("outputs.{name}"));
        let greatest = theirs.iter().fold(1.0_f32, |most, value| most.max(value.abs()));
        let differs = worst(&params::host(ours), theirs);
        assert!(differs <= 1e-6 * greatest, "{name}: {differs} of {greatest}");
    }
}

#[test]
fn plans_cost_what_they_cost_the_reference() {
    for (name, image) in CASES {
        let fixture = Fixture::open(name);
        let agent = agent(&fixture, image);
        let network =
            fixture.load(&Tdmpc2Network::new(&agent_config(image), &config(), &fixture.device), "weights");
        let batch = agent.minibatch(&clips(&fixture, image, &bytes())).unwrap();
        let latent = network.encode(batch.observed.narrow(0, CLIPS));
        let differs = fixture.check("outputs.encoded", latent.clone());
        assert!(differs <= 1e-6, "latents of {name}: {differs}");
        let candidates = fixture.tensor::<4>("inputs.candidates");
        for (problem, theirs) in fixture.values("outputs.costs").chunks_exact(6).enumerate() {
            let plans = candidates.clone().narrow(0, problem, 1).squeeze_dim::<3>(0);
            let latents = latent.clone().narrow(0, problem, 1).repeat_dim(0, 6);
            let returns = params::host(network.returns(latents, &plans, 0.97, 0.5));
            for (ours, theirs) in returns.iter().zip(theirs) {
                assert!((ours + theirs).abs() <= LOSS * theirs.abs(), "cost {} instead of {theirs}", -ours);
            }
        }
    }
}

#[test]
fn tdmpc2_learns_as_the_reference() {
    for (name, image) in CASES {
        learns_as_the_reference(name, image);
    }
}

fn learns_as_the_reference(name: &str, image: Option<usize>) {
    let fixture = Fixture::open(name);
    let mut agent = agent(&fixture, image);
    let values = |name: &str| fixture.values(&format!("inputs.{name}"));
    let batch = agent.minibatch(&clips(&fixture, image, &bytes())).unwrap();
    // In the order of the reference: of each step the targets', then the policy's.
    let given = fixture.tensor::<3>("inputs.noise");
    let noise_of = |which: usize| {
        let of_steps = (0..STEPS).map(|step| given.clone().narrow(0, 2 * step + which, 1).squeeze_dim(0));
        burn::tensor::Tensor::<2>::cat(of_steps.collect(), 0)
    };
    let pairs = values("pairs");
    let pairs_of = |which: usize| {
        let pair = |step: usize| [0, 1].map(|q| pairs[(2 * step + which) * 2 + q] as usize);
        (0..STEPS).map(pair).collect()
    };
    let noise =
        || Noise { next: noise_of(0), policy: noise_of(1), next_qs: pairs_of(0), policy_qs: pairs_of(1) };

    let network =
        fixture.load(&Tdmpc2Network::new(&agent_config(image), &config(), &fixture.device), "weights");
    let tracked = params::track(&network, crate::online::tdmpc2::TRAINED);
    let (terms, scale) = loss(&tracked, &network, &batch, &config(), noise(), &mut Pass::evaluate());
    for (name, part) in
        [("total", &terms.total)].into_iter().chain(terms.parts.iter().map(|(name, part)| (*name, part)))
    {
        if name != "q" {
            fixture.check_loss(name, part);
        }
    }
    let theirs = fixture.values("outputs.scale")[0];
    assert!((scale - theirs).abs() <= LOSS * theirs, "scale {scale} instead of {theirs}");
    let gradients = params::gradients(&tracked, &mut terms.total.backward());
    let mut compared = 0;
    for (spec, gradient) in params::specs(&tracked).iter().zip(&gradients) {
        let Some(gradient) = gradient else {
            assert!(spec.is_below(&["target_qs", "scale"]), "no gradient of {}", spec.name);
            continue;
        };
        let theirs = fixture.values(&format!("gradients.{}", spec.name));
        let greatest = theirs.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        let differs = worst(&params::to_host(spec, gradient.clone()), theirs);
        assert!(differs <= GRADIENT * greatest, "gradient of {}: {differs} of {greatest}", spec.name);
        compared += 1;
    }
    assert_eq!(compared, fixture.tensors.keys().filter(|name| name.starts_with("gradients.")).count());
    let norm = Gradients::new(gradients).clip(None).value();
    let theirs = fixture.values("outputs.norm")[0];
    assert!((norm - theirs).abs() <= LOSS * theirs, "norm {norm} instead of {theirs}");

    agent.update_with(&batch, noise(), 0, &mut Pass::evaluate()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    agent.save_weights(&path).unwrap();
    let stepped = swm_weights::read(&path).unwrap();
    for (name, tensor) in &stepped {
        let differs = worst(&tensor.values, fixture.values(&format!("stepped.{name}")));
        assert!(differs < STEPPED, "{name} after an update: {differs}");
    }
    assert_eq!(stepped.len(), fixture.tensors.keys().filter(|name| name.starts_with("stepped.")).count());
}
