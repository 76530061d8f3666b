//! The factorizations of symmetric matrices that some solvers need, by faer. On one thread, and on copies that lie in
//! memory in the same way every time: so the same values always give the same bits.

use std::mem::MaybeUninit;

use faer::diag::DiagMut;
use faer::dyn_stack::{MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::{temp_mat_scratch, temp_mat_zeroed};
use faer::mat::{AsMatMut as _, MatMut, MatRef};
use faer::{Par, Spec};

use crate::error::PlanError;
use crate::problem::Problem;

/// The longest plan whose covariance is affordable.
const MAX_SIZE: usize = 1000;

/// Refuses plans whose covariance would be too large.
pub(crate) fn check_size(problem: &Problem<'_>) -> Result<(), PlanError> {
    let size = problem.plan_size();
    if size > MAX_SIZE {
        let reason = format!(
            "plans of {size} values have a covariance of {size} × {size}, which is too large (at most {MAX_SIZE}); \
             use a shorter horizon, or `cem`"
        );
        return Err(PlanError::setting("horizon", reason));
    }
    Ok(())
}

/// Values of stack that [`cholesky`] and [`eigen`] need for matrices of `size` × `size`.
pub(crate) fn stack_len(size: usize) -> usize {
    let square = temp_mat_scratch::<f64>(size, size);
    let cholesky = cholesky_in_place_scratch::<f64>(size, Par::Seq, Spec::default());
    let eigen = self_adjoint_evd_scratch::<f64>(size, ComputeEigenvectors::Yes, Par::Seq, Spec::default());
    let all = StackReq::all_of(&[square, square, StackReq::any_of(&[cholesky, eigen])]);
    all.unaligned_bytes_required().div_ceil(size_of::<f64>())
}

/// Replaces a symmetric `matrix`, `[n, n]`, by its lower Cholesky factor, column by column; what stands above the
/// diagonal has no meaning. False, and nothing is changed, if the matrix is not positive definite.
pub(crate) fn cholesky(matrix: &mut [f64], size: usize, stack: &mut [MaybeUninit<f64>]) -> bool {
    let mut matrix = MatMut::from_column_major_slice_mut(matrix, size, size);
    let (mut copy, stack) = temp_mat_zeroed::<f64, _, _>(size, size, MemStack::new_any(stack));
    let mut copy = copy.as_mat_mut();
    copy.copy_from(matrix.as_ref());
    let factorized =
        cholesky_in_place(copy.as_mut(), Default::default(), Par::Seq, stack, Spec::default()).is_ok();
    if factorized {
        matrix.copy_from(copy.as_ref());
    }
    factorized
}

/// Eigenvalues `[n]`, ascending, and eigenvectors `[n, n]`, one after the other, of a symmetric `matrix`, `[n, n]`.
/// False if they cannot be found, which takes values that are not finite.
pub(crate) fn eigen(
    matrix: &[f64],
    values: &mut [f64],
    vectors: &mut [f64],
    stack: &mut [MaybeUninit<f64>],
) -> bool {
    let size = values.len();
    let (mut copy, stack) = temp_mat_zeroed::<f64, _, _>(size, size, MemStack::new_any(stack));
    let (mut found, stack) = temp_mat_zeroed::<f64, _, _>(size, size, stack);
    let (mut copy, mut found) = (copy.as_mat_mut(), found.as_mat_mut());
    copy.copy_from(MatRef::from_column_major_slice(matrix, size, size));
    let diagonal = DiagMut::from_slice_mut(values);
    let solved =
        self_adjoint_evd(copy.as_ref(), diagonal, Some(found.as_mut()), Par::Seq, stack, Spec::default())
            .is_ok();
    MatMut::from_column_major_slice_mut(vectors, size, size).copy_from(found.as_ref());
    solved
}

#[cfg(test)]
mod tests {
    use rand_distr::{Distribution as _, StandardNormal};
    use swm_core::seed::keyed;

    use super::*;

    /// A symmetric, positive definite matrix.
    fn random(size: usize) -> Vec<f64> {
        let mut stream = keyed(size as u64, "matrix", [0, 0]);
        let root: Vec<f64> = (0..size * size).map(|_| StandardNormal.sample(&mut stream)).collect();
        let product =
            |i: usize, j: usize| (0..size).map(|k| root[i + k * size] * root[j + k * size]).sum::<f64>();
        let mut matrix: Vec<f64> = (0..size * size).map(|at| product(at % size, at / size)).collect();
        (0..size).for_each(|i| matrix[i + i * size] += 0.1);
        matrix
    }

    #[test]
    fn cholesky_factors_multiply_to_the_matrix() {
        for size in [1, 2, 7, 40, 130] {
            let (matrix, mut stack) = (random(size), vec![MaybeUninit::uninit(); stack_len(size)]);
            let mut factor = matrix.clone();
            assert!(cholesky(&mut factor, size, &mut stack));
            for i in 0..size {
                for j in 0..=i {
                    let product: f64 = (0..=j).map(|k| factor[i + k * size] * factor[j + k * size]).sum();
                    assert!((product - matrix[i + j * size]).abs() < 1e-9 * size as f64);
                }
            }
            let mut negative = matrix.clone();
            negative[size * size - 1] = -1.0;
            let before = negative.clone();
            assert!(!cholesky(&mut negative, size, &mut stack) && negative == before);
        }
    }

    #[test]
    fn eigenvectors_are_scaled_by_the_matrix() {
        for size in [1, 2, 7, 40, 130] {
            let (matrix, mut stack) = (random(size), vec![MaybeUninit::uninit(); stack_len(size)]);
            let (mut values, mut vectors) = (vec![0.0; size], vec![0.0; size * size]);
            assert!(eigen(&matrix, &mut values, &mut vectors, &mut stack));
            assert!(values.is_sorted() && values[0] > 0.0);
            for (value, vector) in values.iter().zip(vectors.chunks_exact(size)) {
                assert!((vector.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-9);
                for i in 0..size {
                    let image: f64 = (0..size).map(|j| matrix[i + j * size] * vector[j]).sum();
                    assert!((image - value * vector[i]).abs() < 1e-9 * size as f64);
                }
            }
        }
    }

    #[test]
    fn bits_do_not_depend_on_the_address() {
        let size = 21;
        let matrix = random(size);
        let mut results = Vec::new();
        for offset in 0..4 {
            let mut stack = vec![MaybeUninit::uninit(); stack_len(size) + offset];
            let mut moved = vec![0.0; offset];
            moved.extend_from_slice(&matrix);
            let (mut values, mut vectors) = (vec![0.0; size], vec![0.0; size * size]);
            assert!(eigen(&moved[offset..], &mut values, &mut vectors, &mut stack[offset..]));
            assert!(cholesky(&mut moved[offset..], size, &mut stack[offset..]));
            results.push((values, vectors, moved[offset..].to_vec()));
        }
        assert!(results.iter().all(|result| *result == results[0]));
    }
}
