//! Files of named tensors: safetensors and PyTorch's `.pt` both ways, its `.pth` and `.ckpt` one way. A pickle is parsed, and nothing in it is
//! executed.
//!
//! | file | duty |
//! |---|---|
//! | `file` | reading by content; safetensors |
//! | `torch` | what PyTorch wrote |
//! | `pickles`, `archive` | where its pickles are |
//! | `pickle`, `form` | what they would do, and rebuild |
//! | `saved` | writing as PyTorch does |
//! | `refusal` | files that are none of weights |
//!
//! Names are those in the file, and values 32-bit floats. No model, no layer and no tensor library is known here.

mod archive;
mod error;
mod file;
mod form;
mod pickle;
mod pickles;
mod refusal;
mod saved;
#[cfg(test)]
mod tests;
mod torch;

pub use error::WeightsError;
pub use file::{Contents, ENDINGS, Of, Stored, contents, read, write, write_for_transformers};
pub use saved::{Saved, Values, save};
