//! A policy whose last action and start of planning are observed.

use std::sync::{Arc, Mutex, PoisonError};

use swm_core::{Actions, Column, Field, Policy, PolicyError, View};

use super::planner::Starts;

/// A policy whose last action is known, and where its plans begin.
pub(super) struct ObservedPolicy {
    pub inner: Box<dyn Policy>,
    pub starts: Option<Starts>,
    pub last: Arc<Mutex<Option<Column>>>,
}

impl Policy for ObservedPolicy {
    fn describe(&self) -> String {
        self.inner.describe()
    }

    fn fields(&self) -> Vec<Field> {
        self.inner.fields()
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.inner.act(view, actions)?;
        self.starts.iter().try_for_each(|starts| starts.note(view))?;
        let action = actions.row(0).as_slice().to_column();
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some(action);
        Ok(())
    }

    fn is_parallel(&self) -> bool {
        self.inner.is_parallel()
    }
}
