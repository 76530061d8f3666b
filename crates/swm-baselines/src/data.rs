//! Inputs of models: plain slices, checked and copied to a device here.

use burn::tensor::{Device, Tensor, TensorData};

use crate::error::BaselineError;
use crate::images;
pub use crate::images::{Images, Normalization};

/// Dimensions of the data that a model is made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct DataDims {
    /// A: values of an action of one environment step.
    #[serde(alias = "action_width")]
    pub action_dim: usize,
    /// Values of `proprio`; 0 without it.
    #[serde(alias = "proprio_width")]
    pub proprio_dim: usize,
}

/// A batch of B clips of T steps, at the model's frame skip F.
#[derive(Clone, Copy, Debug)]
pub struct ClipBatch<'a> {
    /// `[B, T, …]`.
    pub pixels: Images<'a>,
    /// `[B, T, Z]`: what the model's frozen encoder gives for images, in place of `pixels`; for models that
    /// [train on latents](crate::Baseline::trains_on_latents).
    pub latents: Option<Vectors<'a>>,
    /// `[B, T, …]`: the same rows as `pixels`, in the canonical look; for models that learn to draw it.
    pub canonical: Option<Images<'a>>,
    /// `[B, T, F × A]`, scaled as the model shall see them: the actions from each step to the next. Where an episode
    /// ends there are none; values that are not finite count as 0.
    pub action: Vectors<'a>,
    /// `[B, T, …]`, scaled; for models that use it.
    pub proprio: Option<Vectors<'a>>,
    /// `[B, 1, …]`: the goal's image; for goal-conditioned models.
    pub goal_pixels: Option<Images<'a>>,
    /// `[B, 1, …]`, scaled as `proprio`.
    pub goal_proprio: Option<Vectors<'a>>,
}

/// A planning batch: what B plans or decisions start from.
#[derive(Clone, Copy, Debug)]
pub struct PlanningBatch<'a> {
    /// `[B, N, …]`: the last N observations at the model's frame skip, the present one last.
    pub pixels: Images<'a>,
    /// `[B, N - 1, F × A]`, scaled: the actions between them. May be empty for N of 1.
    pub action: Vectors<'a>,
    /// `[B, N, …]`, scaled; for models that use it.
    pub proprio: Option<Vectors<'a>>,
    /// `[B, 1, …]`.
    pub goal_pixels: Images<'a>,
    /// `[B, 1, …]`, scaled as `proprio`.
    pub goal_proprio: Option<Vectors<'a>>,
}

/// B observations, each by itself.
#[derive(Clone, Copy, Debug)]
pub struct Observations<'a> {
    /// `[B, 1, …]`.
    pub pixels: Images<'a>,
    /// `[B, 1, …]`, scaled; for models that use it.
    pub proprio: Option<Vectors<'a>>,
}

/// Vectors `[B, T, D]`.
#[derive(Clone, Copy, Debug)]
pub struct Vectors<'a> {
    /// B × T × D values.
    pub values: &'a [f32],
    /// B.
    pub rows: usize,
    /// T.
    pub steps: usize,
    /// D.
    pub dim: usize,
}

/// What the tensors of a batch must be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Form {
    /// The side of images.
    pub(crate) image: usize,
    /// F × A.
    pub(crate) action: usize,
    /// Values of `proprio`; 0: not used.
    pub(crate) proprio: usize,
    /// How the values of images are standardized.
    pub(crate) normalization: Normalization,
}

/// A batch on the device.
pub(crate) struct Inputs {
    /// `[B, T, 3, S, S]`; empty where there are `latents`.
    pub(crate) pixels: Tensor<5>,
    /// `[B, T, Z]`.
    pub(crate) latents: Option<Tensor<3>>,
    /// `[B, T, 3, S, S]`: the canonical look of `pixels`.
    pub(crate) canonical: Option<Tensor<5>>,
    /// `[B, T, F × A]`.
    pub(crate) action: Tensor<3>,
    /// `[B, T, …]`.
    pub(crate) proprio: Option<Tensor<3>>,
    /// `[B, 1, 3, S, S]`.
    pub(crate) goal_pixels: Option<Tensor<5>>,
    /// `[B, 1, …]`.
    pub(crate) goal_proprio: Option<Tensor<3>>,
    /// `[B, T, 1]`: 1 where an observation equals the goal; 0 elsewhere, and without goals.
    pub(crate) is_goal: Tensor<3>,
}

impl Inputs {
    /// Checks a batch and copies it to the device.
    pub(crate) fn new(batch: &ClipBatch<'_>, form: &Form, device: &Device) -> Result<Self, BaselineError> {
        let ClipBatch { pixels, latents, canonical, action, proprio, goal_pixels, goal_proprio } = batch;
        let rows = pixels.rows;
        action.check("action", rows, form.action)?;
        if action.steps != pixels.steps {
            let reason = format!("{} steps per clip where `pixels` has {}", action.steps, pixels.steps);
            return Err(BaselineError::data("action", reason));
        }
        let is_goal = is_goal(batch);
        Ok(Self {
            pixels: match latents {
                None => images::to_tensor("pixels", pixels, (form.image, form.normalization), device)?,
                Some(_) => Tensor::zeros([0; 5], device),
            },
            latents: latents.map(|latents| latents.to_tensor(device)),
            canonical: match canonical {
                Some(canonical) => Some(canonical_to_tensor(canonical, pixels, form, device)?),
                None => None,
            },
            action: action.to_tensor(device),
            proprio: form.state("proprio", proprio.as_ref(), rows, device)?,
            goal_pixels: match goal_pixels {
                Some(goal) => Some(goal_to_tensor(goal, rows, form, device)?),
                None => None,
            },
            goal_proprio: match goal_pixels {
                Some(_) => form.state("goal_proprio", goal_proprio.as_ref(), rows, device)?,
                None => None,
            },
            is_goal: Tensor::from_data(TensorData::new(is_goal, [rows, pixels.steps, 1]), device),
        })
    }
}

/// Images in the canonical look, which must be as many as `pixels`.
fn canonical_to_tensor(
    canonical: &Images<'_>,
    pixels: &Images<'_>,
    form: &Form,
    device: &Device,
) -> Result<Tensor<5>, BaselineError> {
    if (canonical.rows, canonical.steps) != (pixels.rows, pixels.steps) {
        let reason = format!(
            "{} × {} images beside {} × {} of `pixels`; they must be of the same rows",
            canonical.rows, canonical.steps, pixels.rows, pixels.steps
        );
        return Err(BaselineError::data("canonical", reason));
    }
    images::to_tensor("canonical", canonical, (form.image, form.normalization), device)
}

/// What plans start from, on the device.
pub(crate) struct Start {
    /// `[B, N, 3, S, S]`.
    pub(crate) pixels: Tensor<5>,
    /// `[B, N - 1, F × A]`; `None` for N of 1.
    pub(crate) action: Option<Tensor<3>>,
    /// `[B, N, …]`.
    pub(crate) proprio: Option<Tensor<3>>,
    /// `[B, 1, 3, S, S]`.
    pub(crate) goal_pixels: Tensor<5>,
    /// `[B, 1, …]`.
    pub(crate) goal_proprio: Option<Tensor<3>>,
}

impl Start {
    /// Checks a planning batch and copies it to the device.
    pub(crate) fn new(
        batch: &PlanningBatch<'_>,
        form: &Form,
        device: &Device,
    ) -> Result<Self, BaselineError> {
        let PlanningBatch { pixels, action, proprio, goal_pixels, goal_proprio } = batch;
        let (rows, steps) = (pixels.rows, pixels.steps);
        let action = if steps > 1 {
            action.check("action", rows, form.action)?;
            if action.steps + 1 != steps {
                let reason = format!("{} past actions between {steps} observations", action.steps);
                return Err(BaselineError::data("action", reason));
            }
            Some(action.to_tensor(device))
        } else {
            None
        };
        Ok(Self {
            pixels: images::to_tensor("pixels", pixels, (form.image, form.normalization), device)?,
            action,
            proprio: form.state("proprio", proprio.as_ref(), rows, device)?,
            goal_pixels: goal_to_tensor(goal_pixels, rows, form, device)?,
            goal_proprio: form.state("goal_proprio", goal_proprio.as_ref(), rows, device)?,
        })
    }

    /// `[1, 1, 3, S, S]`: the present image of planning problem `row`.
    pub(crate) fn image(&self, row: usize) -> Tensor<5> {
        self.frame(row, self.pixels.dims()[1] - 1)
    }

    /// `[1, 1, 3, S, S]`: the one before, where there is one.
    pub(crate) fn earlier_image(&self, row: usize) -> Option<Tensor<5>> {
        Some(self.frame(row, self.pixels.dims()[1].checked_sub(2)?))
    }

    fn frame(&self, row: usize, at: usize) -> Tensor<5> {
        self.pixels.clone().narrow(0, row, 1).narrow(1, at, 1)
    }

    /// `[1, 1, 3, S, S]`: its goal.
    pub(crate) fn goal_image(&self, row: usize) -> Tensor<5> {
        self.goal_pixels.clone().narrow(0, row, 1)
    }
}

fn goal_to_tensor(
    goal: &Images<'_>,
    rows: usize,
    form: &Form,
    device: &Device,
) -> Result<Tensor<5>, BaselineError> {
    if (goal.rows, goal.steps) != (rows, 1) {
        let reason =
            format!("[{}, {}] images for {rows} samples; one of each is wanted", goal.rows, goal.steps);
        return Err(BaselineError::data("goal_pixels", reason));
    }
    images::to_tensor("goal_pixels", goal, (form.image, form.normalization), device)
}

impl Form {
    /// For images that are standardized by ImageNet's moments.
    pub(crate) const fn new(image: usize, action: usize, proprio: usize) -> Self {
        Self { image, action, proprio, normalization: Normalization::Imagenet }
    }

    pub(crate) fn state(
        &self,
        column: &'static str,
        vectors: Option<&Vectors<'_>>,
        rows: usize,
        device: &Device,
    ) -> Result<Option<Tensor<3>>, BaselineError> {
        match (self.proprio, vectors) {
            (0, _) => Ok(None),
            (_, None) => Err(BaselineError::data(
                column,
                "this model uses it and the data has none; train without proprio",
            )),
            (dim, Some(vectors)) => {
                vectors.check(column, rows, dim)?;
                Ok(Some(vectors.to_tensor(device)))
            }
        }
    }
}

impl Vectors<'_> {
    fn check(&self, column: &'static str, rows: usize, dim: usize) -> Result<(), BaselineError> {
        if self.dim != dim {
            let reason =
                format!("{} values per step, and this model was made for {dim}; they must agree", self.dim);
            return Err(BaselineError::data(column, reason));
        }
        let shape = [self.rows, self.steps, self.dim];
        if self.rows != rows || shape.iter().product::<usize>() != self.values.len() {
            let reason = format!("{} values are not {shape:?}, for {rows} samples", self.values.len());
            return Err(BaselineError::data(column, reason));
        }
        Ok(())
    }

    fn to_tensor(self, device: &Device) -> Tensor<3> {
        let finite = |value: &f32| if value.is_finite() { *value } else { 0.0 };
        let values: Vec<f32> = self.values.iter().map(finite).collect();
        Tensor::from_data(TensorData::new(values, [self.rows, self.steps, self.dim]), device)
    }
}

/// `[B, T]`: whether an observation equals the goal exactly, as the reference's reward asks.
fn is_goal(batch: &ClipBatch<'_>) -> Vec<f32> {
    let ClipBatch { pixels, proprio, goal_pixels, goal_proprio, .. } = batch;
    let Some(goal) = goal_pixels else { return vec![0.0; pixels.rows * pixels.steps] };
    let size = 3 * pixels.height * pixels.width;
    let mut found: Vec<bool> = pixels
        .values
        .chunks_exact(size)
        .enumerate()
        .map(|(frame, image)| {
            goal.values.get(frame / pixels.steps * size..).is_some_and(|goal| goal.starts_with(image))
        })
        .collect();
    if let (Some(states), Some(goal)) = (proprio, goal_proprio) {
        let states = states.values.chunks_exact(states.dim.max(1));
        for (frame, (found, state)) in found.iter_mut().zip(states).enumerate() {
            let start = frame / pixels.steps * state.len();
            *found &= goal.values.get(start..).is_some_and(|goal| goal.starts_with(state));
        }
    }
    found.into_iter().map(|found| if found { 1.0 } else { 0.0 }).collect()
}
