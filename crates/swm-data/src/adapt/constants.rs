//! Columns with one value in every row, added to a dataset: factors of variation that it was recorded without.

use std::sync::Arc;

use swm_core::env::VARIATION_PREFIX;
use swm_core::{Column, EnvConfig, Field, FieldKind, Registry, Schema, SliceMut, Value};

use super::inner::of_inner;
use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;

/// A dataset with constant columns behind its own.
pub struct Constants {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    values: Arc<[Column]>,
}

impl Constants {
    /// Adds columns, each with the value of all its rows.
    ///
    /// # Errors
    ///
    /// [`DataError::Request`]: the dataset has a column of such a name, or a value is not of its column's type.
    pub fn new(inner: Box<dyn Dataset>, columns: Vec<(Field, Value)>) -> Result<Self, DataError> {
        let wrong = |error: swm_core::BatchError| DataError::request(inner.path(), error.to_string());
        let mut fields = inner.schema().fields().to_vec();
        let mut values = Vec::with_capacity(columns.len());
        for (field, value) in columns {
            values.push(value.cast(&field.name, field.dtype, &field.shape).map_err(wrong)?.data);
            fields.push(field);
        }
        let info = inner.info().with_schema(Schema::new(fields).map_err(wrong)?);
        Ok(Self { inner, info, values: values.into() })
    }
}

impl Dataset for Constants {
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
        let own = self.inner.schema().fields().len();
        let Some(value) = column.checked_sub(own).and_then(|added| self.values.get(added)) else {
            return self.inner.rows(column, episode, steps, out);
        };
        let mut rest = out;
        while !rest.is_empty() {
            let (mut row, after) = rest.split_at(value.len());
            rest = after;
            assert!(row.copy_from(value.as_slice()), "the value was cast to the column's type");
        }
        Ok(())
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.inner.origin()?.with(format_args!("constants {:?}", self.values)))
    }

    of_inner!(looks, checks);

    fn share(&self) -> Box<dyn Dataset> {
        let Self { inner, info, values } = self;
        Box::new(Self { inner: inner.share(), info: info.clone(), values: values.clone() })
    }
}

/// Gives every dataset the factors of variation that any of them holds, so that they can be joined: a factor that a
/// recording neither sampled nor set had its default in all episodes. `registry` knows their environments.
///
/// A dataset that does not say how it was recorded, or whose environment is unknown, stays as it is.
///
/// # Errors
///
/// As of [`Constants::new`].
pub fn fill_factors(
    datasets: Vec<Box<dyn Dataset>>,
    registry: &Registry,
) -> Result<Vec<Box<dyn Dataset>>, DataError> {
    let mut all: Vec<Field> = Vec::new();
    for field in datasets.iter().flat_map(|dataset| dataset.schema().fields()) {
        if field.name.starts_with(VARIATION_PREFIX) && all.iter().all(|there| there.name != field.name) {
            all.push(Field { kind: FieldKind::Episode, ..field.clone() });
        }
    }
    let filled = |dataset: Box<dyn Dataset>| {
        let mut columns = Vec::new();
        for field in all.iter().filter(|field| dataset.schema().index(&field.name).is_none()) {
            if let Some(value) = default_of(dataset.as_ref(), registry, field) {
                columns.push((field.clone(), value));
            }
        }
        match columns.is_empty() {
            true => Ok(dataset),
            false => Ok(Box::new(Constants::new(dataset, columns)?) as Box<dyn Dataset>),
        }
    };
    datasets.into_iter().map(filled).collect()
}

/// The value that a factor had in all episodes of a dataset that has no column of it.
fn default_of(dataset: &dyn Dataset, registry: &Registry, field: &Field) -> Option<Value> {
    let metadata = dataset.metadata()?;
    let settings = metadata.settings.clone();
    let env = registry.env(&metadata.env).ok()?.make(&EnvConfig { image: None, settings }).ok()?;
    let name = field.name.strip_prefix(VARIATION_PREFIX)?;
    let factor = env.spec().factors.iter().find(|factor| factor.name == name)?;
    Value::from_json(name, &factor.default).ok()
}
