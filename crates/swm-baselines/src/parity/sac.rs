//! SAC: losses and gradients of critics and policy, and all weights after one update.

use serde_json::json;

use super::{Fixture, GRADIENT, STEPPED, worst};
use crate::online::sac::{Minibatch, Sac, SacConfig, SacNetwork};
use crate::online::{AgentConfig, OnlineAgent as _, Transitions};
use swm_nn::losses::Terms;
use swm_nn::params;

#[test]
fn sac_learns_as_the_reference() {
    let fixture = Fixture::open("sac");
    let config = SacConfig { hidden: [7, 5], lr: 0.01, ..SacConfig::paper() };
    let agent = AgentConfig {
        agent: "sac".to_owned(),
        preset: "paper".to_owned(),
        settings: json!(null),
        observation_dim: 3,
        image: None,
        action_dim: 2,
        seed: 0,
    };
    let network = fixture.load(&SacNetwork::new([3, 2], config.hidden, &fixture.device), "weights");
    let mut sac = Sac::with(agent, config, network.clone(), fixture.device.clone());
    let values = |name: &str| fixture.values(&format!("inputs.{name}"));
    let clips = Transitions {
        rows: 6,
        steps: 2,
        observation: values("observation"),
        images: None,
        action: values("action"),
        reward: values("reward"),
        terminated: values("terminated"),
    };
    let batch = sac.minibatch(&clips).unwrap();
    let noise = fixture.tensor::<3>("inputs.noise");
    let noise = [0, 1].map(|part| noise.clone().narrow(0, part, 1).squeeze_dim::<2>(0));
    let temperature = network.temperature();
    let loss = |network: &SacNetwork, part: &str, batch: &Minibatch| -> Terms {
        let [now, next] = noise.clone();
        match part {
            "critic" => network.critic_loss(batch, temperature, 0.99, next),
            _ => network.actor_loss(batch, temperature, now),
        }
    };
    for part in ["critic", "actor"] {
        let tracked = params::track(&network, &[part]);
        let total = loss(&tracked, part, &batch).total;
        fixture.check_loss(part, &total);
        let gradients = params::gradients(&tracked, &mut total.backward());
        let mut compared = 0;
        for (spec, gradient) in params::specs(&tracked).iter().zip(gradients) {
            let Some(gradient) = gradient else { continue };
            let theirs = fixture.values(&format!("gradients.{}", spec.name));
            let scale = theirs.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
            let differs = worst(&params::to_host(spec, gradient), theirs);
            assert!(differs <= GRADIENT * scale, "gradient of {}: {differs} of {scale}", spec.name);
            compared += 1;
        }
        assert_eq!(compared, if part == "critic" { 12 } else { 8 });
    }

    sac.update_with(&batch, noise, 0).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    sac.save_weights(&path).unwrap();
    let stepped = swm_weights::read(&path).unwrap();
    let mut compared = 0;
    for (name, tensor) in stepped.iter().filter(|(name, _)| !name.starts_with("observation.")) {
        let differs = worst(&tensor.values, fixture.values(&format!("stepped.{name}")));
        assert!(differs < STEPPED, "{name} after an update: {differs}");
        compared += 1;
    }
    assert_eq!(compared, 8 + 12 + 12 + 1);
}
