//! Values for plots: all columns of one episode, and a sample of one column over all episodes.

use serde_json::{Map, Value as Json, json};
use swm_core::{Column, Dtype, Field, FieldKind};
use swm_data::Steps;

use super::opened::Opened;
use crate::error::Refusal;

/// Steps of an episode that are plotted; longer ones are thinned.
const MAX_STEPS: usize = 4000;
/// Values of a row that are plotted.
const MAX_DIM: usize = 32;
/// Rows of a sample…
const MAX_ROWS: usize = 5000;
/// …and the episodes that they are from.
const MAX_EPISODES: usize = 250;

fn is_plotted(field: &Field) -> bool {
    field.dtype != Dtype::Str && field.dim() <= MAX_DIM
}

/// The columns of an episode, images apart: `{stride, columns: {name: [[T] for every value]}, constants: {name: value}}`.
pub(super) fn episode(opened: &Opened, episode: usize) -> Result<Json, Refusal> {
    let info = opened.info();
    let missing = || Refusal::bad(format!("there is no episode {episode} among {}", info.lengths.len()));
    let length = *info.lengths.get(episode).ok_or_else(missing)?;
    let stride = length.div_ceil(MAX_STEPS).max(1);
    let steps = Steps { first: 0, count: length.div_ceil(stride), stride };
    let (mut columns, mut constants) = (Map::new(), Map::new());
    let mut dataset = opened.dataset();
    for (index, field) in info.schema.fields().iter().enumerate().filter(|(_, field)| is_plotted(field)) {
        let dim = field.dim();
        let is_constant = field.kind == FieldKind::Episode;
        let steps = if is_constant { Steps { count: length.min(1), ..steps } } else { steps };
        let mut values = Column::zeros(field.dtype, steps.count * dim);
        dataset.read_column(index, episode, steps, values.as_slice_mut())?;
        let values = values.as_slice();
        let at =
            |row: usize, value: usize| values.as_f64(row * dim + value).filter(|value| value.is_finite());
        if is_constant {
            constants.insert(
                field.name.clone(),
                json!((0..dim * steps.count).map(|i| at(0, i)).collect::<Vec<_>>()),
            );
        } else {
            let series = (0..dim).map(|value| (0..steps.count).map(|row| at(row, value)).collect::<Vec<_>>());
            columns.insert(field.name.clone(), json!(series.collect::<Vec<_>>()));
        }
    }
    Ok(json!({ "length": length, "stride": stride, "columns": columns, "constants": constants }))
}

/// Rows of a column, evenly over the episodes: `[[rows] for every value]`.
pub(super) fn column(opened: &Opened, name: &str) -> Result<Json, Refusal> {
    let info = opened.info();
    let index = info.schema.require(name)?;
    let field = info.field(index);
    if !is_plotted(field) {
        return Err(Refusal::bad(format!("the column `{name}` holds no values to plot")));
    }
    let is_constant = field.kind == FieldKind::Episode;
    let total = info.lengths.len();
    let limit = if is_constant { MAX_ROWS } else { MAX_EPISODES };
    let chosen: Vec<usize> = (0..total.min(limit)).map(|at| at * total / total.min(limit)).collect();
    let per_episode = MAX_ROWS / chosen.len().max(1);
    let dim = field.dim();
    let mut series: Vec<Vec<f64>> = vec![Vec::new(); dim];
    let mut dataset = opened.dataset();
    for episode in chosen {
        let length = info.lengths[episode];
        let count = if is_constant { length.min(1) } else { length.min(per_episode.max(1)) };
        let stride = length.checked_div(count).unwrap_or(1).max(1);
        let mut values = Column::zeros(field.dtype, count * dim);
        dataset.read_column(index, episode, Steps { first: 0, count, stride }, values.as_slice_mut())?;
        let values = values.as_slice();
        for row in 0..count {
            for (value, series) in series.iter_mut().enumerate() {
                series.push(values.as_f64(row * dim + value).unwrap_or(f64::NAN));
            }
        }
    }
    Ok(json!({ "name": name, "values": series }))
}
