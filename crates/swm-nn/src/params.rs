//! The tensors of a network by name: read them, replace them, follow their gradients.
//!
//! Names and layouts outside this file are PyTorch's, so that weights go both ways without tables: the weight of
//! a linear layer is `[out, in]`, and a layer of an `nn.Sequential` has its number. Inside, a linear weight is
//! `[in, out]`.

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param, ParamId};
use burn::tensor::{Device, Gradients, Tensor, TensorData};

/// One tensor of a network.
#[derive(Clone, Debug)]
pub struct Spec {
    /// Its name in PyTorch.
    pub name: String,
    /// Its shape in PyTorch.
    pub shape: Vec<usize>,
    /// The weight of a linear layer, which PyTorch holds the other way round.
    pub transposed: bool,
    /// The layer that it belongs to, and its name there.
    pub place: (&'static str, String),
    /// Whether it is part of a vision transformer.
    pub is_in_vit: bool,
    /// Its identity, which clones of the network share.
    pub id: ParamId,
}

impl Spec {
    /// Statistics of the data, which no optimizer touches.
    pub fn is_buffer(&self) -> bool {
        matches!(self.place.0, "Background" | "LatentMoments" | "LatentScale" | "RunningScale")
            || self.place.1.starts_with("running_")
    }

    /// Whether the name lies below one of these (`predictor`, or all for an empty one).
    pub fn is_below(&self, prefixes: &[&str]) -> bool {
        prefixes.iter().any(|prefix| {
            let rest = self.name.strip_prefix(prefix);
            rest.is_some_and(|rest| prefix.is_empty() || rest.starts_with('.') || rest.is_empty())
        })
    }
}

/// What fields of layers are called in PyTorch, where that is no name that Rust allows or that a reader would choose:
/// container, field, name there.
const NAMES: &[(&str, &str, &str)] = &[
    // Written by every run: weights keep this name.
    ("Background", "std", "deviation"),
    ("FeedForward", "norm", "net.0"),
    ("FeedForward", "up", "net.1"),
    ("FeedForward", "down", "net.4"),
    ("Attention", "to_out", "to_out.0"),
    ("ConditionalBlock", "modulation", "adaLN_modulation.1"),
    ("Mlp", "up", "net.0"),
    ("Mlp", "norm", "net.1"),
    ("Mlp", "down", "net.3"),
    ("InverseDynamics", "up", "net.0"),
    ("InverseDynamics", "norm", "net.1"),
    ("InverseDynamics", "down", "net.3"),
    ("ActionEmbedder", "up", "embed.0"),
    ("ActionEmbedder", "down", "embed.2"),
    ("AttentionPair", "attention", "0"),
    ("AttentionPair", "feed_forward", "1"),
    ("ConvJepa", "inverse", "idm"),
    ("Lewm", "model", ""),
    ("Lewm", "inverse", "idm"),
    ("Pldm", "model", ""),
    ("Pldm", "inverse", "idm"),
    ("Gcbc", "observer", ""),
    ("ValueLearner", "observer", ""),
    ("ValueLearner", "value", "value_predictor.student"),
    ("ValueLearner", "value_target", "value_predictor.teacher"),
    ("Gciql", "observer", ""),
    ("Gciql", "value", "value_predictor.student"),
    ("Gciql", "value_target", "value_predictor.teacher"),
    ("Gciql", "critic", "critic_predictor.student"),
    ("Gciql", "critic_target", "critic_predictor.teacher"),
    ("Observer", "proprio", "extra_encoders.proprio"),
    ("FramePair", "attention", "0"),
    ("FramePair", "feed_forward", "1"),
    ("DinoWm", "encoder", "backbone"),
    ("DinoWm", "proprio", "extra_encoders.proprio"),
    ("DinoWm", "action", "extra_encoders.action"),
    ("GoalAttention", "to_out", "to_out.0"),
    ("Trunk", "first", "0"),
    ("Trunk", "second", "2"),
    ("Tdmpc2Network", "encoder", "extra_encoders.observation"),
    ("Tdmpc2Network", "images", ""),
    ("ImageEncoder", "convolutions", "cnn"),
    ("ImageEncoder", "output", "pixel_encoder"),
    ("ImageConvolutions", "first", "0"),
    ("ImageConvolutions", "second", "2"),
    ("ImageConvolutions", "third", "4"),
    ("ImageConvolutions", "fourth", "6"),
    ("StateEncoder", "hidden", "0"),
    ("StateEncoder", "output", "1"),
    ("StateEncoder", "norm", "2"),
    ("NormedLinear", "linear", ""),
    ("NormedLinear", "norm", "ln"),
    ("NormedMlp", "first", "0"),
    ("NormedMlp", "second", "1"),
    ("NormedMlp", "output", "2"),
    ("LatentMlp", "first", "0"),
    ("LatentMlp", "second", "1"),
    ("LatentMlp", "output", "2"),
    ("QHead", "first", "0"),
    ("QHead", "second", "2"),
    ("QHead", "third", "4"),
];

/// Where a visitor stands.
#[derive(Default)]
struct Path {
    /// Container and field, from the root on.
    stack: Vec<(&'static str, String)>,
}

impl Path {
    fn enter(&mut self, field: &str, container: &str) {
        let container = container.strip_prefix("Struct:").unwrap_or(container);
        let known = NAMES.iter().find(|(of, name, _)| *of == container && *name == field);
        let kept = known.map_or_else(|| kind(container), |(of, ..)| of);
        // The variants of an enum have no name of their own.
        let field = if container.starts_with("Enum:") { "" } else { field };
        self.stack.push((kept, known.map_or(field, |(.., name)| name).to_owned()));
    }

    fn exit(&mut self) {
        self.stack.pop();
    }

    fn spec(&self, id: ParamId, mut shape: Vec<usize>) -> Spec {
        let segments: Vec<&str> =
            self.stack.iter().map(|(_, name)| name.as_str()).filter(|name| !name.is_empty()).collect();
        let place = self.stack.last().cloned().unwrap_or(("", String::new()));
        let transposed = place.0 == "Linear" && place.1 == "weight";
        if transposed {
            shape.reverse();
        }
        let is_in_vit = self.stack.iter().any(|(container, _)| *container == "Vit");
        Spec { name: segments.join("."), shape, transposed, place, is_in_vit, id }
    }
}

/// The containers that matter to anybody.
fn kind(container: &str) -> &'static str {
    const KINDS: [&str; 9] = [
        "Linear",
        "Conv",
        "LayerNorm",
        "BatchNorm",
        "Background",
        "LatentMoments",
        "LatentScale",
        "RunningScale",
        "Vit",
    ];
    KINDS.iter().find(|kind| **kind == container).unwrap_or(&"")
}

/// What a network is computed on; it has a tensor.
pub fn device_of<M: Module>(module: &M) -> Device {
    let devices = module.devices();
    devices.first().cloned().expect("every network has a tensor")
}

/// All tensors of a network, in a fixed order.
pub fn specs<M: Module>(module: &M) -> Vec<Spec> {
    let mut specs = Vec::new();
    visit(module, |spec, _| specs.push(spec.clone()));
    specs
}

/// Calls `look` with each tensor, flat and in our layout.
pub fn visit<M: Module>(module: &M, look: impl FnMut(&Spec, Tensor<1>)) {
    struct Look<F> {
        path: Path,
        look: F,
    }
    impl<F: FnMut(&Spec, Tensor<1>)> ModuleVisitor for Look<F> {
        fn enter_module(&mut self, name: &str, container: &str) {
            self.path.enter(name, container);
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.exit();
        }
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let tensor = param.val();
            let spec = self.path.spec(param.id, tensor.dims().to_vec());
            (self.look)(&spec, tensor.flatten(0, D - 1));
        }
    }
    module.visit(&mut Look { path: Path::default(), look });
}

/// Replaces each tensor, which `change` gets and gives flat and in our layout.
pub fn map<M: Module>(module: M, change: impl FnMut(&Spec, Tensor<1>) -> Tensor<1>) -> M {
    struct Change<F> {
        path: Path,
        change: F,
    }
    impl<F: FnMut(&Spec, Tensor<1>) -> Tensor<1>> ModuleMapper for Change<F> {
        fn enter_module(&mut self, name: &str, container: &str) {
            self.path.enter(name, container);
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.exit();
        }
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let (id, tensor, _) = param.consume();
            let shape = tensor.dims();
            let spec = self.path.spec(id, shape.to_vec());
            let changed = (self.change)(&spec, tensor.flatten(0, D - 1));
            Param::initialized(id, changed.reshape(shape))
        }
    }
    module.map(&mut Change { path: Path::default(), change })
}

/// As [`map`]; `change` gets the tensor of `other` as well, a network of the same form.
pub fn map_both<M: Module>(
    module: M,
    other: &M,
    mut change: impl FnMut(&Spec, Tensor<1>, Tensor<1>) -> Tensor<1>,
) -> M {
    let mut others = Vec::new();
    visit(other, |_, tensor| others.push(tensor));
    let mut others = others.into_iter();
    map(module, |spec, tensor| change(spec, tensor, others.next().expect("networks of one form")))
}

/// A copy of the network whose tensors of these prefixes take part in differentiation; the others are constants.
pub fn track<M: Module>(module: &M, prefixes: &[&str]) -> M {
    struct Track<'a> {
        path: Path,
        prefixes: &'a [&'a str],
    }
    impl ModuleMapper for Track<'_> {
        fn enter_module(&mut self, name: &str, container: &str) {
            self.path.enter(name, container);
        }
        fn exit_module(&mut self, _name: &str, _container: &str) {
            self.path.exit();
        }
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let (id, tensor, _) = param.consume();
            let spec = self.path.spec(id, tensor.dims().to_vec());
            if spec.is_buffer() || !spec.is_below(self.prefixes) {
                return Param::initialized(id, tensor);
            }
            Param::initialized(id, tensor.autodiff().require_grad())
        }
    }
    module.clone().map(&mut Track { path: Path::default(), prefixes })
}

/// The gradients of a tracked network, flat and in our layout, in the order of [`specs`]; `None` where the loss
/// does not depend on a tensor or it was not tracked.
pub fn gradients<M: Module>(tracked: &M, gradients: &mut Gradients) -> Vec<Option<Tensor<1>>> {
    struct Collect<'a> {
        gradients: &'a mut Gradients,
        found: Vec<Option<Tensor<1>>>,
    }
    impl ModuleVisitor for Collect<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = param.val().grad_remove(self.gradients);
            self.found.push(gradient.map(|gradient| gradient.flatten(0, D - 1)));
        }
    }
    let mut collect = Collect { gradients, found: Vec::new() };
    tracked.visit(&mut collect);
    collect.found
}

/// The values of a flat tensor of our layout, in PyTorch's.
pub fn to_host(spec: &Spec, tensor: Tensor<1>) -> Vec<f32> {
    let tensor = match spec.shape[..] {
        [rows, columns] if spec.transposed => {
            tensor.reshape([columns, rows]).transpose().reshape([rows * columns])
        }
        _ => tensor,
    };
    host(tensor)
}

/// A flat tensor of our layout from values in PyTorch's, on the device of `like`.
pub fn from_host(spec: &Spec, values: Vec<f32>, like: &Tensor<1>) -> Tensor<1> {
    let device = like.device();
    let tensor = Tensor::<1>::from_data(TensorData::new(values, [like.dims()[0]]), &device);
    match spec.shape[..] {
        [rows, columns] if spec.transposed => {
            tensor.reshape([rows, columns]).transpose().reshape([rows * columns])
        }
        _ => tensor,
    }
}

/// The values of a tensor, row-major.
pub fn host<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.try_into_vec_as::<f32>().expect("tensors of the baselines hold 32-bit floats")
}
