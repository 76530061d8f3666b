//! Files of weights: safetensors both ways, PyTorch's `.pt`, `.pth` and `.ckpt` one way. A pickle is parsed, and nothing
//! in it is executed.
//!
//! A network takes all tensors of a file or none: what is missing, left over, or of another shape is an error that
//! lists it.

mod file;
mod rename;

use std::path::Path;

use burn::module::Module;

use crate::error::BaselineError;
use crate::params;

#[cfg(test)]
pub(crate) use file::Stored;
pub(crate) use file::{read, write};
#[cfg(test)]
pub(crate) use rename::ours;

/// Writes all tensors of a network.
pub(crate) fn save_network<M: Module>(network: &M, path: &Path) -> Result<(), BaselineError> {
    let mut tensors = Vec::new();
    params::visit(network, |spec, tensor| {
        tensors.push((spec.name.clone(), spec.shape.clone(), params::to_host(spec, tensor)));
    });
    write(path, tensors)
}

/// A copy of the network with the weights of a file.
pub(crate) fn load_network<M: Module>(network: &M, path: &Path) -> Result<M, BaselineError> {
    load_below(network, path, "")
}

/// As [`load_network`], for the tensors below a prefix (`encoder`), which their names in the file lack; or from the weights of a
/// whole model, whose other tensors are left alone.
pub(crate) fn load_below<M: Module>(network: &M, path: &Path, prefix: &str) -> Result<M, BaselineError> {
    let mut stored = rename::to_ours(read(path)?);
    let part_of_model = |name: &str| name.strip_prefix(prefix)?.strip_prefix('.').map(str::to_owned);
    if stored.keys().any(|name| part_of_model(name).is_some()) {
        stored =
            stored.into_iter().filter_map(|(name, tensor)| Some((part_of_model(&name)?, tensor))).collect();
    }
    let (mut missing, mut wrong) = (Vec::new(), Vec::new());
    let specs: Vec<_> = params::specs(network).into_iter().filter(|spec| spec.is_below(&[prefix])).collect();
    for spec in &specs {
        let name = below(&spec.name, prefix);
        match stored.get(name) {
            None => missing.push(name.to_owned()),
            Some(tensor) if tensor.shape != spec.shape => {
                wrong.push(format!("{name} ({:?} in the file, {:?} in the model)", tensor.shape, spec.shape));
            }
            Some(_) => {}
        }
    }
    let names: Vec<&str> = specs.iter().map(|spec| below(&spec.name, prefix)).collect();
    let mut unused: Vec<String> =
        stored.keys().filter(|name| !names.contains(&name.as_str())).cloned().collect();
    unused.sort_unstable();
    if !(missing.is_empty() && unused.is_empty() && wrong.is_empty()) {
        return Err(BaselineError::Mismatch { path: path.to_owned(), missing, unused, wrong });
    }
    Ok(params::map(network.clone(), |spec, tensor| {
        let stored = spec.is_below(&[prefix]).then(|| stored.remove(below(&spec.name, prefix))).flatten();
        match stored {
            Some(stored) => params::from_host(spec, stored.values, &tensor),
            None => tensor,
        }
    }))
}

/// A name without a prefix and its dot.
fn below<'a>(name: &'a str, prefix: &str) -> &'a str {
    name.strip_prefix(prefix).unwrap_or(name).trim_start_matches('.')
}
