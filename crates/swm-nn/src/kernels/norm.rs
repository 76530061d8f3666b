//! Layer normalization over the last axis.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::{Tensor, TensorData, module};
use rayon::prelude::*;

use super::vector::{self, Affine};
use super::{is_ours, owned, rows_of_task, tensor_of, values_mut, values_of};

/// (x − mean) / √(variance + `epsilon`) × `scale` + `shift` over the last axis, with the biased variance: `[…, W]` → `[…, W]`.
/// `scale` and `shift` are `[W]`.
pub(crate) fn layer_norm<const D: usize>(
    x: Tensor<D>,
    scale: Tensor<1>,
    shift: Option<Tensor<1>>,
    epsilon: f64,
) -> Tensor<D> {
    let is_empty = x.dims().contains(&0);
    if is_empty || !(is_ours(&x) && is_ours(&scale) && shift.iter().all(is_ours)) {
        return module::layer_norm(x, scale, shift, epsilon);
    }
    let [x, scale] = [x.into_dispatch(), scale.into_dispatch()];
    let shift = shift.map(Tensor::into_dispatch);
    Tensor::from_dispatch(match shift {
        Some(shift) => <Dispatch as Normalize>::normalize(x, scale, shift, epsilon as f32),
        None => <Dispatch as Normalize>::normalize_plainly(x, scale, epsilon as f32),
    })
}

#[backend_extension(Flex, Autodiff)]
trait Normalize: Backend {
    fn normalize(
        x: FloatTensor<Self>,
        scale: FloatTensor<Self>,
        shift: FloatTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self>;

    fn normalize_plainly(x: FloatTensor<Self>, scale: FloatTensor<Self>, epsilon: f32) -> FloatTensor<Self>;
}

impl Normalize for Flex {
    fn normalize(x: FlexTensor, scale: FlexTensor, shift: FlexTensor, epsilon: f32) -> FlexTensor {
        forward(&x.to_contiguous(), &scale.to_contiguous(), Some(&shift.to_contiguous()), epsilon).0
    }

    fn normalize_plainly(x: FlexTensor, scale: FlexTensor, epsilon: f32) -> FlexTensor {
        forward(&x.to_contiguous(), &scale.to_contiguous(), None, epsilon).0
    }
}

/// Outputs, and the moments of each row.
fn forward(
    x: &FlexTensor,
    scale: &FlexTensor,
    shift: Option<&FlexTensor>,
    epsilon: f32,
) -> (FlexTensor, Vec<[f32; 2]>) {
    let (values, scale, shift) = (values_of(x), values_of(scale), shift.map(values_of));
    let width = scale.len();
    let mut moments = vec![[0.0; 2]; values.len() / width];
    let mut outputs = vec![0.0; values.len()];
    let rows = rows_of_task(width);
    let parts = values.par_chunks(rows * width).zip(outputs.par_chunks_mut(rows * width));
    parts.zip(moments.par_chunks_mut(rows)).for_each(|((values, outputs), moments)| {
        vector::layer_norm(values, Affine { scale, shift }, epsilon, moments, outputs);
    });
    (FlexTensor::from_data(TensorData::new(outputs, x.layout().shape().clone())), moments)
}

/// The gradient.
#[derive(Debug)]
struct Normalized;

/// What it needs.
#[derive(Clone, Debug)]
struct Seen {
    x: FlexTensor,
    scale: FlexTensor,
    moments: Vec<[f32; 2]>,
}

impl<C: CheckpointStrategy> Normalize for Autodiff<Flex, C> {
    fn normalize(
        x: FloatTensor<Self>,
        scale: FloatTensor<Self>,
        shift: FloatTensor<Self>,
        epsilon: f32,
    ) -> FloatTensor<Self> {
        let ((x, of_x), (scale, of_scale), (shift, of_shift)) =
            (x.into_parts(), scale.into_parts(), shift.into_parts());
        let [x, scale, shift] = [x, scale, shift].map(|tensor| tensor.to_contiguous());
        let (outputs, moments) = forward(&x, &scale, Some(&shift), epsilon);
        match Normalized.prepare::<C>([of_x, of_scale, of_shift]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => ops.finish(Seen { x, scale, moments }, outputs),
            OpsKind::UnTracked(ops) => ops.finish(outputs),
        }
    }

    fn normalize_plainly(x: FloatTensor<Self>, scale: FloatTensor<Self>, epsilon: f32) -> FloatTensor<Self> {
        let ((x, of_x), (scale, of_scale)) = (x.into_parts(), scale.into_parts());
        let [x, scale] = [x, scale].map(|tensor| tensor.to_contiguous());
        let (outputs, moments) = forward(&x, &scale, None, epsilon);
        match Normalized.prepare::<C>([of_x, of_scale]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => ops.finish(Seen { x, scale, moments }, outputs),
            OpsKind::UnTracked(ops) => ops.finish(outputs),
        }
    }
}

/// With a shift among the parents, and without.
impl<const N: usize> Backward<Flex, N> for Normalized {
    type State = Seen;

    fn backward(self, ops: Ops<Seen, N>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let given = owned(gradients.consume::<Flex>(&ops.node));
        for (parent, gradient) in ops.parents.into_iter().zip(ops.state.gradients(given)) {
            if let Some(parent) = parent {
                gradients.register::<Flex>(parent.id, gradient);
            }
        }
    }
}

impl Seen {
    /// Those of x, scale and shift where that of the outputs is `given`.
    fn gradients(&self, mut given: FlexTensor) -> [FlexTensor; 3] {
        let scale = values_of(&self.scale);
        let width = scale.len();
        let rows = rows_of_task(width);
        let parts = values_mut(&mut given).par_chunks_mut(rows * width);
        let parts = parts.zip(values_of(&self.x).par_chunks(rows * width)).zip(self.moments.par_chunks(rows));
        let sums: Vec<[Vec<f32>; 2]> = parts
            .map(|((given, x), moments)| {
                let mut sums = [vec![0.0; width], vec![0.0; width]];
                let [of_scale, of_shift] = &mut sums;
                vector::layer_norm_back(given, x, scale, moments, [of_scale, of_shift]);
                sums
            })
            .collect();
        // In order: the same bits on any number of threads.
        let [mut of_scale, mut of_shift] = [vec![0.0; width], vec![0.0; width]];
        for [scale, shift] in &sums {
            vector::add_rows(&mut of_scale, scale);
            vector::add_rows(&mut of_shift, shift);
        }
        [given, tensor_of(of_scale, [width]), tensor_of(of_shift, [width])]
    }
}
