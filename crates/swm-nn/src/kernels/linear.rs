//! Linear layers, with a GELU after them if that is what follows: it finds the values of the product in the cache of a core.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, backend_extension};
use burn::tensor::{Shape, Tensor, activation, module};
use rayon::prelude::*;

use super::product::{Matrix, as_matrix, multiply, product, rows_of_thread};
use super::{is_ours, multiply_values, owned, rows_of_task, tensor_of, values_of, vector};

/// What follows a linear layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Then {
    /// Nothing.
    Nothing,
    /// See [`gelu`](super::gelu).
    Gelu,
}

/// x W + b, and what follows: `[…, in]`, `[in, out]` and `[out]` → `[…, out]`.
pub(crate) fn linear<const D: usize>(
    x: Tensor<D>,
    weight: Tensor<2>,
    bias: Option<Tensor<1>>,
    then: Then,
) -> Tensor<D> {
    let is_empty = x.dims().contains(&0) || weight.dims().contains(&0);
    if D < 2 || is_empty || !(is_ours(&x) && is_ours(&weight) && bias.iter().all(is_ours)) {
        let out = module::linear(x, weight, bias);
        return if then == Then::Gelu { activation::gelu(out) } else { out };
    }
    let [x, weight] = [x.into_dispatch(), weight.into_dispatch()];
    Tensor::from_dispatch(match bias.map(Tensor::into_dispatch) {
        Some(bias) => <Dispatch as Project>::project(x, weight, bias, then),
        None => <Dispatch as Project>::project_without_bias(x, weight, then),
    })
}

#[backend_extension(Flex, Autodiff)]
trait Project: Backend {
    fn project(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        then: Then,
    ) -> FloatTensor<Self>;

    fn project_without_bias(x: FloatTensor<Self>, weight: FloatTensor<Self>, then: Then)
    -> FloatTensor<Self>;
}

impl Project for Flex {
    fn project(x: FlexTensor, weight: FlexTensor, bias: FlexTensor, then: Then) -> FlexTensor {
        let outputs = Product::of(&rows_of(&x), &weight, Some(&bias.to_contiguous()), then, false).outputs;
        reshaped(&outputs, like(&x, &weight))
    }

    fn project_without_bias(x: FlexTensor, weight: FlexTensor, then: Then) -> FlexTensor {
        reshaped(&Product::of(&rows_of(&x), &weight, None, then, false).outputs, like(&x, &weight))
    }
}

/// The gradient.
#[derive(Debug)]
struct Projected;

/// What it needs.
#[derive(Clone, Debug)]
struct Seen {
    shape: Shape,
    /// `[R, in]`.
    x: FlexTensor,
    weight: FlexTensor,
    /// Of what followed: `[R, out]`.
    derivatives: Option<FlexTensor>,
}

impl<C: CheckpointStrategy> Project for Autodiff<Flex, C> {
    fn project(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        then: Then,
    ) -> FloatTensor<Self> {
        let ((x, of_x), (weight, of_weight), (bias, of_bias)) =
            (x.into_parts(), weight.into_parts(), bias.into_parts());
        match Projected.prepare::<C>([of_x, of_weight, of_bias]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => {
                let (seen, outputs) = Seen::forward(&x, weight, Some(&bias.to_contiguous()), then);
                ops.finish(seen, outputs)
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::project(x, weight, bias, then)),
        }
    }

    fn project_without_bias(
        x: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        then: Then,
    ) -> FloatTensor<Self> {
        let ((x, of_x), (weight, of_weight)) = (x.into_parts(), weight.into_parts());
        match Projected.prepare::<C>([of_x, of_weight]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => {
                let (seen, outputs) = Seen::forward(&x, weight, None, then);
                ops.finish(seen, outputs)
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::project_without_bias(x, weight, then)),
        }
    }
}

/// With a bias among the parents, and without.
impl<const N: usize> Backward<Flex, N> for Projected {
    type State = Seen;

    fn backward(self, ops: Ops<Seen, N>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let mut given = owned(gradients.consume::<Flex>(&ops.node));
        let Seen { shape, x, weight, derivatives } = ops.state;
        if let Some(derivatives) = derivatives {
            multiply_values(&mut given, &derivatives);
        }
        let given = rows_of(&given);
        for (index, parent) in ops.parents.into_iter().enumerate() {
            let Some(parent) = parent else { continue };
            let gradient = match index {
                0 => {
                    let back = Product::of(&given, &weight.transpose(0, 1), None, Then::Nothing, false);
                    reshaped(&back.outputs, shape.clone())
                }
                1 => {
                    let [x, given] = [&x, &given].map(Matrix::of);
                    tensor_of(product(x.transposed(), given), weight.layout().shape().dims::<2>())
                }
                _ => sum_of_rows(&given),
            };
            gradients.register::<Flex>(parent.id, gradient);
        }
    }
}

impl Seen {
    fn forward(
        x: &FlexTensor,
        weight: FlexTensor,
        bias: Option<&FlexTensor>,
        then: Then,
    ) -> (Self, FlexTensor) {
        let rows = rows_of(x);
        let Product { outputs, derivatives } = Product::of(&rows, &weight, bias, then, true);
        let outputs = reshaped(&outputs, like(x, &weight));
        (Self { shape: x.layout().shape().clone(), x: rows, weight, derivatives }, outputs)
    }
}

struct Product {
    /// `[R, out]`.
    outputs: FlexTensor,
    /// The derivatives of what follows, `[R, out]`, if they were asked for and are not 1.
    derivatives: Option<FlexTensor>,
}

impl Product {
    /// Of x, `[R, in]`, and W, `[in, out]`, with what follows.
    fn of(
        x: &FlexTensor,
        weight: &FlexTensor,
        bias: Option<&FlexTensor>,
        then: Then,
        with_derivatives: bool,
    ) -> Self {
        let weight = as_matrix(weight.clone());
        let ([rows, inputs], [_, width]) = (x.layout().shape().dims(), weight.layout().shape().dims());
        let (x, weight, bias) = (Matrix::of(x), Matrix::of(&weight), bias.map(values_of));
        let group = rows_of_thread(rows, inputs * width);
        let mut outputs = vec![0.0; rows * width];
        let has_derivatives = with_derivatives && then == Then::Gelu;
        let mut derivatives = vec![0.0; if has_derivatives { rows * width } else { 0 }];
        let mut of_groups: Vec<&mut [f32]> = derivatives.chunks_mut(group * width).collect();
        of_groups.resize_with(rows.div_ceil(group), || &mut []);
        let parts = outputs.par_chunks_mut(group * width).zip(of_groups).enumerate();
        parts.for_each(|(index, (outputs, derivatives))| {
            let x = x.rows_from(index * group);
            match then {
                Then::Nothing => multiply(x, weight, bias, outputs, |_, _, _| ()),
                Then::Gelu if has_derivatives => {
                    multiply(x, weight, bias, derivatives, |row, column, values| {
                        let at = row * width + column;
                        vector::gelu_and_derivative(values, &mut outputs[at..at + values.len()]);
                    });
                }
                Then::Gelu => multiply(x, weight, bias, outputs, |_, _, values| vector::gelu(values)),
            }
        });
        Self {
            outputs: tensor_of(outputs, [rows, width]),
            derivatives: has_derivatives.then(|| tensor_of(derivatives, [rows, width])),
        }
    }
}

/// The sum of all rows of `[R, W]`: `[W]`.
fn sum_of_rows(tensor: &FlexTensor) -> FlexTensor {
    let [_, width] = tensor.layout().shape().dims();
    let parts = values_of(tensor).par_chunks(rows_of_task(width) * width);
    let parts: Vec<Vec<f32>> = parts
        .map(|rows| {
            let mut sum = vec![0.0; width];
            vector::add_rows(&mut sum, rows);
            sum
        })
        .collect();
    // In order: the same bits on any number of threads.
    let mut sum = vec![0.0; width];
    parts.iter().for_each(|part| vector::add_rows(&mut sum, part));
    tensor_of(sum, [width])
}

/// `[…, W]` → `[R, W]`, contiguous.
fn rows_of(tensor: &FlexTensor) -> FlexTensor {
    let shape = tensor.layout().shape();
    let width = shape[shape.num_dims() - 1];
    reshaped(&tensor.to_contiguous(), Shape::new([shape.num_elements() / width, width]))
}

/// The shape of x W.
fn like(x: &FlexTensor, weight: &FlexTensor) -> Shape {
    let [_, outputs] = weight.layout().shape().dims();
    let mut shape = x.layout().shape().clone();
    let last = shape.num_dims() - 1;
    shape[last] = outputs;
    shape
}

/// A contiguous tensor in another shape of as many values.
fn reshaped(tensor: &FlexTensor, shape: Shape) -> FlexTensor {
    tensor.reshape(shape)
}
