//! Images of another size, such as that of a model: for copies of what other programs recorded.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use swm_core::{Dtype, Field, ImageSize, Metadata, Schema, SliceMut};

use super::area::Area;
use super::inner::of_inner;
use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;
use crate::open_options::OpenOptions;

/// How images get a size of another shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Fit {
    /// Height and width by factors of their own.
    Stretch,
    /// The middle of the image; what is too much of its height or width is cut off.
    Crop,
    /// All of the image, in the middle of a black one.
    Pad,
}

impl Fit {
    /// All of them, by name.
    pub const ALL: [(&'static str, Self); 3] =
        [("stretch", Self::Stretch), ("crop", Self::Crop), ("pad", Self::Pad)];

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, fit)| *fit == self).map_or("", |(name, _)| name)
    }
}

by_name!(Fit, "unknown fit", "stretch, crop or pad");

/// What becomes of the images of a column.
#[derive(Clone, Debug)]
struct Change {
    /// `[H, W, C]` in the dataset.
    stored: [usize; 3],
    /// `[H, W]` here.
    wanted: [usize; 2],
    /// Where the part that is seen begins in the stored image, `[y, x]`, and in the new one.
    begins: [[usize; 2]; 2],
    area: Arc<Area>,
}

impl Change {
    fn new(stored: [usize; 3], wanted: [usize; 2], fit: Fit) -> Self {
        let [height, width, _] = stored;
        let (size, part) = match fit {
            Fit::Stretch => ([height, width], wanted),
            Fit::Crop => (shaped([height, width], wanted), wanted),
            Fit::Pad => ([height, width], shaped(wanted, [height, width])),
        };
        let middle = |whole: [usize; 2], part: [usize; 2]| [0, 1].map(|axis| (whole[axis] - part[axis]) / 2);
        let begins = [middle([height, width], size), middle(wanted, part)];
        Self { stored, wanted, begins, area: Arc::new(Area::new(size, part)) }
    }

    fn run(&self, image: &[u8], out: &mut [u8]) {
        let ([_, width, channels], [[top, left], [out_top, out_left]]) = (self.stored, self.begins);
        let out_width = self.wanted[1];
        // Where an image is padded, it is black.
        out.fill(0);
        self.area.resize(
            channels,
            |y, at| image[((top + y) * width + left) * channels + at],
            |y, at, value| out[((out_top + y) * out_width + out_left) * channels + at] = value,
        );
    }
}

/// The largest size within `bounds` that has the shape of `like`, rounded.
fn shaped(bounds: [usize; 2], like: [usize; 2]) -> [usize; 2] {
    let ([height, width], [like_height, like_width]) = (bounds, like);
    let rounded = |side: usize, by: usize, per: usize| ((side * by + per / 2) / per).max(1);
    match width * like_height > height * like_width {
        true => [height, rounded(height, like_width, like_height).min(width)],
        false => [rounded(width, like_height, like_width).min(height), width],
    }
}

/// A dataset whose images have another size.
pub struct Resized {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    /// By column.
    changes: Arc<[Option<Change>]>,
    stored: Vec<u8>,
}

impl Resized {
    /// All images of a dataset, columns of bytes `[H, W, 1 or 3]`, in the size `size`. `fit` may be left out where their shape stays.
    /// The records of the runs get the size and the fit.
    ///
    /// # Errors
    ///
    /// [`DataError::Option`]: there are no images, or they have another shape than `size`, and `fit` does not decide.
    pub fn new(inner: Box<dyn Dataset>, size: ImageSize, fit: Option<Fit>) -> Result<Self, DataError> {
        let refuse = |option, reason| Err(DataError::Option { option, reason });
        let wanted = [size.height, size.width];
        let mut info = inner.info().clone();
        let (mut fields, mut changes) = (Vec::new(), Vec::new());
        for field in info.schema.fields() {
            let stored = stored_of(field);
            let change = match stored {
                Some([height, width, _]) if [height, width] == wanted => None,
                Some([height, width, _]) if fit.is_none() && height * wanted[1] != width * wanted[0] => {
                    return refuse(
                        "fit",
                        format!(
                            "the images `{}` are {height} x {width}, of another shape than {} x {}; use stretch, crop or pad",
                            field.name, wanted[0], wanted[1]
                        ),
                    );
                }
                Some(stored) => Some(Change::new(stored, wanted, fit.unwrap_or(Fit::Stretch))),
                None => None,
            };
            let shape =
                stored.map_or_else(|| field.shape.clone(), |[.., colors]| vec![wanted[0], wanted[1], colors]);
            fields.push(Field { shape, ..field.clone() });
            changes.push(change);
        }
        if !fields.iter().any(|field| stored_of(field).is_some()) {
            return refuse(
                "image_size",
                format!(
                    "{} holds no images; those of a replayable recording are rendered, in the size that `render` gives",
                    inner.path().display()
                ),
            );
        }
        info.schema = Schema::new(fields).map_err(|error| DataError::damaged(inner.path(), error))?;
        let mut runs = info.runs.to_vec();
        if runs.is_empty() {
            runs.push((0, Metadata::unknown()));
        }
        let images = json!({ "size": wanted, "fit": fit.unwrap_or(Fit::Stretch).name() });
        for (_, run) in &mut runs {
            run.image = Some(size);
            match &mut run.source {
                Some(Json::Object(source)) => drop(source.insert("images".to_owned(), images.clone())),
                source => *source = Some(json!({ "images": images })),
            }
        }
        info.runs = runs.into();
        Ok(Self { inner, info, changes: changes.into(), stored: Vec::new() })
    }

    /// The same with the record of the options that it was opened with.
    pub(crate) fn opened_with(mut self, options: &OpenOptions) -> Self {
        self.info.opening = Arc::new(options.record());
        self
    }
}

/// The shape of a column of images.
fn stored_of(field: &Field) -> Option<[usize; 3]> {
    match (field.dtype, &field.shape[..]) {
        (Dtype::U8, &[height, width, colors @ (1 | 3)]) if height > 0 && width > 0 => {
            Some([height, width, colors])
        }
        _ => None,
    }
}

impl Dataset for Resized {
    fn info(&self) -> &DatasetInfo {
        &self.info
    }

    fn rows(
        &mut self,
        column: usize,
        episode: usize,
        steps: Steps,
        out: SliceMut<'_>,
    ) -> Result<(), DataError> {
        let change = self.changes.get(column).and_then(Option::as_ref);
        let (change, out) = match (change, out) {
            (Some(change), SliceMut::U8(out)) => (change, out),
            (_, out) => return self.inner.rows(column, episode, steps, out),
        };
        let (from, into) = (change.stored.iter().product::<usize>(), self.info.field(column).dim());
        self.stored.resize(from, 0);
        for (at, out) in out.chunks_exact_mut(into).enumerate() {
            // One at a time: images are large.
            let row = Steps { first: steps.first + at * steps.stride, count: 1, stride: 1 };
            self.inner.rows(column, episode, row, SliceMut::U8(&mut self.stored))?;
            change.run(&self.stored, out);
        }
        Ok(())
    }

    fn share(&self) -> Box<dyn Dataset> {
        let (info, changes) = (self.info.clone(), self.changes.clone());
        Box::new(Self { inner: self.inner.share(), info, changes, stored: Vec::new() })
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.inner.origin()?.with(format_args!("resized {:?}", self.changes)))
    }

    of_inner!(looks, checks);
}

#[cfg(test)]
mod tests {
    use swm_core::Batch;

    use super::*;
    use crate::memory::MemoryDataset;

    /// An image of 4 x 8, white in the two columns of its middle.
    fn dataset() -> Box<dyn Dataset> {
        let fields =
            vec![Field::step("pixels", Dtype::U8, &[4, 8, 1]), Field::step("action", Dtype::F32, &[1])];
        let schema = Schema::new(fields).unwrap();
        let mut batch = Batch::new(schema.clone(), 2);
        let SliceMut::U8(pixels) = batch.column_mut(0) else { panic!() };
        for (at, pixel) in pixels.iter_mut().enumerate() {
            *pixel = if [3, 4].contains(&(at % 8)) { 255 } else { 40 };
        }
        Box::new(MemoryDataset::new("wide", schema, None, [Arc::new(batch)]).unwrap())
    }

    fn first_row(fit: Option<Fit>, size: [usize; 2]) -> Result<Vec<u8>, DataError> {
        let size = ImageSize { height: size[0], width: size[1] };
        let mut resized = Resized::new(dataset(), size, fit)?;
        let mut out = vec![9; 2 * size.height * size.width];
        resized.read_column(0, 0, Steps { first: 0, count: 2, stride: 1 }, SliceMut::U8(&mut out))?;
        let (first, second) = out.split_at(size.height * size.width);
        assert_eq!(first, second, "both rows hold the same image");
        Ok(first.to_vec())
    }

    #[test]
    fn images_are_stretched_cropped_or_padded() {
        assert_eq!(first_row(Some(Fit::Stretch), [2, 2]).unwrap(), [94; 4]);
        assert_eq!(first_row(Some(Fit::Crop), [2, 2]).unwrap(), [148; 4]);
        let padded = first_row(Some(Fit::Pad), [4, 4]).unwrap();
        assert_eq!(padded, [[0; 4], [40, 148, 148, 40], [40, 148, 148, 40], [0; 4]].concat());
        assert_eq!(first_row(None, [2, 4]).unwrap()[..4], [40, 148, 148, 40]);
        assert_eq!(first_row(None, [8, 16]).unwrap()[5..11], [40, 255, 255, 255, 255, 40]);
    }

    #[test]
    fn another_shape_has_to_be_decided_and_what_was_done_is_recorded() {
        let refused = first_row(None, [2, 2]).unwrap_err().to_string();
        assert!(
            refused.contains("`fit`") && refused.contains("4 x 8, of another shape than 2 x 2"),
            "{refused}"
        );
        let size = ImageSize { height: 2, width: 2 };
        let resized = Resized::new(dataset(), size, Some(Fit::Crop)).unwrap();
        let run = resized.metadata().unwrap();
        let images = &run.source.as_ref().unwrap()["images"];
        assert_eq!((run.image, images), (Some(size), &json!({ "size": [2, 2], "fit": "crop" })));
        let schema = Schema::new(vec![Field::step("action", Dtype::F32, &[1])]).unwrap();
        let batch = Arc::new(Batch::new(schema.clone(), 1));
        let blind = Box::new(MemoryDataset::new("blind", schema, None, [batch]).unwrap());
        let refused = Resized::new(blind, size, Some(Fit::Crop)).err().unwrap().to_string();
        assert!(refused.contains("holds no images"), "{refused}");
    }

    #[test]
    fn shapes_keep_their_proportions() {
        assert_eq!(shaped([64, 96], [64, 64]), [64, 64]);
        assert_eq!(shaped([96, 64], [64, 64]), [64, 64]);
        assert_eq!(shaped([64, 64], [480, 640]), [48, 64]);
        assert_eq!(shaped([10, 10], [1000, 1]), [10, 1]);
        for (name, fit) in Fit::ALL {
            assert_eq!((name.parse(), fit.name()), (Ok(fit), name));
        }
        assert!("zoom".parse::<Fit>().unwrap_err().contains("stretch, crop or pad"));
    }
}
