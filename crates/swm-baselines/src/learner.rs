//! One training step for every model, and the files of weights: a [`Network`] becomes a [`Baseline`].

use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use serde_json::{Map, Value as Json};

use crate::baseline::{
    Baseline, Canonicalizer, GoalPolicy, InputSpec, Losses, ModelConfig, Phase, PlanModel, Step,
};
use crate::data::{ClipBatch, Form, Inputs};
use crate::error::BaselineError;
use crate::network::{Network, Parts};
use crate::precision::Precision;
use crate::reading::{Reading, finite, read, read_all};
use crate::weights;
use swm_nn::Pass;
use swm_nn::init::initialize;
use swm_nn::optim::{AdamW, Gradients};
use swm_nn::params;
use swm_nn::placement::Placement;

/// A network, its optimizers, and its model config.
pub(crate) struct Learner<N> {
    name: &'static str,
    model_config: ModelConfig,
    input_spec: InputSpec,
    form: Form,
    phases: Vec<Phase>,
    /// `None` only while a step replaces it.
    network: Option<N>,
    /// The moving average of its weights, if it has one yet: what is validated, saved and used.
    average: Option<N>,
    /// One for each phase.
    optimizers: Vec<AdamW>,
    device: Device,
    precision: Precision,
    /// Of steps that nobody has asked for yet: they wait on the device.
    waiting: Vec<Reading>,
}

impl<N: Network> Learner<N> {
    /// Samples the initial weights, after checking the settings.
    pub(crate) fn new(
        name: &'static str,
        model_config: ModelConfig,
        parts: Parts<N>,
        device: Device,
    ) -> Result<Self, BaselineError> {
        let Parts { network, input_spec, form, phases } = parts;
        let wrong = |reason| BaselineError::Settings { baseline: name, reason };
        phases.iter().try_for_each(|phase| phase.optim.check()).map_err(wrong)?;
        if let Some(empty) = params::specs(&network).iter().find(|spec| spec.shape.contains(&0)) {
            let (layer, shape) = (&empty.name, &empty.shape);
            return Err(wrong(format!("`{layer}` would hold nothing, {shape:?}; some size is 0: raise it")));
        }
        let mut network = initialize(network, model_config.seed);
        for phase in &phases {
            network = follow(network, phase.targets, 0.0);
        }
        let optimizers = phases.iter().map(|_| AdamW::default()).collect();
        Ok(Self {
            name,
            model_config,
            input_spec,
            form,
            phases,
            network: Some(network),
            average: None,
            optimizers,
            device,
            precision: Precision::default(),
            waiting: Vec::new(),
        })
    }

    /// What is trained.
    pub(crate) fn network(&self) -> &N {
        self.network.as_ref().expect("a step gives the network back")
    }

    /// What is validated, saved and used.
    fn at_work(&self) -> &N {
        self.average.as_ref().unwrap_or_else(|| self.network())
    }

    /// The same, in the precision of computations.
    pub(crate) fn computing(&self) -> N {
        self.precision.copy_of(self.at_work())
    }

    /// Takes weights that were read.
    pub(crate) fn replace(&mut self, network: N) {
        (self.network, self.average) = (Some(network), None);
    }

    fn phase(&self, phase: usize) -> Result<&Phase, BaselineError> {
        self.phases.get(phase).ok_or_else(|| BaselineError::Settings {
            baseline: self.name,
            reason: format!("no phase {phase}; its training has {}", self.phases.len()),
        })
    }

    /// The network before its first step. A frozen encoder keeps the statistics that came with its weights.
    fn begun(&self, inputs: &Inputs) -> N {
        let begun = self.network().clone().begin(inputs);
        if !self.has_frozen_encoder() {
            return begun;
        }
        params::map_both(begun, self.network(), |spec, found, known| match spec.is_below(&[N::ENCODER]) {
            true => known,
            false => found,
        })
    }

    /// One step. It `waits` for the losses before it changes anything, or leaves them on the device.
    fn step(&mut self, batch: &ClipBatch<'_>, at: &Step, waits: bool) -> Result<Reading, BaselineError> {
        let phase = self.phase(at.phase)?.clone();
        let inputs = Inputs::new(batch, &self.form, &self.device)?;
        let mut pass = Pass::train_on(&self.device, at.seed, at.step);
        let is_first = (at.phase, at.step) == (0, 0);
        let begun = is_first.then(|| self.begun(&inputs));
        let tracked = params::track(begun.as_ref().unwrap_or_else(|| self.network()), phase.trains);
        let terms = self.precision.copy_of(&tracked).loss(at.phase, &inputs, &mut pass)?;
        let gradients = terms.total.is_tracked().then(|| terms.total.backward());
        let terms = terms.inner();
        let known = waits.then(|| read(&terms));
        if let Some(losses) = &known {
            finite(losses.total, at.step)?;
        }
        let gradients = gradients.map(|mut gradients| params::gradients(&tracked, &mut gradients));
        drop(tracked);
        let mut gradients = Gradients::new(gradients.unwrap_or_default());
        let norm = gradients.clip(phase.optim.clip);
        let lr = phase.optim.lr * phase.optim.schedule.factor(at.step, at.total);
        let reading = match known {
            Some(losses) => Reading::known(losses, norm, lr as f32, at.step)?,
            None => Reading::waiting(terms, norm, lr as f32, at.step),
        };
        let network = begun.or_else(|| self.network.take()).expect("a step gives the network back");
        let network = self.optimizers[at.phase].step(network, gradients, &phase.optim, lr);
        let network = follow_statistics(network, &pass);
        let network = follow(network, phase.targets, phase.momentum);
        self.average = phase.optim.ema_at(at.step).map(|decay| match self.average.take() {
            Some(average) => averaged(average, &network, phase.trains, decay),
            None => network.clone(),
        });
        self.network = Some(network);
        Ok(reading)
    }
}

impl<N: Network> Baseline for Learner<N> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn model_config(&self) -> &ModelConfig {
        &self.model_config
    }

    fn input_spec(&self) -> &InputSpec {
        &self.input_spec
    }

    fn phases(&self) -> &[Phase] {
        &self.phases
    }

    fn parameters(&self) -> usize {
        let trained = |name: &params::Spec| self.phases.iter().any(|phase| name.is_below(phase.trains));
        let specs = params::specs(self.network());
        specs
            .iter()
            .filter(|spec| !spec.is_buffer() && trained(spec))
            .map(|spec| spec.shape.iter().product::<usize>())
            .sum()
    }

    fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        params::specs(self.network()).into_iter().map(|spec| (spec.name, spec.shape)).collect()
    }

    fn has_frozen_encoder(&self) -> bool {
        let is_trained = |spec: &params::Spec| self.phases.iter().any(|phase| spec.is_below(phase.trains));
        let specs = params::specs(self.network());
        let mut encoder = specs.iter().filter(|spec| spec.is_below(&[N::ENCODER])).peekable();
        encoder.peek().is_some() && !encoder.any(is_trained)
    }

    fn trains_on_latents(&self) -> bool {
        N::TRAINS_ON_LATENTS
    }

    fn learns_canonical(&self) -> bool {
        N::LEARNS_CANONICAL
    }

    fn canonicalizer(&self) -> Option<Box<dyn Canonicalizer>> {
        self.computing().canonicalizer(&self.form)
    }

    fn set_precision(&mut self, precision: Precision) {
        self.precision = precision;
    }

    fn train_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Losses, BaselineError> {
        let reading = self.step(batch, at, true)?;
        Ok(read_all(vec![reading])?.swap_remove(0))
    }

    fn start_step(&mut self, batch: &ClipBatch<'_>, at: &Step) -> Result<Option<Losses>, BaselineError> {
        if Placement::of(&self.device) == Placement::Host {
            return self.train_step(batch, at).map(Some);
        }
        let reading = self.step(batch, at, false)?;
        self.waiting.push(reading);
        Ok(None)
    }

    fn take_losses(&mut self) -> Result<Vec<Losses>, BaselineError> {
        read_all(std::mem::take(&mut self.waiting))
    }

    fn validate(&self, batch: &ClipBatch<'_>, phase: usize) -> Result<Losses, BaselineError> {
        self.phase(phase)?;
        let inputs = Inputs::new(batch, &self.form, &self.device)?;
        Ok(read(&self.computing().loss(phase, &inputs, &mut Pass::evaluate())?))
    }

    fn estimate_statistics(
        &mut self,
        batch: &ClipBatch<'_>,
        phase: usize,
        before: u64,
    ) -> Result<(), BaselineError> {
        self.phase(phase)?;
        let inputs = Inputs::new(batch, &self.form, &self.device)?;
        let mut pass = Pass::statistics(before);
        self.computing().loss(phase, &inputs, &mut pass)?;
        let of = if self.average.is_some() { &mut self.average } else { &mut self.network };
        *of = of.take().map(|network| follow_statistics(network, &pass));
        Ok(())
    }

    fn save_weights(&self, path: &Path) -> Result<(), BaselineError> {
        weights::save_network(self.at_work(), path)
    }

    fn load_weights(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.network = Some(weights::load_network(self.network(), path)?);
        self.average = None;
        Ok(())
    }

    fn load_for_use(&mut self, path: &Path, encoder: Option<&Path>) -> Result<Vec<String>, BaselineError> {
        let elsewhere = encoder.map(|_| N::ENCODER);
        let dispensable: Vec<&str> = N::DISPENSABLE.iter().copied().chain(elsewhere).collect();
        let (mut network, mut lacks) = weights::load_for_use(self.network(), path, &dispensable)?;
        if let Some(encoder) = encoder {
            network = weights::load_below(&network, encoder, N::ENCODER)?;
            lacks.retain(|name| name.strip_prefix(N::ENCODER).is_none_or(|rest| !rest.starts_with('.')));
        }
        (self.network, self.average) = (Some(network), None);
        Ok(lacks)
    }

    fn load_encoder(&mut self, path: &Path) -> Result<(), BaselineError> {
        self.network = Some(weights::load_below(self.network(), path, N::ENCODER)?);
        self.average = None;
        Ok(())
    }

    fn save_training(&self, path: &Path) -> Result<(), BaselineError> {
        let mut tensors = Vec::new();
        for (phase, optimizer) in self.phases.iter().zip(&self.optimizers) {
            for (name, shape, values) in optimizer.to_host(self.network()) {
                tensors.push((format!("{}.{name}", phase.name), shape, values));
            }
        }
        if self.average.is_some() {
            params::visit(self.network(), |spec, tensor| {
                let values = params::to_host(spec, tensor);
                tensors.push((format!("{ONLINE}.{}", spec.name), spec.shape.clone(), values));
            });
        }
        Ok(swm_weights::write(path, tensors)?)
    }

    fn load_training(&mut self, path: &Path) -> Result<(), BaselineError> {
        let mut tensors = swm_weights::read(path)?;
        let network = self.network.as_ref().expect("a step gives the network back");
        for (phase, optimizer) in self.phases.iter().zip(&mut self.optimizers) {
            *optimizer = AdamW::from_host(network, |name, count| {
                let name = format!("{}.{name}", phase.name);
                tensors.get(&name).filter(|tensor| tensor.values.len() == count)?;
                tensors.remove(&name).map(|tensor| tensor.values)
            });
        }
        let mut online = 0;
        let trained = params::map(network.clone(), |spec, average| {
            let stored = tensors.remove(&format!("{ONLINE}.{}", spec.name));
            let Some(stored) = stored.filter(|stored| stored.shape == spec.shape) else { return average };
            online += 1;
            params::from_host(spec, stored.values, &average)
        });
        if online > 0 {
            self.average = self.network.replace(trained);
        }
        if let Some(name) = tensors.keys().next() {
            let reason = format!(
                "the file holds `{name}`, which is no state of this model's optimizers; it is of another run"
            );
            return Err(BaselineError::weights(path, reason));
        }
        Ok(())
    }

    fn planner(&self) -> Option<Box<dyn PlanModel>> {
        self.computing().planner()
    }

    fn plan_settings(&self) -> Map<String, Json> {
        self.network().plan_settings()
    }

    fn policy(&self) -> Option<Box<dyn GoalPolicy>> {
        self.computing().policy()
    }
}

/// What the names of weights begin with in the state of a training whose saved weights are their average.
const ONLINE: &str = "online";

/// The average of weights after a step: of what the phase trains by this decay, of all else as it is now.
fn averaged<N: Module>(average: N, network: &N, trains: &[&str], decay: f64) -> N {
    params::map_both(average, network, |spec, old, new| {
        if spec.is_buffer() || !spec.is_below(trains) {
            return new;
        }
        old * decay + new * (1.0 - decay)
    })
}

/// Puts the running statistics of a pass into their places.
pub(crate) fn follow_statistics<N: Module>(network: N, pass: &Pass) -> N {
    if pass.statistics.is_empty() {
        return network;
    }
    params::map(network, |spec, tensor| {
        let new = pass.statistics.iter().find(|(id, _)| *id == spec.id);
        new.map_or(tensor, |(_, value)| value.clone())
    })
}

/// Updates target networks by an exponential moving average with decay `momentum`.
pub(crate) fn follow<N: Module>(network: N, targets: &[(&str, &str)], momentum: f64) -> N {
    if targets.is_empty() {
        return network;
    }
    let mut found = std::collections::HashMap::new();
    params::visit(&network, |spec, tensor| {
        if targets.iter().any(|(online, _)| spec.is_below(&[online])) {
            found.insert(spec.name.clone(), tensor);
        }
    });
    params::map(network, |spec, tensor| {
        let online = targets.iter().find_map(|(online, target)| {
            let rest = spec.is_below(&[target]).then(|| &spec.name[target.len()..])?;
            found.get(&format!("{online}{rest}"))
        });
        match online {
            Some(online) if momentum == 0.0 => online.clone(),
            Some(online) => tensor * momentum + online.clone() * (1.0 - momentum),
            None => tensor,
        }
    })
}
