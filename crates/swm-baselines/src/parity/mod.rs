//! The networks compared with PyTorch's: outputs, losses, gradients, and weights after a step, on fixtures that
//! `tests/parity/make_fixtures.py` makes. Dims are tiny; the paper's networks are the same code with other sizes.

mod dino;
mod encoders;
mod goal;
mod joint;
mod sac;
mod tdmpc2;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};

use swm_solvers::{Candidates, Outputs};

use crate::baseline::PlanModel;
use crate::learner::follow_statistics;
use crate::weights;
use swm_nn::Pass;
use swm_nn::losses::Terms;
use swm_nn::optim::{AdamW, Gradients, OptimConfig};
use swm_nn::params::{self, host};

/// Greatest difference of an output.
const OUTPUT: f32 = 1e-4;
/// Greatest relative difference of a loss.
const LOSS: f32 = 1e-5;
/// Greatest difference of a gradient, relative to the greatest gradient of the same tensor.
const GRADIENT: f32 = 1e-3;
/// Greatest difference of a weight after a step.
const STEPPED: f32 = 1e-5;

/// A file of `tests/parity`.
fn fixture_path(file: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/parity").join(file)
}

/// A fixture.
struct Fixture {
    tensors: BTreeMap<String, swm_weights::Stored>,
    device: Device,
}

impl Fixture {
    fn open(name: &str) -> Self {
        Self::read(&fixture_path(&format!("{name}.safetensors")))
    }

    fn read(path: &Path) -> Self {
        let tensors = swm_weights::read(path).unwrap_or_else(|error| panic!("{error}"));
        let ours = |name: String| match name.split_once('.') {
            Some((section @ ("gradients" | "stepped"), name)) => format!("{section}.{}", weights::ours(name)),
            _ => name,
        };
        let tensors = tensors.into_iter().map(|(name, tensor)| (ours(name), tensor)).collect();
        Self { tensors, device: Device::flex() }
    }

    fn values(&self, name: &str) -> &[f32] {
        &self.tensors[name].values
    }

    fn shape(&self, name: &str) -> &[usize] {
        &self.tensors[name].shape
    }

    fn tensor<const D: usize>(&self, name: &str) -> Tensor<D> {
        let swm_weights::Stored { shape, values, .. } = &self.tensors[name];
        Tensor::from_data(TensorData::new(values.clone(), shape.clone()), &self.device)
    }

    /// The network with the weights of a section, by the way that files of weights take.
    fn load<M: Module>(&self, network: &M, section: &str) -> M {
        let folder = tempfile::tempdir().expect("a folder for weights");
        let path = folder.path().join("weights.safetensors");
        let prefix = format!("{section}.");
        let tensors = self.tensors.iter().filter_map(|(name, tensor)| {
            let name = name.strip_prefix(&prefix)?;
            Some((name.to_owned(), tensor.shape.clone(), tensor.values.clone()))
        });
        swm_weights::write(&path, tensors.collect()).expect("weights can be written");
        weights::load_network(network, &path).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Compares an output value by value, and gives the greatest difference.
    fn check<const D: usize>(&self, name: &str, output: Tensor<D>) -> f32 {
        assert_eq!(output.dims().as_slice(), self.shape(name), "{name}");
        let worst = worst(&host(output), self.values(name));
        assert!(worst < OUTPUT, "{name} differs by {worst}");
        worst
    }

    /// Compares losses.
    fn check_losses(&self, terms: &Terms) {
        let mut losses = vec![("total", terms.total.clone())];
        losses.extend(terms.parts.iter().cloned());
        losses.iter().for_each(|(name, loss)| self.check_loss(name, loss));
    }

    /// Compares one loss.
    fn check_loss(&self, name: &str, loss: &Tensor<1>) {
        let (ours, theirs) = (host(loss.clone())[0], self.values(&format!("outputs.{name}"))[0]);
        assert!((ours - theirs).abs() <= LOSS * theirs.abs(), "{name}: {ours} instead of {theirs}");
    }

    /// Compares costs of candidates, and their gradients; costs alone are the same.
    fn check_costs(&self, planner: &mut dyn PlanModel, candidates: &Candidates<'_>, name: &str) {
        let mut costs = vec![0.0; candidates.episodes * candidates.samples];
        let mut gradient = vec![0.0; candidates.actions.len()];
        let outputs = &mut Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut costs) };
        planner.evaluate(candidates, outputs).expect("candidates fit");
        let theirs = self.values(name).iter().map(|cost| f64::from(*cost));
        for (ours, theirs) in costs.iter().zip(theirs) {
            assert!((ours - theirs).abs() < f64::from(LOSS) * theirs.abs(), "{ours} instead of {theirs}");
        }
        let theirs = self.values(&format!("{name}_gradient"));
        let scale = theirs.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
        assert!(worst(&gradient, theirs) < GRADIENT * scale, "{name}");

        let mut again = vec![0.0; costs.len()];
        planner.evaluate(candidates, &mut Outputs::new(&mut again)).expect("candidates fit");
        let close = |(a, b): (&f64, &f64)| (a - b).abs() <= f64::from(LOSS) * b.abs();
        assert!(again.iter().zip(&costs).all(close), "{again:?} {costs:?}");
    }

    /// Compares the gradients of a tracked network, and gives their number.
    fn check_gradients<N: Module>(&self, tracked: &N, loss: &Tensor<1>) -> usize {
        let gradients = params::gradients(tracked, &mut loss.backward());
        let of_all = self.tensors.iter().filter(|(name, _)| name.starts_with("gradients."));
        let greatest =
            of_all.flat_map(|(_, tensor)| &tensor.values).fold(0.0_f32, |most, value| most.max(value.abs()));
        let mut compared = 0;
        for (spec, gradient) in params::specs(tracked).iter().zip(gradients) {
            let Some(theirs) = self.tensors.get(&format!("gradients.{}", spec.name)) else { continue };
            let gradient = gradient.unwrap_or_else(|| panic!("no gradient of {}", spec.name));
            let scale = theirs.values.iter().fold(0.0_f32, |most, value| most.max(value.abs()));
            let worst = worst(&params::to_host(spec, gradient), &theirs.values);
            // Before a batch norm a bias changes nothing: its gradient is what rounding leaves, here and there.
            let is_rounding = spec.name.ends_with("bias") && scale < 1e-4 * greatest;
            assert!(
                is_rounding || worst <= GRADIENT * scale,
                "gradient of {}: {worst} of {scale}",
                spec.name
            );
            compared += 1;
        }
        assert_eq!(compared, self.tensors.keys().filter(|name| name.starts_with("gradients.")).count());
        compared
    }

    /// Takes a step along PyTorch's gradients, clipped as PyTorch does, and compares all weights.
    fn check_step<N: Module>(&self, network: N, pass: &Pass) {
        let mut gradients = Vec::new();
        params::visit(&network, |spec, tensor| {
            let theirs = self.tensors.get(&format!("gradients.{}", spec.name));
            gradients.push(theirs.map(|theirs| params::from_host(spec, theirs.values.clone(), &tensor)));
        });
        let mut gradients = Gradients::new(gradients);
        let norm = gradients.clip(Some(0.5)).value();
        let expected = self.values("outputs.norm")[0];
        assert!(
            (norm - expected).abs() < 1e-5 * expected,
            "norm of the gradients: {norm} instead of {expected}"
        );
        let optim = OptimConfig { lr: 0.01, weight_decay: 0.1, ..OptimConfig::default() };
        let network = AdamW::default().step(network, gradients, &optim, optim.lr);
        let network = follow_statistics(network, pass);
        params::visit(&network, |spec, tensor| {
            let expected = self.values(&format!("stepped.{}", spec.name));
            let worst = worst(&params::to_host(spec, tensor), expected);
            assert!(worst < STEPPED, "{} after a step: {worst}", spec.name);
        });
    }
}

/// The greatest difference.
fn worst(ours: &[f32], theirs: &[f32]) -> f32 {
    assert_eq!(ours.len(), theirs.len());
    assert!(ours.iter().all(|value| value.is_finite()));
    ours.iter().zip(theirs).fold(0.0, |most, (ours, theirs)| most.max((ours - theirs).abs()))
}
