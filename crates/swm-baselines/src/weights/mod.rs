//! From files of weights to networks and back. Files have the names of their writers, networks those of transformers 5.
//!
//! A network takes all tensors of a file or none: what is missing, left over, or of another shape is an error that
//! lists it.

mod facebook;
mod rename;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use burn::module::Module;

use crate::error::BaselineError;
use swm_nn::params;
use swm_weights::{Stored, read, write};

pub use rename::{averaged, is_archive, ours, to_ours, vector_keys};

/// Writes all tensors of a network.
pub(crate) fn save_network<M: Module>(network: &M, path: &Path) -> Result<(), BaselineError> {
    let mut tensors = Vec::new();
    params::visit(network, |spec, tensor| {
        tensors.push((spec.name.clone(), spec.shape.clone(), params::to_host(spec, tensor)));
    });
    Ok(write(path, tensors)?)
}

/// A copy of the network with the weights of a file.
pub(crate) fn load_network<M: Module>(network: &M, path: &Path) -> Result<M, BaselineError> {
    load_below(network, path, "")
}

/// As [`load_network`], of tensors that were read from the file at `path`, which are not renamed.
pub(crate) fn load_stored<M: Module>(
    network: &M,
    path: &Path,
    stored: BTreeMap<String, Stored>,
) -> Result<M, BaselineError> {
    Ok(take(network, path, stored, "", &[])?.0)
}

/// As [`load_network`], for the tensors below a prefix (`encoder`), which their names in the file lack; or from the weights of a
/// whole model, whose other tensors are left alone.
pub(crate) fn load_below<M: Module>(network: &M, path: &Path, prefix: &str) -> Result<M, BaselineError> {
    let mut stored = to_ours(read(path)?);
    let part_of_model = |name: &str| name.strip_prefix(prefix)?.strip_prefix('.').map(str::to_owned);
    if stored.keys().any(|name| part_of_model(name).is_some()) {
        stored =
            stored.into_iter().filter_map(|(name, tensor)| Some((part_of_model(&name)?, tensor))).collect();
    }
    Ok(take(network, path, stored, prefix, &[])?.0)
}

/// As [`load_network`], where what is below `dispensable` may be missing, and then stays as it is; and the names of that.
pub(crate) fn load_for_use<M: Module>(
    network: &M,
    path: &Path,
    dispensable: &[&str],
) -> Result<(M, Vec<String>), BaselineError> {
    take(network, path, to_ours(read(path)?), "", dispensable)
}

/// A copy of the network whose tensors below `prefix` are those of a file, which lacks nothing but what is `dispensable`; and the names
/// of what it lacks.
fn take<M: Module>(
    network: &M,
    path: &Path,
    mut stored: BTreeMap<String, Stored>,
    prefix: &str,
    dispensable: &[&str],
) -> Result<(M, Vec<String>), BaselineError> {
    let (mut missing, mut wrong, mut lacks) = (Vec::new(), Vec::new(), Vec::new());
    let specs: Vec<_> = params::specs(network).into_iter().filter(|spec| spec.is_below(&[prefix])).collect();
    for spec in &specs {
        let name = below(&spec.name, prefix);
        match stored.get(name) {
            None if spec.is_below(dispensable) => lacks.push(name.to_owned()),
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
        let fit = specs.len() - missing.len() - wrong.len() - lacks.len();
        let fits = [fit, specs.len()];
        let first = |name: &String| name.split('.').next().map(str::to_owned);
        let found = stored.keys().filter_map(first).collect::<BTreeSet<_>>().into_iter().collect();
        let wrong = wrong.into();
        return Err(BaselineError::Mismatch { path: path.to_owned(), fits, missing, unused, wrong, found });
    }
    check_values(path, &stored)?;
    let network = params::map(network.clone(), |spec, tensor| {
        let stored = spec.is_below(&[prefix]).then(|| stored.remove(below(&spec.name, prefix))).flatten();
        match stored {
            Some(stored) => params::from_host(spec, stored.values, &tensor),
            None => tensor,
        }
    });
    Ok((network, lacks))
}

/// Refuses values that no training leaves behind.
fn check_values(path: &Path, stored: &BTreeMap<String, Stored>) -> Result<(), BaselineError> {
    for (name, Stored { values, is_whole, .. }) in stored {
        let reason = if values.iter().any(|value| !value.is_finite()) {
            "holds values that are not finite; the file is of no use"
        } else if name.ends_with("running_var") && values.iter().any(|value| *value < 0.0) {
            "holds a variance below 0; the file is of no use"
        } else if *is_whole {
            "holds whole numbers where weights belong; store them as 32- or 16-bit floats"
        } else {
            continue;
        };
        return Err(BaselineError::weights(path, format!("`{name}` {reason}")));
    }
    Ok(())
}

/// A name without a prefix and its dot.
fn below<'a>(name: &'a str, prefix: &str) -> &'a str {
    name.strip_prefix(prefix).unwrap_or(name).trim_start_matches('.')
}
