//! World models exported to ONNX as costs of plans: `--policy onnx:DIR`. ONNX Runtime is loaded at run time, from the
//! Python package `onnxruntime` or a path; the build does not need it.
//!
//! ```no_run
//! use swm_core::{Dtype, Space};
//! use swm_onnx::OnnxCost;
//! use swm_solvers::{Cem, Mpc, PlanConfig};
//!
//! let mut cost = OnnxCost::load("my-model".as_ref())?;
//! let action_block = cost.settings().action_block;
//! let config = PlanConfig { action_block, receding_horizon: 1, ..PlanConfig::default() };
//! let action = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
//! let mut mpc = Mpc::new(Box::new(Cem { clip: true, ..Cem::default() }), config, action)?;
//! # let observation = swm_core::Batch::new(Default::default(), 1);
//! // One row with the fields that the model encodes: `pixels`, `goal`.
//! let first = mpc.next(&mut cost, &observation)?;
//! # Ok::<(), swm_core::BoxError>(())
//! ```
//!
//! DIR holds what `docs/onnx.md` asks for, and what the Python package's `stable_worldmodel_rs.export` writes:
//!
//! | file | inputs | outputs |
//! |---|---|---|
//! | `model.json` | – | settings: see [`ModelSettings`] |
//! | `encode.onnx` | fields of the infos by their names: `pixels` `[1, H, W, 3]` u8, `goal`, `proprio` … | any tensors |
//! | `cost.onnx` | these tensors, and `actions` `[S, H, D]` f32 | `cost` `[S]` or `[S, 1]`, f32 or f64 |
//! | `cost_grad.onnx`, optional | the same | `cost`, `gradient` `[S, H, D]` f32 or f64 |
//!
//! With `history` in `model.json`, the fields that it names are `[1, T, …]`, and `action_history` holds the blocks between the frames.
//! H is fixed at the export; S may be open, and is 128 then. Environments go through it one by one, in batches of S candidates,
//! padded with zeros: the bits of a cost depend on its candidate alone. Other shapes are refused, and so is NaN in weights and in
//! encoded tensors.

mod cost;
mod error;
mod history;
mod output;
mod policy;
mod runtime;
mod weights;

pub use cost::{ModelSettings, OnnxCost};
pub use error::OnnxError;
pub use policy::POLICIES;
pub use runtime::{ORT_DYLIB_PATH, find_library, set_python};
