//! Saved states of environments.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::error::EnvError;

/// A saved state of an environment: plain bytes, so that it can be kept, compared, sent and stored.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct EnvState {
    bytes: Vec<u8>,
}

impl EnvState {
    /// An empty state, to be filled by [`Env::snapshot`](super::Env::snapshot).
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes that [`EnvState::bytes`] gave.
    pub fn from_bytes(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }

    /// The bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Replaces the content by `value`, reusing the memory. For environments.
    ///
    /// # Errors
    ///
    /// [`EnvError::State`]: `value` has a part that cannot be serialized.
    pub fn store<T: Serialize>(&mut self, env: &str, value: &T) -> Result<(), EnvError> {
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.clear();
        self.bytes = postcard::to_extend(value, bytes)
            .map_err(|error| EnvError::State { env: env.to_owned(), reason: error.to_string() })?;
        Ok(())
    }

    /// The content as the `T` that was stored. For environments.
    ///
    /// # Errors
    ///
    /// [`EnvError::State`]: the bytes are no `T`, or more than one.
    pub fn load<T: DeserializeOwned>(&self, env: &str) -> Result<T, EnvError> {
        let damaged = |reason: String| EnvError::State { env: env.to_owned(), reason };
        let (value, rest) =
            postcard::take_from_bytes(&self.bytes).map_err(|error| damaged(error.to_string()))?;
        if rest.is_empty() { Ok(value) } else { Err(damaged(format!("{} bytes too many", rest.len()))) }
    }
}
