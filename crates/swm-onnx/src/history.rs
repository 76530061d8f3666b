//! A history as inputs of the encoder: frames `[1, T, …]` and the blocks of actions between them `[1, T - 1, D]`, oldest first. An
//! episode that is younger has copies of its first frame and blocks of zeros in front, as graphs have fixed shapes.

use ort::value::{DynValue, Tensor, TensorElementType};
use swm_core::Slice;
use swm_solvers::PlanningContext;

use crate::cost::ModelSettings;
use crate::error::OnnxError;

/// The input that gets the blocks between the frames.
pub(crate) const ACTION_HISTORY: &str = "action_history";

/// What an input of the encoder gets of the history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// The frames of the field at this position of `history_fields`.
    Frames(usize),
    /// The blocks.
    Actions,
}

impl ModelSettings {
    /// The part of the history that the input `name` gets; `None`: the present alone.
    pub(crate) fn part(&self, name: &str) -> Option<Part> {
        match (self.history, name) {
            (0 | 1, _) => None,
            (_, ACTION_HISTORY) => Some(Part::Actions),
            (_, name) => self.history_fields.iter().position(|field| field == name).map(Part::Frames),
        }
    }
}

/// Makes a part of the history of environment `index` into an input of this name, shape and type.
pub(crate) fn tensor(
    settings: &ModelSettings,
    part: Part,
    context: &PlanningContext<'_>,
    index: usize,
    (name, shape, kind): (&str, &[i64], TensorElementType),
) -> Result<DynValue, OnnxError> {
    let (count, block) = (settings.history, settings.action_block);
    let wrong = |reason: String| OnnxError::Input { name: name.to_owned(), reason };
    let view = context.history(index).ok_or_else(|| {
        wrong(format!("the model sees {count} frames, and the policy keeps one; set history_len={count}"))
    })?;
    let missing = count.saturating_sub(view.frames());
    let sizes: Vec<usize> = shape.iter().map(|&size| usize::try_from(size).unwrap_or(0)).collect();
    let size: usize = sizes.get(2..).unwrap_or_default().iter().product();
    let rows = if part == Part::Actions { count - 1 } else { count };
    let found = match part {
        Part::Frames(field) => view.frame(field, 0).len(),
        Part::Actions => block * view.action_dim(),
    };
    if sizes.get(1) != Some(&rows) || size != found {
        return Err(wrong(format!(
            "the history is [1, {rows}, …] of {found} values a row, the model was exported for {shape:?}; fix `history` and \
             `history_fields` of model.json, or take a model of this environment"
        )));
    }
    let made = match (part, kind) {
        (Part::Frames(field), TensorElementType::Uint8) => {
            let mut all: Vec<u8> = Vec::with_capacity(rows * size);
            for frame in frames(count, missing) {
                let Slice::U8(values) = view.frame(field, frame) else {
                    return Err(wrong(
                        "it holds no images, which uint8 is for; export vectors as float32".to_owned(),
                    ));
                };
                all.extend_from_slice(values);
            }
            Tensor::from_array((shape.to_vec(), all)).map(Tensor::into_dyn)
        }
        (Part::Frames(field), TensorElementType::Float32) => {
            let mut all: Vec<f32> = Vec::with_capacity(rows * size);
            for frame in frames(count, missing) {
                let values = view.frame(field, frame);
                all.extend((0..values.len()).map(|at| values.as_f64(at).unwrap_or(f64::NAN) as f32));
            }
            Tensor::from_array((shape.to_vec(), all)).map(Tensor::into_dyn)
        }
        (Part::Actions, TensorElementType::Float32) => {
            let mut all = vec![0.0; missing.min(rows) * size];
            for action in 0..(view.frames() - 1) * block {
                all.extend_from_slice(view.action(action));
            }
            Tensor::from_array((shape.to_vec(), all)).map(Tensor::into_dyn)
        }
        (_, kind) => {
            return Err(wrong(format!(
                "it is given as {kind:?}; export images as uint8 and others as float32"
            )));
        }
    };
    made.map_err(OnnxError::Run)
}

/// Positions of `count` frames in a history that lacks the first `missing` ones.
fn frames(count: usize, missing: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |frame| frame.saturating_sub(missing))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings(history: usize) -> ModelSettings {
        let text = format!(
            r#"{{"name": "m", "action_block": 2, "history": {history}, "history_fields": ["pixels", "proprio"]}}"#
        );
        serde_json::from_str(&text).unwrap()
    }

    #[test]
    fn young_episodes_repeat_their_first_frame() {
        assert_eq!(frames(3, 0).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!(frames(3, 2).collect::<Vec<_>>(), [0, 0, 0]);
        assert_eq!(frames(4, 1).collect::<Vec<_>>(), [0, 0, 1, 2]);
    }

    #[test]
    fn only_what_the_description_names_has_a_history() {
        assert_eq!(settings(3).part("proprio"), Some(Part::Frames(1)));
        assert_eq!(settings(3).part(ACTION_HISTORY), Some(Part::Actions));
        assert_eq!((settings(3).part("goal"), settings(1).part("pixels")), (None, None));
    }
}
