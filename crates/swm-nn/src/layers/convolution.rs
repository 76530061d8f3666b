//! Convolutions with an activation on a CPU, forwards and backwards: images have their channels last, so that what a kernel
//! sees of a row is one piece of memory, and all kernels at all places of some images are one product of matrices.
//!
//! Burn's own convolution is for any shape, and its gradients are convolutions again: with it a training step of the
//! *small* encoder takes three times as long. It serves other devices, and the tests as an oracle.

use burn::backend::autodiff::checkpoint::base::Checkpointer;
use burn::backend::autodiff::checkpoint::strategy::CheckpointStrategy;
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::flex::FlexTensor;
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, DispatchDevice, Flex, backend_extension};
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;

use super::activation::Activation;
use crate::kernels::{Matrix, add_rows, multiply, product};

/// A square kernel that goes over images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Kernel {
    /// Its side, in pixels.
    pub size: usize,
    /// Pixels from one place to the next.
    pub stride: usize,
    /// Pixels of zeros around an image.
    pub padding: usize,
}

/// `[N, H, W, in]` images, weights `[K × K × in, out]` and a bias `[out]` → `[N, H', W', out]`, after the activation.
pub(crate) fn convolve(
    images: Tensor<4>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    kernel: Kernel,
    activation: Activation,
) -> Tensor<4> {
    if !matches!(images.device().inner().as_dispatch(), DispatchDevice::Flex(_)) {
        return convolve_anywhere(images, weight, bias, kernel, activation);
    }
    let [images, weight, bias] = [images.into_dispatch(), weight.into_dispatch(), bias.into_dispatch()];
    Tensor::from_dispatch(<Dispatch as Convolve>::convolve(images, weight, bias, kernel, activation))
}

/// The same by burn's own operations.
fn convolve_anywhere(
    images: Tensor<4>,
    weight: Tensor<2>,
    bias: Tensor<1>,
    kernel: Kernel,
    activation: Activation,
) -> Tensor<4> {
    let Kernel { size, stride, padding } = kernel;
    let [seen, outputs] = weight.dims();
    let weight = weight.reshape([size, size, seen / (size * size), outputs]).permute([3, 2, 0, 1]);
    let options = ConvOptions::new([stride; 2], [padding; 2], [1, 1], 1);
    activation.of(conv2d(images.permute([0, 3, 1, 2]), weight, Some(bias), options)).permute([0, 2, 3, 1])
}

#[backend_extension(Flex, Autodiff)]
trait Convolve: Backend {
    fn convolve(
        images: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        kernel: Kernel,
        activation: Activation,
    ) -> FloatTensor<Self>;
}

impl Convolve for Flex {
    fn convolve(
        images: FlexTensor,
        weight: FlexTensor,
        bias: FlexTensor,
        kernel: Kernel,
        activation: Activation,
    ) -> FlexTensor {
        let [images, weight, bias] = [images, weight, bias].map(|tensor| tensor.to_contiguous());
        let form = Form::new(&images, &weight, kernel);
        form.convolve(&images, &weight, &bias, |sum| activation.of_value(sum))
    }
}

/// The gradient of a convolution.
#[derive(Debug)]
struct Convolved;

/// Its settings.
#[derive(Clone, Debug)]
struct Seen {
    images: FlexTensor,
    weight: FlexTensor,
    /// Before the activation, or after it where that tells the slope.
    sums: FlexTensor,
    form: Form,
    activation: Activation,
}

impl<C: CheckpointStrategy> Convolve for Autodiff<Flex, C> {
    fn convolve(
        images: FloatTensor<Self>,
        weight: FloatTensor<Self>,
        bias: FloatTensor<Self>,
        kernel: Kernel,
        activation: Activation,
    ) -> FloatTensor<Self> {
        let ((images, of_images), (weight, of_weight), (bias, of_bias)) =
            (images.into_parts(), weight.into_parts(), bias.into_parts());
        let [images, weight, bias] = [images, weight, bias].map(|tensor| tensor.to_contiguous());
        let form = Form::new(&images, &weight, kernel);
        match Convolved.prepare::<C>([of_images, of_weight, of_bias]).compute_bound().stateful() {
            OpsKind::Tracked(ops) => {
                let (sums, outputs) = match activation {
                    Activation::Relu => {
                        let outputs = form.convolve(&images, &weight, &bias, |sum| activation.of_value(sum));
                        (outputs.clone(), outputs)
                    }
                    Activation::Mish => {
                        let sums = form.convolve(&images, &weight, &bias, |sum| sum);
                        let outputs = activation.of_all(values_of(&sums));
                        (sums, tensor(outputs, form.shape_out()))
                    }
                };
                ops.finish(Seen { images, weight, sums, form, activation }, outputs)
            }
            OpsKind::UnTracked(ops) => ops.finish(Flex::convolve(images, weight, bias, kernel, activation)),
        }
    }
}

impl Backward<Flex, 3> for Convolved {
    type State = Seen;

    fn backward(self, ops: Ops<Seen, 3>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let [images, weight, bias] = ops.parents;
        let given = gradients.consume::<Flex>(&ops.node).to_contiguous();
        let found = ops.state.gradients(&given, images.is_some());
        if let (Some(node), Some(gradient)) = (images, found.images) {
            gradients.register::<Flex>(node.id, gradient);
        }
        if let Some(node) = weight {
            gradients.register::<Flex>(node.id, found.weight);
        }
        if let Some(node) = bias {
            gradients.register::<Flex>(node.id, found.bias);
        }
    }
}

struct Found {
    images: Option<FlexTensor>,
    weight: FlexTensor,
    bias: FlexTensor,
}

impl Seen {
    /// Gradients where that of the outputs is `given`.
    fn gradients(&self, given: &FlexTensor, of_images: bool) -> Found {
        let Self { images, weight, sums, form, activation } = self;
        let mut back = vec![0.0; if of_images { values_of(images).len() } else { 0 }];
        let group = form.group() * form.values_in();
        let mut backs: Vec<&mut [f32]> = back.chunks_mut(group).collect();
        backs.resize_with(form.count.div_ceil(form.group()), || &mut []);
        let group_out = form.group() * form.values_out();
        let groups = values_of(sums).par_chunks(group_out).zip(values_of(given).par_chunks(group_out));
        let transposed = Matrix::of(weight).transposed();
        let parts: Vec<[Vec<f32>; 2]> = groups
            .zip(values_of(images).par_chunks(group))
            .zip(backs)
            .map(|(((sums, given), images), back)| {
                let passed = activation.pass_all_back(sums, given);
                let mut bias = vec![0.0; form.outputs];
                add_rows(&mut bias, &passed);
                let passed = Matrix::new(&passed, form.outputs);
                if !back.is_empty() {
                    form.add_patches(&product(passed, transposed), back);
                }
                let patches = form.patches(images);
                [product(Matrix::new(&patches, form.seen()).transposed(), passed), bias]
            })
            .collect();
        // In order: the same bits on any number of threads.
        let mut sums = (vec![0.0; form.seen() * form.outputs], vec![0.0; form.outputs]);
        for [weight, bias] in &parts {
            add(&mut sums.0, weight);
            add(&mut sums.1, bias);
        }
        let shape = [form.count, form.height, form.width, form.inputs];
        Found {
            images: of_images.then(|| tensor(back, shape)),
            weight: tensor(sums.0, [form.seen(), form.outputs]),
            bias: tensor(sums.1, [form.outputs]),
        }
    }
}

fn add(sums: &mut [f32], more: &[f32]) {
    sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

/// The most values in the patches of a group of images, unless one image has more: they stay in the cache of a core.
const GROUP: usize = 1 << 17;

/// Sizes of what goes in and out.
#[derive(Clone, Copy, Debug)]
struct Form {
    kernel: Kernel,
    count: usize,
    height: usize,
    width: usize,
    inputs: usize,
    rows: usize,
    columns: usize,
    outputs: usize,
}

impl Form {
    fn new(images: &FlexTensor, weight: &FlexTensor, kernel: Kernel) -> Self {
        let [count, height, width, inputs] = images.layout().shape().dims();
        let [_, outputs] = weight.layout().shape().dims();
        let places = |pixels: usize| (pixels + 2 * kernel.padding - kernel.size) / kernel.stride + 1;
        let (rows, columns) = (places(height), places(width));
        Self { kernel, count, height, width, inputs, rows, columns, outputs }
    }

    /// Values in the receptive field of a kernel.
    fn seen(&self) -> usize {
        self.kernel.size * self.kernel.size * self.inputs
    }

    /// The same at all places of an image.
    fn values_seen(&self) -> usize {
        self.rows * self.columns * self.seen()
    }

    /// Values of an image.
    fn values_in(&self) -> usize {
        self.height * self.width * self.inputs
    }

    /// Values of its output.
    fn values_out(&self) -> usize {
        self.rows * self.columns * self.outputs
    }

    fn shape_out(&self) -> [usize; 4] {
        [self.count, self.rows, self.columns, self.outputs]
    }

    /// `[N, H', W', out]`: what `after` makes of each kernel's sum at each place.
    fn convolve(
        &self,
        images: &FlexTensor,
        weight: &FlexTensor,
        bias: &FlexTensor,
        after: impl Fn(f32) -> f32 + Sync,
    ) -> FlexTensor {
        let (weight, bias) = (Matrix::of(weight), values_of(bias));
        let mut outputs = vec![0.0; self.count * self.values_out()];
        let groups = values_of(images).par_chunks(self.group() * self.values_in());
        groups.zip(outputs.par_chunks_mut(self.group() * self.values_out())).for_each(|(images, outputs)| {
            let patches = self.patches(images);
            multiply(Matrix::new(&patches, self.seen()), weight, Some(bias), outputs, |_, _, sums| {
                sums.iter_mut().for_each(|sum| *sum = after(*sum));
            });
        });
        tensor(outputs, self.shape_out())
    }

    /// Images of a group.
    fn group(&self) -> usize {
        (GROUP / self.values_seen()).max(1)
    }

    /// `[n, H, W, in]` → `[n × H' × W', K × K × in]`: what the kernel sees at each place.
    fn patches(&self, images: &[f32]) -> Vec<f32> {
        let places = images.len() / self.values_in() * self.rows * self.columns;
        let mut patches = vec![0.0; places * self.seen()];
        for (patches, image) in
            patches.chunks_exact_mut(self.values_seen()).zip(images.chunks_exact(self.values_in()))
        {
            self.each_run(|patch, image_at, length| {
                patches[patch..patch + length].copy_from_slice(&image[image_at..image_at + length]);
            });
        }
        patches
    }

    /// Adds what belongs to each place to the pixels that the kernel sees from there.
    fn add_patches(&self, patches: &[f32], images: &mut [f32]) {
        for (patches, image) in
            patches.chunks_exact(self.values_seen()).zip(images.chunks_exact_mut(self.values_in()))
        {
            self.each_run(|patch, image_at, length| {
                add(&mut image[image_at..image_at + length], &patches[patch..patch + length]);
            });
        }
    }

    /// Calls with each piece that patches and an image share: where it begins in both, and its length.
    fn each_run(&self, mut call: impl FnMut(usize, usize, usize)) {
        let Kernel { size, stride, padding } = self.kernel;
        let row = size * self.inputs;
        for place in 0..self.rows * self.columns {
            let patch = place * self.seen();
            let (top, left) = (place / self.columns * stride, place % self.columns * stride);
            // Of the kernel's columns, those that lie on the image.
            let first = padding.saturating_sub(left);
            let end = size.min((self.width + padding).saturating_sub(left)).max(first);
            for step in 0..size {
                let Some(y) = (top + step).checked_sub(padding).filter(|y| *y < self.height) else {
                    continue;
                };
                let at = (y * self.width + left + first - padding) * self.inputs;
                call(patch + step * row + first * self.inputs, at, (end - first) * self.inputs);
            }
        }
    }
}

fn values_of(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("contiguous 32-bit floats")
}

fn tensor<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

#[cfg(test)]
#[path = "convolution_tests.rs"]
mod tests;
