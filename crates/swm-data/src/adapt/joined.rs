//! One column made of several: concatenated on the last axis, as numbers of one type.

use std::sync::Arc;

use swm_core::{Column, Field, FieldKind, Schema, SliceMut};

use super::inner::of_inner;
use crate::dataset::{Dataset, DatasetInfo, Origin, Steps};
use crate::error::DataError;

/// A dataset with one more column, which is made of others.
pub struct Joined {
    inner: Box<dyn Dataset>,
    info: DatasetInfo,
    parts: Arc<[Part]>,
    /// One column per part, between reading and interleaving.
    scratch: Vec<Column>,
}

#[derive(Clone, Copy, Debug)]
struct Part {
    column: usize,
    /// Values on the last axis.
    last: usize,
}

impl Joined {
    /// Adds the column `name`: the columns `parts` concatenated on the last axis; scalars count as `[1]`. A part that
    /// ends in `*` stands for all columns that begin so, sorted by name. All must have one type and equal other axes.
    ///
    /// # Errors
    ///
    /// No such column, or columns that cannot be joined.
    pub fn new(inner: Box<dyn Dataset>, name: &str, parts: &[&str]) -> Result<Self, DataError> {
        let wrong = |reason: String| Err(DataError::Loader { setting: "join", reason });
        let fields = inner.schema().fields();
        let mut columns = Vec::new();
        for part in parts {
            let Some(start) = part.strip_suffix('*') else {
                let found = inner.schema().require(part);
                columns.push(found.map_err(|error| DataError::request(inner.path(), error.to_string()))?);
                continue;
            };
            let mut matching: Vec<usize> =
                (0..fields.len()).filter(|&column| fields[column].name.starts_with(start)).collect();
            matching.sort_by_key(|&column| &fields[column].name);
            if matching.is_empty() {
                return wrong(format!(
                    "no column begins with `{start}`; there are: {}",
                    inner.schema().names()
                ));
            }
            columns.extend(matching);
        }
        let Some(&head) = columns.first() else {
            return wrong(format!("column `{name}` is made of nothing; name one or more columns"));
        };
        let split = |column: usize| match fields[column].shape.split_last() {
            Some((&last, before)) => (before, last),
            None => (&[][..], 1),
        };
        let (before, _) = split(head);
        for &column in &columns {
            let (head, field) = (&fields[head], &fields[column]);
            if field.dtype != head.dtype || split(column).0 != before {
                return wrong(format!(
                    "`{}` is {} {:?} and `{}` {} {:?}: they can be joined only with one type, and shapes that \
                     differ on the last axis alone",
                    head.name, head.dtype, head.shape, field.name, field.dtype, field.shape
                ));
            }
        }
        let parts: Arc<[Part]> =
            columns.iter().map(|&column| Part { column, last: split(column).1 }).collect();
        let shape: Vec<usize> =
            before.iter().copied().chain([parts.iter().map(|part| part.last).sum()]).collect();
        let constant = columns.iter().all(|&column| fields[column].kind == FieldKind::Episode);
        let kind = if constant { FieldKind::Episode } else { FieldKind::Step };
        let field = Field { name: name.to_owned(), dtype: fields[head].dtype, shape, kind };
        let all = fields.iter().cloned().chain([field]).collect();
        let schema = match Schema::new(all) {
            Ok(schema) => schema,
            Err(error) => return wrong(error.to_string()),
        };
        let scratch = scratch(&schema, &parts);
        let info = inner.info().with_schema(schema);
        Ok(Self { inner, info, parts, scratch })
    }
}

fn scratch(schema: &Schema, parts: &[Part]) -> Vec<Column> {
    parts.iter().map(|part| Column::zeros(schema.fields()[part.column].dtype, 0)).collect()
}

impl Dataset for Joined {
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
        if column + 1 != self.schema().fields().len() {
            return self.inner.rows(column, episode, steps, out);
        }
        for (part, values) in self.parts.iter().zip(&mut self.scratch) {
            values.resize(steps.count * self.info.schema.dim(part.column));
            self.inner.rows(part.column, episode, steps, values.as_slice_mut())?;
        }
        let (mut rest, mut at) = (out, 0);
        while !rest.is_empty() {
            for (part, values) in self.parts.iter().zip(&self.scratch) {
                let (mut here, after) = rest.split_at(part.last);
                rest = after;
                let copied = here.copy_from(values.as_slice().range(at * part.last, part.last));
                assert!(copied, "all parts have the type of the column");
            }
            at += 1;
        }
        Ok(())
    }

    fn origin(&self) -> Option<Origin> {
        Some(self.inner.origin()?.with(format_args!("joined {:?}", self.parts)))
    }

    of_inner!(looks, checks);

    fn share(&self) -> Box<dyn Dataset> {
        let (info, parts) = (self.info.clone(), self.parts.clone());
        let scratch = scratch(&info.schema, &parts);
        Box::new(Self { inner: self.inner.share(), info, parts, scratch })
    }
}
