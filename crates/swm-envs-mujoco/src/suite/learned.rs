//! `learned-expert`: an agent that was trained on a domain's task, and acts without planning.
//!
//! The weights are those of the policy of a `sac` run of `swm-baselines`, with Stable-Baselines3's names of tensors. They lie
//! in `learned/`, each with the command that trained it; `cargo xtask experts` makes the files.

use std::sync::Arc;

use safetensors::{Dtype, SafeTensors};
use swm_core::evaluate::sha256;
use swm_core::policy::write_action;
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _, SliceMut,
    SlotView,
};

/// Its name.
pub(super) const NAME: &str = "learned-expert";
/// Added to variances before their root, and the bound of standardized observations, as in `swm-baselines`.
const VARIANCE: f32 = 1e-8;
const CLIP: f32 = 10.0;

/// The entry of the policy for a domain of `TASKS`: `learned_expert!("cheetah", TASKS, "run")` has the weights of
/// `learned/cheetah.safetensors`, and is for the task `run`.
macro_rules! learned_expert {
    ($file:literal, $all:expr, $($task:literal),+) => {
        $crate::suite::learned::entry(|context, args| {
            let file = include_bytes!(concat!("suite/learned/", $file, ".safetensors"));
            $crate::suite::learned::make(file, &[$($task),+], $all[0].name, context, args)
        })
    };
}

pub(crate) use learned_expert;

swm_core::settings! {
    /// Arguments of the policy.
    struct Arguments {
        /// The first 12 digits of the weights' SHA-256, as results state them; other weights are refused.
        weights: Option<String> = None => "those of the program",
    }
}

/// As [`PolicyEntry::new`], with the name and the settings of the policy.
pub(crate) const fn entry(make: swm_core::registry::MakePolicy) -> PolicyEntry {
    PolicyEntry::new(NAME, "acts by a network that SAC trained on the task (also `expert:learned`)", make)
        .settings(Arguments::SETTINGS)
}

/// Makes the policy of a file of weights for the `tasks` that it was trained for; an environment whose settings name none has
/// the task `default`.
pub(crate) fn make(
    file: &[u8],
    tasks: &[&str],
    default: &str,
    context: &PolicyContext<'_>,
    args: &PolicyArgs,
) -> Result<Box<dyn Policy>, PolicyError> {
    let Arguments { weights } = args.parse_as()?;
    let sha256 = &sha256(file)[..12];
    if let Some(other) = weights.filter(|wanted| wanted != sha256) {
        return Err(args.wrong(format!("its weights are {sha256} in this version, not {other}")));
    }
    let task = context.config.settings.get("task").and_then(|task| task.as_str()).unwrap_or(default);
    if !tasks.contains(&task) {
        let known = tasks.join("` or `");
        let reason = format!(
            "it was trained for the task `{known}`, not for `{task}` (setting `task`); `expert` plans any task"
        );
        return Err(PolicyError::Unsupported { policy: NAME.to_owned(), reason });
    }
    let network = Network::read(file).map_err(|reason| args.wrong(format!("its weights: {reason}")))?;
    let network = Arc::new(network);
    Ok(Box::new(PerEpisode::new(format!("{NAME}:weights={sha256}"), move |_: &SlotView<'_>| {
        Ok(Box::new(Agent { network: Arc::clone(&network), layers: Default::default() }) as Box<dyn Actor>)
    })))
}

/// Two hidden layers with ReLU, and tanh of the mean action.
struct Network {
    /// `[O]`: mean of the observations, and the inverse of their std.
    mean: Vec<f32>,
    scale: Vec<f32>,
    layers: [Layer; 3],
}

struct Layer {
    /// `[in, out]`: a sum over inputs adds rows, whose order does not depend on how wide a vector register is.
    weight: Vec<f32>,
    /// `[out]`.
    bias: Vec<f32>,
}

impl Network {
    fn read(bytes: &[u8]) -> Result<Self, String> {
        let file = SafeTensors::deserialize(bytes).map_err(|error| error.to_string())?;
        let tensor = |name: &str| -> Result<(Vec<usize>, Vec<f32>), String> {
            let tensor = file.tensor(name).map_err(|error| error.to_string())?;
            if tensor.dtype() != Dtype::F32 {
                return Err(format!("`{name}` is {}, not F32", tensor.dtype()));
            }
            let (values, _) = tensor.data().as_chunks();
            Ok((tensor.shape().to_vec(), values.iter().copied().map(f32::from_le_bytes).collect()))
        };
        let layer = |name: &str, inputs: usize| {
            let (shape, weight) = tensor(&format!("{name}.weight"))?;
            let (_, bias) = tensor(&format!("{name}.bias"))?;
            if shape != [bias.len(), inputs] {
                return Err(format!("`{name}.weight` is {shape:?}, not [{}, {inputs}]", bias.len()));
            }
            let outputs = bias.len();
            let transposed = (0..inputs).flat_map(|i| (0..outputs).map(move |o| o * inputs + i));
            Ok(Layer { weight: transposed.map(|index| weight[index]).collect(), bias })
        };
        let (_, mean) = tensor("observation.running_mean")?;
        let (_, var) = tensor("observation.running_var")?;
        if mean.len() != var.len() {
            return Err(format!("{} means and {} variances", mean.len(), var.len()));
        }
        let first = layer("actor.latent_pi.0", mean.len())?;
        let second = layer("actor.latent_pi.2", first.bias.len())?;
        let action = layer("actor.mu", second.bias.len())?;
        let scale = var.iter().map(|var| 1.0 / (var + VARIANCE).sqrt()).collect();
        Ok(Self { mean, scale, layers: [first, second, action] })
    }

    /// `[O]` → `[A]` in [-1, 1], by way of `values`, one vector for each layer's input; the last holds the action.
    fn act<'a>(&self, values: &'a mut [Vec<f32>; 4]) -> &'a [f32] {
        for ((value, mean), scale) in values[0].iter_mut().zip(&self.mean).zip(&self.scale) {
            *value = ((*value - mean) * scale).clamp(-CLIP, CLIP);
        }
        for (index, layer) in self.layers.iter().enumerate() {
            let (before, after) = values.split_at_mut(index + 1);
            layer.forward(&before[index], &mut after[0]);
            let activation = |value: f32| if index < 2 { value.max(0.0) } else { value.tanh() };
            after[0].iter_mut().for_each(|value| *value = activation(*value));
        }
        &values[3]
    }
}

impl Layer {
    fn forward(&self, input: &[f32], output: &mut Vec<f32>) {
        output.clone_from(&self.bias);
        for (input, row) in input.iter().zip(self.weight.chunks_exact(self.bias.len())) {
            output.iter_mut().zip(row).for_each(|(output, weight)| *output += input * weight);
        }
    }
}

/// Acts in one episode.
struct Agent {
    network: Arc<Network>,
    layers: [Vec<f32>; 4],
}

impl Actor for Agent {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let observation =
            view.row.get::<f32>("observation").map_err(|error| PolicyError::Other(error.into()))?;
        let [input, ..] = &mut self.layers;
        input.clear();
        input.extend_from_slice(observation);
        write_action(&mut action, self.network.act(&mut self.layers));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use safetensors::serialize;
    use safetensors::tensor::TensorView;

    use super::*;

    /// A file of these tensors: name, shape, values.
    fn file(tensors: &[(&str, &[usize], &[f32])]) -> Vec<u8> {
        let bytes: Vec<Vec<u8>> = tensors
            .iter()
            .map(|(_, _, values)| values.iter().flat_map(|v| v.to_le_bytes()).collect())
            .collect();
        let views = tensors.iter().zip(&bytes).map(|((name, shape, _), bytes)| {
            (
                *name,
                TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("as many bytes as the shape says"),
            )
        });
        serialize(views, None).expect("it fits into memory")
    }

    fn tiny() -> Vec<(&'static str, &'static [usize], &'static [f32])> {
        vec![
            ("observation.running_mean", &[2], &[1.0, -2.0]),
            ("observation.running_var", &[2], &[4.0, 0.25]),
            ("actor.latent_pi.0.weight", &[3, 2], &[1.0, 0.0, 0.0, 1.0, -1.0, 0.5]),
            ("actor.latent_pi.0.bias", &[3], &[0.0, 0.5, 0.0]),
            ("actor.latent_pi.2.weight", &[2, 3], &[1.0, 2.0, 3.0, -1.0, 0.0, 0.0]),
            ("actor.latent_pi.2.bias", &[2], &[-1.0, 0.25]),
            ("actor.mu.weight", &[1, 2], &[0.25, 4.0]),
            ("actor.mu.bias", &[1], &[-0.5]),
        ]
    }

    #[test]
    fn a_network_is_computed_as_by_hand() {
        let network = Network::read(&file(&tiny())).unwrap();
        let act = |observation: [f32; 2]| {
            let mut values: [Vec<f32>; 4] = Default::default();
            values[0] = observation.to_vec();
            network.act(&mut values).to_vec()
        };
        // Standardized: (1, 2). First layer: (1, 2.5, 0). Second: (5, 0), as -0.75 is cut. Mean: 0.75.
        assert!((act([3.0, -1.0])[0] - 0.75f32.tanh()).abs() < 1e-6);
        // Far away, it is clipped to (-10, 10): (0, 10.5, 15), (65, 0.25), 16.75.
        assert!((act([-1e9, 1e9])[0] - 1.0).abs() < 1e-6);
    }

    #[test]
    fn damaged_weights_are_refused_by_name() {
        let message = |change: (usize, (&'static str, &'static [usize], &'static [f32]))| {
            let mut tensors = tiny();
            tensors[change.0] = change.1;
            Network::read(&file(&tensors)).err().unwrap_or_default()
        };
        assert!(message((6, ("actor.nu.weight", &[1, 2], &[0.0, 0.0]))).contains("actor.mu.weight"));
        let wrong = message((4, ("actor.latent_pi.2.weight", &[2, 2], &[0.0; 4])));
        assert_eq!(wrong, "`actor.latent_pi.2.weight` is [2, 2], not [2, 3]");
        assert_eq!(message((1, ("observation.running_var", &[1], &[1.0]))), "2 means and 1 variances");
        assert!(Network::read(b"no weights").is_err());
    }
}
