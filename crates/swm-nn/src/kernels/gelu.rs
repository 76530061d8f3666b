//! GELU, x Φ(x), with its derivative computed beside it.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::{Tensor, TensorData, activation};
use rayon::prelude::*;

use super::{TASK, is_ours, multiply_values, owned, values_mut, vector};

/// x Φ(x), where Φ is the normal distribution: the form with the error function, as PyTorch's default. Within 2⁻²¹ |x| of it on a
/// CPU.
pub(crate) fn gelu<const D: usize>(x: Tensor<D>) -> Tensor<D> {
    if !is_ours(&x) {
        return activation::gelu(x);
    }
    Tensor::from_dispatch(<Dispatch as GatedByNormal>::x_phi(x.into_dispatch()))
}

#[backend_extension(Flex, Autodiff)]
trait GatedByNormal: Backend {
    fn x_phi(x: FloatTensor<Self>) -> FloatTensor<Self>;
}

impl GatedByNormal for Flex {
    fn x_phi(x: FlexTensor) -> FlexTensor {
        let mut x = owned(x);
        values_mut(&mut x).par_chunks_mut(TASK).for_each(vector::gelu);
        x
    }
}

/// The gradient, from the derivatives.
#[derive(Debug)]
struct Gated;

impl<C: CheckpointStrategy> GatedByNormal for Autodiff<Flex, C> {
    fn x_phi(x: FloatTensor<Self>) -> FloatTensor<Self> {
        let (x, node) = x.into_parts();
        match Gated.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => {
                let mut derivatives = owned(x);
                let mut outputs = vec![0.0; derivatives.layout().num_elements()];
                let parts =
                    values_mut(&mut derivatives).par_chunks_mut(TASK).zip(outputs.par_chunks_mut(TASK));
                parts.for_each(|(x, outputs)| vector::gelu_and_derivative(x, outputs));
                let shape = derivatives.layout().shape().clone();
                ops.finish(derivatives, FlexTensor::from_data(TensorData::new(outputs, shape)))
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::x_phi(x)),
        }
    }
}

impl Backward<Flex, 1> for Gated {
    type State = FlexTensor;

    fn backward(self, ops: Ops<FlexTensor, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let [Some(parent)] = ops.parents else { return };
        let mut given = owned(gradients.consume::<Flex>(&ops.node));
        multiply_values(&mut given, &ops.state);
        gradients.register::<Flex>(parent.id, given);
    }
}
