//! Products of matrices.
//!
//! A value is one chain of fused multiply-adds over the depth, in order, that begins with the bias. So its bits depend neither on
//! how a product is divided into tiles and threads, nor on other rows, nor on the CPU, as long as it fuses: all x86-64 CPUs with
//! AVX2 do, and all of aarch64. Older ones round twice.
//!
//! The right matrix is packed, some columns of it at a time, so that it stays in the second-level cache and tiles read it one
//! value after another; the left one is read as it is. A tile's sums stay in registers.

use burn::backend::flex::FlexTensor;
use multiversion::multiversion;
use multiversion::target::match_target;
use rayon::prelude::*;

/// Columns of a tile.
const COLUMNS: usize = 16;

/// Rows between two calls of what follows: a multiple of those of a tile on every CPU.
const ROWS: usize = 24;

/// Values of a chain that are added at once: a tile's part of the right matrix stays in the first-level cache.
const DEPTH: usize = 512;

/// Values of the right matrix that are packed at once: a part of the second-level cache.
const PACKED: usize = 3 << 14;

/// Of a left matrix by columns that are so many values from each other, few lines fit into the first-level cache: they share its sets.
const FAR: usize = 512;

/// A matrix as it lies in memory, by rows or by columns.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    /// From one row, and from one column, to the next. One of them is 1.
    strides: [usize; 2],
}

impl<'a> Matrix<'a> {
    /// Of rows one after another.
    pub(crate) fn new(values: &'a [f32], columns: usize) -> Self {
        Self { values, rows: values.len() / columns.max(1), columns, strides: [columns, 1] }
    }

    /// Of a tensor of two dims that [`is_matrix`].
    pub(crate) fn of(tensor: &'a FlexTensor) -> Self {
        let layout = tensor.layout();
        let [rows, columns] = layout.shape().dims();
        let values = &tensor.storage()[layout.start_offset()..];
        Self { values, rows, columns, strides: [0, 1].map(|axis| layout.strides()[axis] as usize) }
    }

    /// The same, mirrored.
    pub(crate) fn transposed(self) -> Self {
        let Self { values, rows, columns, strides: [down, right] } = self;
        Self { values, rows: columns, columns: rows, strides: [right, down] }
    }

    pub(super) fn rows_from(self, first: usize) -> Self {
        Self { values: &self.values[first * self.strides[0]..], rows: self.rows - first, ..self }
    }

    fn columns_from(self, first: usize) -> Self {
        Self { values: &self.values[first * self.strides[1]..], columns: self.columns - first, ..self }
    }
}

/// A tensor of two dims whose rows or columns are one piece of memory each: itself, or a copy.
pub(super) fn as_matrix(tensor: FlexTensor) -> FlexTensor {
    let strides = tensor.layout().strides();
    let is_matrix = strides.contains(&1) && strides.iter().all(|stride| *stride >= 0);
    if is_matrix { tensor } else { tensor.to_contiguous() }
}

/// A B: `[M, K]` and `[K, N]` → `[M, N]`, on all threads.
pub(crate) fn product(a: Matrix<'_>, b: Matrix<'_>) -> Vec<f32> {
    if a.strides[1] >= FAR && b.strides[0] < a.strides[1] && b.strides[1] == 1 {
        // The same values, mirrored.
        let out = product(b.transposed(), a.transposed());
        return mirrored(&out, a.rows);
    }
    let mut out = vec![0.0; a.rows * b.columns];
    let rows = rows_of_thread(a.rows, a.columns * b.columns);
    out.par_chunks_mut((rows * b.columns).max(1)).enumerate().for_each(|(index, out)| {
        multiply(a.rows_from(index * rows), b, None, out, |_, _, _| ());
    });
    out
}

/// The transposed of a matrix with so many columns.
fn mirrored(values: &[f32], columns: usize) -> Vec<f32> {
    let rows = values.len() / columns;
    let mut out = vec![0.0; values.len()];
    out.par_chunks_mut(rows * COLUMNS).enumerate().for_each(|(part, out)| {
        for (row, values) in values.chunks_exact(columns).enumerate() {
            for (out, value) in out[row..].iter_mut().step_by(rows).zip(&values[part * COLUMNS..]) {
                *out = *value;
            }
        }
    });
    out
}

/// Rows of which a thread computes so many products each.
pub(super) fn rows_of_thread(rows: usize, products: usize) -> usize {
    /// What is not worth a task.
    const FEW: usize = 1 << 18;
    let least = (FEW / products.max(1)).max(1);
    rows.div_ceil(rayon::current_num_threads()).max(least).next_multiple_of(ROWS)
}

/// A B, plus a bias to each row, into `out`, as many rows as it has, and what follows: `after` gets each piece of a row, with its row and
/// its first column, while the piece is in the cache.
pub(crate) fn multiply(
    a: Matrix<'_>,
    b: Matrix<'_>,
    bias: Option<&[f32]>,
    out: &mut [f32],
    mut after: impl FnMut(usize, usize, &mut [f32]),
) {
    let (depth, width) = (a.columns, b.columns);
    if out.is_empty() {
        return;
    }
    let zeros;
    let bias = if let Some(bias) = bias {
        bias
    } else {
        zeros = vec![0.0; width];
        &zeros
    };
    let most = depth.div_ceil(depth.div_ceil(DEPTH).max(1)).max(1);
    let block = (PACKED / most / COLUMNS * COLUMNS).min(width.next_multiple_of(COLUMNS));
    let mut packed = vec![[0.0; COLUMNS]; block / COLUMNS * most];
    for column in (0..width).step_by(block) {
        let columns = block.min(width - column);
        // Once without any depth, too: then there is the bias alone.
        for from in (0..depth.max(1)).step_by(most) {
            let part = most.min(depth - from);
            let packed = &mut packed[..columns.div_ceil(COLUMNS) * part];
            pack(b.rows_from(from.min(b.rows)).columns_from(column), part, packed);
            let first = (from == 0).then(|| &bias[column..column + columns]);
            for (index, out) in out.chunks_mut(ROWS * width).enumerate() {
                let row = index * ROWS;
                let target = Target { count: out.len() / width, width, columns, column };
                strips(a.rows_from(row).columns_from(from), part, packed, first, out, target);
                if from + part == depth {
                    for (row, out) in (row..).zip(out.chunks_mut(width)) {
                        after(row, column, &mut out[column..column + columns]);
                    }
                }
            }
        }
    }
}

/// Copies the first rows of a matrix, as many as a tile takes of its columns each: `[tiles, depth, COLUMNS]`. What is beyond the
/// matrix is left as it is.
fn pack(b: Matrix<'_>, depth: usize, packed: &mut [[f32; COLUMNS]]) {
    let columns = b.columns.min(packed.len() / depth.max(1) * COLUMNS);
    if b.strides[1] == 1 {
        for row in 0..depth {
            let values = &b.values[row * b.strides[0]..][..columns];
            for (index, values) in values.chunks(COLUMNS).enumerate() {
                let place = &mut packed[index * depth + row];
                match values.first_chunk() {
                    Some(values) => *place = *values,
                    None => place[..values.len()].copy_from_slice(values),
                }
            }
        }
    } else {
        for column in 0..columns {
            let values = &b.values[column * b.strides[1]..][..depth];
            let places = &mut packed[column / COLUMNS * depth..][..depth];
            for (place, value) in places.iter_mut().zip(values) {
                place[column % COLUMNS] = *value;
            }
        }
    }
}

/// Where the values of strips go.
#[derive(Clone, Copy)]
struct Target {
    /// Rows.
    count: usize,
    /// Values of a row of the output.
    width: usize,
    /// Columns of the block, and the first of them.
    columns: usize,
    column: usize,
}

/// Rows of the product with packed columns; of the bias on, if this is the first part of the depth, or of what is there.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq+avx512bw+fma", "x86_64+avx2+fma"))]
fn strips(
    a: Matrix<'_>,
    depth: usize,
    packed: &[[f32; COLUMNS]],
    first: Option<&[f32]>,
    out: &mut [f32],
    target: Target,
) {
    match_target! {
        "x86_64+avx512f" => strips_of::<8, true>(a, depth, packed, first, out, target),
        "x86_64+fma" => strips_of::<6, true>(a, depth, packed, first, out, target),
        "aarch64+neon" => strips_of::<6, true>(a, depth, packed, first, out, target),
        _ => strips_of::<2, false>(a, depth, packed, first, out, target),
    }
}

#[inline(always)]
fn strips_of<const R: usize, const FUSED: bool>(
    a: Matrix<'_>,
    depth: usize,
    packed: &[[f32; COLUMNS]],
    first: Option<&[f32]>,
    out: &mut [f32],
    target: Target,
) {
    let Target { count, width, columns, column } = target;
    for row in (0..count).step_by(R) {
        let rows = R.min(count - row);
        for at in (0..columns).step_by(COLUMNS) {
            let panel = &packed[at / COLUMNS * depth..][..depth];
            let first = first.map(|bias| &bias[at..]);
            let out = &mut out[row * width + column + at..];
            let length = COLUMNS.min(columns - at);
            if rows == R && length == COLUMNS {
                // Lengths are known when this is compiled: sums are in registers from their beginning to their end.
                let mut sums = [[0.0; COLUMNS]; R];
                for index in 0..R {
                    sums[index] =
                        *first.unwrap_or(&out[index * width..]).first_chunk().expect("a whole tile");
                }
                let sums = tile::<R, FUSED>(a, (row, R), panel, sums);
                for index in 0..R {
                    *out[index * width..].first_chunk_mut().expect("a whole tile") = sums[index];
                }
            } else {
                let mut sums = [[0.0; COLUMNS]; R];
                for (index, sums) in sums.iter_mut().enumerate().take(rows) {
                    sums[..length].copy_from_slice(&first.unwrap_or(&out[index * width..])[..length]);
                }
                let sums = tile::<R, FUSED>(a, (row, rows), panel, sums);
                for (index, sums) in sums.iter().enumerate().take(rows) {
                    out[index * width..][..length].copy_from_slice(&sums[..length]);
                }
            }
        }
    }
}

/// Sums of a tile, with the products of some rows and a panel. Of rows beyond the last, they are those of the last.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "what iterators call is compiled for any CPU")]
fn tile<const R: usize, const FUSED: bool>(
    a: Matrix<'_>,
    (row, rows): (usize, usize),
    panel: &[[f32; COLUMNS]],
    sums: [[f32; COLUMNS]; R],
) -> [[f32; COLUMNS]; R] {
    let [down, right] = a.strides;
    if right == 1 {
        let mut left: [&[f32]; R] = [&[]; R];
        for index in 0..R {
            left[index] = &a.values[(row + index.min(rows - 1)) * down..][..panel.len()];
        }
        tile_of_rows::<R, FUSED>(left, panel, sums)
    } else {
        tile_of_columns::<R, FUSED>(&a.values[row..], right, rows, panel, sums)
    }
}

// Loops by index: compilers keep their sums in registers.

/// Of a left matrix whose rows are one piece of memory each.
#[inline(always)]
fn tile_of_rows<const R: usize, const FUSED: bool>(
    a: [&[f32]; R],
    panel: &[[f32; COLUMNS]],
    mut sums: [[f32; COLUMNS]; R],
) -> [[f32; COLUMNS]; R] {
    let depth = panel.len();
    let mut left: [&[f32]; R] = [&[]; R];
    for row in 0..R {
        left[row] = &a[row][..depth];
    }
    for at in 0..depth {
        let right = panel[at];
        for row in 0..R {
            add_products::<FUSED>(&mut sums[row], left[row][at], &right);
        }
    }
    sums
}

/// Of one whose columns are.
#[inline(always)]
fn tile_of_columns<const R: usize, const FUSED: bool>(
    a: &[f32],
    stride: usize,
    rows: usize,
    panel: &[[f32; COLUMNS]],
    mut sums: [[f32; COLUMNS]; R],
) -> [[f32; COLUMNS]; R] {
    for at in 0..panel.len() {
        let (column, right) = (&a[at * stride..][..rows], panel[at]);
        for row in 0..R {
            let left = if rows == R { column[row] } else { column[row.min(rows - 1)] };
            add_products::<FUSED>(&mut sums[row], left, &right);
        }
    }
    sums
}

#[inline(always)]
#[expect(
    clippy::disallowed_methods,
    reason = "only where the CPU fuses: the result is the same on all that do"
)]
fn add_products<const FUSED: bool>(sums: &mut [f32; COLUMNS], left: f32, right: &[f32; COLUMNS]) {
    for at in 0..COLUMNS {
        sums[at] = if FUSED { left.mul_add(right[at], sums[at]) } else { left * right[at] + sums[at] };
    }
}

/// A product of one part of the depth and one block of columns, by tiles of two rows that round twice, of six and of eight that fuse.
#[cfg(test)]
pub(super) fn by_height(a: Matrix<'_>, b: Matrix<'_>) -> [Vec<f32>; 3] {
    let mut packed = vec![[0.0; COLUMNS]; b.columns.div_ceil(COLUMNS) * a.columns];
    pack(b, a.columns, &mut packed);
    let (bias, size) = (vec![0.0; b.columns], a.rows * b.columns);
    let target = Target { count: a.rows, width: b.columns, columns: b.columns, column: 0 };
    let [mut low, mut six, mut eight] = [0; 3].map(|_| vec![0.0; size]);
    strips_of::<2, false>(a, a.columns, &packed, Some(&bias), &mut low, target);
    strips_of::<6, true>(a, a.columns, &packed, Some(&bias), &mut six, target);
    strips_of::<8, true>(a, a.columns, &packed, Some(&bias), &mut eight, target);
    [low, six, eight]
}
