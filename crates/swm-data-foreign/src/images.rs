//! Images of other programs: which columns hold some, which axis is that of colors, and bytes of floats, by their range.

use std::sync::Arc;

use swm_core::{Column, Dtype, SliceMut};
use swm_data::Flip;
use swm_data::dataset::Steps;
use swm_data::error::{FormatError, Result, invalid, unsupported, wrong_type};

use super::array::{Array, Scratch, Shared, values};
use super::dataset::Span;

/// Sides below this are those of matrices, not of images.
const MIN_SIDE: usize = 8;

/// The size of images, and whether the axis of colors comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    size: [usize; 3],
    is_colors_first: bool,
}

/// The layout of images; `None` for rows that are no images, and an error where the axis of colors is in doubt.
pub(super) fn layout(dtype: Dtype, shape: &[usize]) -> Option<Result<Layout>> {
    let &[first, second, third] = shape else { return None };
    let is_color = |size: usize| size == 3 || size == 1 && dtype == Dtype::U8;
    if !matches!(dtype, Dtype::U8 | Dtype::F32 | Dtype::F64) || second < MIN_SIDE {
        return None;
    }
    match (is_color(first), is_color(third)) {
        (true, true) => Some(Err(unsupported(format!(
            "images of the shape {shape:?} may have their colors on the first axis or the last; store them as [height, width, colors]"
        )))),
        (false, true) if first >= MIN_SIDE => {
            Some(Ok(Layout { size: [first, second, third], is_colors_first: false }))
        }
        (true, false) if third >= MIN_SIDE => {
            Some(Ok(Layout { size: [second, third, first], is_colors_first: true }))
        }
        _ => None,
    }
}

/// What rounding adds to numbers of 0 to 1.
const ROUNDED: f64 = 1e-6;

/// What the values of an image are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Range {
    /// Of 0 to 255.
    Bytes,
    /// Of 0 to 1.
    Unit,
}

/// The arrays as images of bytes; the inner error says why their values are none.
pub(super) fn converted(
    arrays: Vec<Shared>,
    spans: &[Span],
    layout: Layout,
    flip: Option<Flip>,
    scratch: &mut Scratch,
) -> Result<Result<Vec<Shared>, String>> {
    let dtype = arrays.first().map(|array| array.dtype());
    let range = match dtype {
        Some(Dtype::U8) if !layout.is_colors_first && flip.is_none() => return Ok(Ok(arrays)),
        Some(Dtype::U8) => Range::Bytes,
        _ => match range(&arrays, spans, scratch)? {
            Ok(range) => range,
            Err(reason) => return Ok(Err(reason)),
        },
    };
    let image = |array: Shared| -> Shared { Arc::new(Image { array, layout, range, flip }) };
    Ok(Ok(arrays.into_iter().map(image).collect()))
}

/// The range of floats: by all values of the first episode that is not black.
fn range(arrays: &[Shared], spans: &[Span], scratch: &mut Scratch) -> Result<Result<Range, String>> {
    for span in spans {
        let Some(array) = arrays.get(span.array) else { continue };
        let (mut low, mut high, mut is_whole) = (f64::INFINITY, f64::NEG_INFINITY, true);
        for row in 0..span.count {
            let column =
                values(array.as_ref(), Steps { first: span.first + row, count: 1, stride: 1 }, scratch)?;
            for value in (0..column.len()).filter_map(|at| column.as_slice().as_f64(at)) {
                if value.is_nan() {
                    return Ok(Err("its images hold NaN".to_owned()));
                }
                (low, high) = (low.min(value), high.max(value));
                is_whole &= value.fract() == 0.0;
            }
        }
        match () {
            () if low >= -ROUNDED && high > 0.0 && high <= 1.0 + ROUNDED => return Ok(Ok(Range::Unit)),
            () if low >= 0.0 && high > 0.0 && high <= 255.0 && is_whole => return Ok(Ok(Range::Bytes)),
            () if high == 0.0 && low == 0.0 || low > high => {}
            () => {
                return Ok(Err(format!(
                    "its floats are {low} to {high}, and images have whole numbers of 0 to 255 or any of 0 to 1; store them so"
                )));
            }
        }
    }
    Ok(Ok(Range::Bytes))
}

/// Images of bytes `[H, W, C]`.
#[derive(Debug)]
struct Image {
    array: Shared,
    layout: Layout,
    range: Range,
    flip: Option<Flip>,
}

impl Image {
    fn byte(&self, value: f64) -> Result<u8> {
        let is_byte = match self.range {
            Range::Bytes => (0.0..=255.0).contains(&value) && value.fract() == 0.0,
            Range::Unit => (-ROUNDED..=1.0 + ROUNDED).contains(&value),
        };
        let (scale, range) = match self.range {
            Range::Bytes => (1.0, "whole numbers of 0 to 255"),
            Range::Unit => (255.0, "numbers of 0 to 1"),
        };
        match is_byte {
            true => Ok((value * scale + 0.5).clamp(0.0, 255.0) as u8),
            false => Err(unsupported(format!(
                "a value of an image is {value}, unlike those of the first episode, which are {range}; store all images in one range, or as u8"
            ))),
        }
    }
}

impl Array for Image {
    fn dtype(&self) -> Dtype {
        Dtype::U8
    }

    fn rows(&self) -> usize {
        self.array.rows()
    }

    fn shape(&self) -> &[usize] {
        &self.layout.size
    }

    fn read(&self, rows: Steps, out: SliceMut<'_>, scratch: &mut Scratch) -> Result<()> {
        let SliceMut::U8(out) = out else { return Err(wrong_type("images hold bytes")) };
        let ([height, width, colors], size) = (self.layout.size, self.dim());
        if self.array.dim() != size {
            return Err(invalid(format!(
                "its images are {:?} here, unlike in the first episode",
                self.array.shape()
            )));
        }
        for (index, image) in out.chunks_exact_mut(size).enumerate() {
            let row = Steps { first: rows.first + index * rows.stride, count: 1, stride: 1 };
            let column = values(self.array.as_ref(), row, scratch)?;
            let bytes: Vec<u8> = match column {
                Column::U8(bytes) => bytes,
                Column::F32(values) => {
                    values.iter().map(|&value| self.byte(f64::from(value))).collect::<Result<_>>()?
                }
                Column::F64(values) => values.iter().map(|&value| self.byte(value)).collect::<Result<_>>()?,
                other => {
                    return Err(FormatError::WrongType(format!("its images hold {}", other.dtype()).into()));
                }
            };
            for y in 0..height {
                for x in 0..width {
                    let (from_y, from_x) = match self.flip {
                        None => (y, x),
                        Some(Flip::Vertical) => (height - 1 - y, x),
                        Some(Flip::HalfTurn) => (height - 1 - y, width - 1 - x),
                    };
                    for color in 0..colors {
                        let from = match self.layout.is_colors_first {
                            true => (color * height + from_y) * width + from_x,
                            false => (from_y * width + from_x) * colors + color,
                        };
                        image[(y * width + x) * colors + color] = bytes[from];
                    }
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::array::Memory;
    use super::*;

    fn bytes_of(values: Vec<f32>, flip: Option<Flip>) -> Result<Vec<u8>, String> {
        let rows = values.len() / 192;
        let array = Memory::of(Column::F32(values), &[8, 8, 3]);
        let layout = layout(Dtype::F32, &[8, 8, 3]).unwrap().unwrap();
        let spans = [Span { array: 0, first: 0, count: 1, tail: None }];
        let mut scratch = Scratch::default();
        let images = converted(vec![array], &spans, layout, flip, &mut scratch).unwrap()?;
        let steps = Steps { first: 0, count: rows, stride: 1 };
        let Column::U8(bytes) = values_of(&images[0], steps).map_err(|error| error.to_string())? else {
            panic!()
        };
        Ok(bytes)
    }

    fn values_of(array: &Shared, steps: Steps) -> Result<Column> {
        values(array.as_ref(), steps, &mut Scratch::default())
    }

    #[test]
    fn floats_become_bytes_by_their_range() {
        let ramp = |scale: f32| (0..192).map(|at| at as f32 * scale).collect::<Vec<_>>();
        assert_eq!(bytes_of(ramp(1.0), None).unwrap()[191], 191);
        assert_eq!(bytes_of(ramp(1.0 / 191.0), None).unwrap()[191], 255);
        assert!(bytes_of(ramp(-1.0), None).unwrap_err().contains("-191 to"));
        assert!(bytes_of(ramp(0.7), None).unwrap_err().contains("whole numbers"));
        let mut later = ramp(1.0);
        later.extend(ramp(0.5));
        assert!(bytes_of(later, None).unwrap_err().contains("unlike those of the first episode"));
        let mut rounded = ramp(1.0 / 191.0);
        rounded[0] = -1e-7;
        rounded[191] = 1.000_000_1;
        let bytes = bytes_of(rounded, None).unwrap();
        assert_eq!((bytes[0], bytes[191]), (0, 255));
        let flipped = bytes_of(ramp(1.0), Some(Flip::Vertical)).unwrap();
        assert_eq!(flipped[..3], [168, 169, 170]);
        assert_eq!(bytes_of(ramp(1.0), Some(Flip::HalfTurn)).unwrap()[..3], [189, 190, 191]);
    }

    #[test]
    fn the_axis_of_colors_is_the_one_of_three() {
        let size = |shape: &[usize]| layout(Dtype::U8, shape).map(|found| found.ok().map(|found| found.size));
        assert_eq!(size(&[48, 64, 3]), Some(Some([48, 64, 3])));
        assert_eq!(size(&[3, 48, 64]), Some(Some([48, 64, 3])));
        assert_eq!(size(&[3, 48, 3]), Some(None));
        assert_eq!(size(&[32, 32, 6]), None);
        assert_eq!(size(&[2, 3, 3]), None);
        assert!(layout(Dtype::I32, &[32, 32, 1]).is_none());
    }
}
