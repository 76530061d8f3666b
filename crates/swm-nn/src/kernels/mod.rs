//! Operations of transformers on a CPU, forwards and backwards, each one pass over memory: attention, linear layers, GELU, layer
//! normalization, and the statistic of SIGReg. They are what layers call, on any device.
//!
//! Burn composes their gradients of elementary operations, and its exponentials and error functions are scalar: a training
//! step of LeWM's `paper` preset took half of its time there. The operations here are for 32-bit floats on burn's backend
//! `flex`; whatever else comes, on other devices and in other precisions, goes to burn's own operations, which also are what the
//! tests compare with.
//!
//! [`vector`] has the loops, [`product`](mod@product) the products of matrices, which convolutions use, too. The bits of an output depend on its own row,
//! not on threads, on other rows or on the CPU, if it has fused multiply-adds.

mod attention;
mod gelu;
mod linear;
mod norm;
mod product;
mod sigreg;
mod small_attention;
#[cfg(test)]
mod tests;
mod vector;

use burn::backend::DispatchDevice;
use burn::backend::flex::FlexTensor;
use burn::tensor::{DType, Tensor, TensorData};
use rayon::prelude::*;

pub(crate) use attention::attention;
pub(crate) use gelu::gelu;
pub(crate) use linear::{Then, linear};
pub(crate) use norm::layer_norm;
pub(crate) use product::{Matrix, multiply, product};
pub(crate) use sigreg::epps_pulley;
pub(crate) use vector::{add_rows, relu_back};

/// Whether the loops here are for this tensor.
fn is_ours<const D: usize>(tensor: &Tensor<D>) -> bool {
    tensor.dtype() == DType::F32 && matches!(tensor.device().inner().as_dispatch(), DispatchDevice::Flex(_))
}

/// Values that one task of a thread takes: about as long as ten times what it costs to start one.
const TASK: usize = 1 << 15;

/// Rows of so many values that one task takes. By the size of a row alone: sums of tasks do not depend on threads.
fn rows_of_task(width: usize) -> usize {
    (TASK / width.max(1)).max(1)
}

/// The values of a contiguous tensor.
fn values_of(tensor: &FlexTensor) -> &[f32] {
    tensor.as_slice().expect("contiguous 32-bit floats")
}

/// A tensor of these values.
fn tensor_of<const D: usize>(values: Vec<f32>, shape: [usize; D]) -> FlexTensor {
    FlexTensor::from_data(TensorData::new(values, shape))
}

/// The same tensor, which takes all of its memory: a copy of a view.
fn owned(tensor: FlexTensor) -> FlexTensor {
    let layout = tensor.layout();
    let is_whole = layout.is_contiguous()
        && layout.start_offset() == 0
        && tensor.bytes().len() == layout.num_elements() * size_of::<f32>();
    if is_whole { tensor } else { tensor.to_contiguous() }
}

/// Multiplies the values of an owned tensor by those of a contiguous one.
fn multiply_values(tensor: &mut FlexTensor, factors: &FlexTensor) {
    let parts = values_mut(tensor).par_chunks_mut(TASK).zip(values_of(factors).par_chunks(TASK));
    parts.for_each(|(values, factors)| vector::multiply(values, factors));
}

/// What scores of queries and keys of this dim are multiplied by: 1 / √E.
fn attention_scale(dim: usize) -> f32 {
    (1.0 / (dim as f64).sqrt()) as f32
}

/// The values of an owned tensor, to change; copied first if others see them.
fn values_mut(tensor: &mut FlexTensor) -> &mut [f32] {
    tensor.storage_mut()
}
