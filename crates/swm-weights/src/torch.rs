//! Files of PyTorch. A pickle is parsed, and nothing in it is executed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::Path;

use pytorch_reader::{DType, FileFormat, PickleError, PytorchError, PytorchReader};

use crate::archive;
use crate::error::WeightsError;
use crate::file::{Contents, Of, Stored, brain, check_sizes, floats, half, kind};
use crate::form::Form;
use crate::pickle::Found;
use crate::pickles::{Container, Pickles};

/// Keys under which trainers store the weights of a model.
const NESTED: [&str; 3] = ["state_dict", "model_state_dict", "model"];
/// How the reader of pickles words that a file of PyTorch holds something else than a dictionary, which it names then.
const NO_DICTIONARY: &str = "Expected a dictionary at the root of the PyTorch file, found ";
/// How it words that a zip archive is another one.
const NO_PICKLE: &str = "No data.pkl entry found";
/// What helps against files of something else.
const ANEW: &str = "save the model's `state_dict()`, in Python: `torch.save(model.state_dict(), FILE)`";
/// How it words that a class of modules stands with its file and source where storages do.
const OLD_MODULE: &str = "storage persistent id has 4 fields";
/// Classes of objects that hold tensors which are no weights; more than so many in a file are passed over by nobody.
const MOST_CLASSES: usize = 16;

pub(crate) fn read(path: &Path, of: Of) -> Result<Contents, WeightsError> {
    let mut file = File::open(path).map_err(|error| WeightsError::unusable(path, error.to_string()))?;
    let unusable = |error: std::io::Error| WeightsError::unusable(path, error.to_string());
    let container = Container::of(&mut file).map_err(unusable)?;
    let pickles = match Pickles::find(&mut file, container) {
        Err(error) if error.kind() == std::io::ErrorKind::FileTooLarge => return Err(unusable(error)),
        found => found.ok().flatten(),
    };
    let nothing = Found::default();
    let found = pickles.as_ref().map_or(&nothing, |pickles| &pickles.found);
    let strange = |(name, form): &(String, Form)| {
        WeightsError::unusable(path, format!("`{name}` is {form}; {}", form.fix()))
    };
    // Before anything is made of it.
    if let Some(view) = found.strange.iter().find(|(_, form)| matches!(form, Form::View { .. })) {
        return Err(strange(view));
    }
    let mut passed_over = Vec::new();
    let changed = |from: &Path, classes: &[String]| {
        let copy = pickles.as_ref().map(|pickles| pickles.copy(from, classes)).transpose();
        copy.map(Option::flatten).map_err(unusable)
    };
    let is_archived = pickles.as_ref().is_some_and(Pickles::is_archived);
    let abutting =
        is_archived.then(|| archive::copy_abutting(&mut file)).transpose().map_err(unusable)?.flatten();
    let from = abutting.as_ref().map_or(path, |copy| copy.path());
    let plain = changed(from, &[])?;
    let mut opened = open(plain.as_ref().map_or(from, |copy| copy.path()), path, container, of);
    // Tensors of an object that is no module, such as those of an optimizer, are no weights.
    while let Err(Failed::Object(class)) = &opened {
        if passed_over.contains(class) || passed_over.len() == MOST_CLASSES {
            break;
        }
        passed_over.push(class.clone());
        if !found.built.iter().any(|(built, _)| built == class) {
            break;
        }
        let Some(copy) = changed(from, &passed_over)? else { break };
        opened = open(copy.path(), path, container, of);
    }
    let contents = opened.map_err(|failed| match (failed, &found.strange[..]) {
        (_, [first, ..]) => strange(first),
        (Failed::Object(class), _) => {
            let reason = format!(
                "its `{class}` holds tensors and is no module; store the weights alone, in Python: \
                 `ckpt = torch.load(FILE, weights_only=False)`, then `torch.save({{k: v.state_dict() for k, v in \
                 ckpt.items() if hasattr(v, \"state_dict\")}}, FILE)`"
            );
            WeightsError::unusable(path, reason)
        }
        (Failed::Other(error), _) => error,
    })?;
    passed_over.extend(contents.passed_over);
    Ok(Contents { calls: found.calls.clone(), passed_over, ..contents })
}

/// Why a file cannot be read.
enum Failed {
    /// An object of this class holds tensors.
    Object(String),
    Other(WeightsError),
}

/// The tensors of the file at `from`; errors are about `path`.
fn open(from: &Path, path: &Path, container: Container, of: Of) -> Result<Contents, Failed> {
    let broken = |error: &dyn std::fmt::Display| {
        let reason = match container {
            Container::Unknown => {
                format!("the file is neither safetensors nor one of torch.save ({error}); {ANEW}")
            }
            _ => format!(
                "the file is one of torch.save, and is damaged or in a form that is not read ({error}): fetch it again, or {ANEW}"
            ),
        };
        Failed::Other(WeightsError::unusable(path, reason))
    };
    let reader = PytorchReader::new(from).map_err(|error| match error {
        PytorchError::Pickle(PickleError::UnsupportedType(class)) => Failed::Object(class),
        PytorchError::InvalidFormat(text) => match text.strip_prefix(NO_DICTIONARY) {
            Some(found) => {
                let reason = format!(
                    "the file holds one object of type `{found}` and no names of tensors; {ANEW}"
                );
                Failed::Other(WeightsError::unusable(path, reason))
            }
            None if text.starts_with(NO_PICKLE) => {
                let reason = format!("the file is a zip archive without `data.pkl`, and none of torch.save; {ANEW}");
                Failed::Other(WeightsError::unusable(path, reason))
            }
            None => broken(&text),
        },
        PytorchError::Pickle(PickleError::InvalidData(text)) if text.starts_with(OLD_MODULE) => {
            let reason = "the file holds a whole module in PyTorch's older format, in a form that is not read; save its weights alone, in Python: \
                          `torch.save(torch.load(FILE, weights_only=False).state_dict(), FILE)`";
            Failed::Other(WeightsError::unusable(path, reason))
        }
        PytorchError::Pickle(PickleError::InvalidData(text)) => match claimed(&text) {
            Some(claim) => Failed::Other(WeightsError::unusable(path, claim)),
            None => broken(&text),
        },
        error => broken(&error),
    })?;
    let format = match reader.metadata().format_type {
        FileFormat::Zip => "zip",
        FileFormat::Tar => "tar",
        FileFormat::Legacy => "legacy",
        FileFormat::Pickle => "pickle",
    };
    let names = reader.keys();
    let nested = NESTED.iter().find(|key| {
        let prefix = format!("{key}.");
        names.iter().any(|name| name.starts_with(&prefix))
    });
    let inside = nested.and_then(|key| Some((PytorchReader::with_top_level_key(from, key).ok()?, key)));
    let (reader, passed_over) = match inside {
        Some((inside, key)) => (inside, copies(&names, key)),
        None => (reader, Vec::new()),
    };
    // A file of ours can be empty: the state of a training before its first step.
    if reader.tensors().is_empty() {
        return Err(Failed::Other(WeightsError::unusable(
            path,
            format!("the file holds no tensors; {ANEW}"),
        )));
    }
    let all = reader.tensors().iter().map(|(name, tensor)| (name.as_str(), tensor.shape()));
    check_sizes(path, all).map_err(Failed::Other)?;
    let mut tensors = BTreeMap::new();
    for (name, tensor) in reader.into_tensors() {
        let bytes = match of {
            Of::Values => tensor.read().map_err(|error| {
                let reason =
                    format!("`{name}` cannot be read ({error}), and the file is damaged: fetch it again");
                Failed::Other(WeightsError::unusable(path, reason))
            })?,
            Of::Shapes => Vec::new(),
        };
        // The reader gives bytes in the order of this machine.
        let values = match tensor.dtype() {
            DType::F32 => floats(&bytes, f32::from_ne_bytes),
            DType::F64 => floats(&bytes, |bytes| f64::from_ne_bytes(bytes) as f32),
            DType::F16 => floats(&bytes, |bytes: [u8; 2]| half(u16::from_ne_bytes(bytes).to_le_bytes())),
            DType::BF16 => floats(&bytes, |bytes: [u8; 2]| brain(u16::from_ne_bytes(bytes).to_le_bytes())),
            DType::I64 => floats(&bytes, |bytes| i64::from_ne_bytes(bytes) as f32),
            DType::I32 => floats(&bytes, |bytes| i32::from_ne_bytes(bytes) as f32),
            DType::Bool | DType::U8 => floats(&bytes, |[byte]: [u8; 1]| byte.into()),
            other => return Err(Failed::Other(kind(path, &name, &format!("{other:?}")))),
        };
        let is_whole = matches!(tensor.dtype(), DType::I64 | DType::I32 | DType::Bool | DType::U8);
        tensors.insert(name, Stored { shape: tensor.shape().to_vec(), values, is_whole });
    }
    Ok(Contents { tensors, format, passed_over, ..Contents::default() })
}

/// What is wrong with a tensor that would be larger than the reader of pickles makes any, by its words.
fn claimed(text: &str) -> Option<String> {
    let (shape, _) = text.strip_prefix("Tensor with shape ")?.split_once(" would materialize ")?;
    Some(format!(
        "a tensor of shape {shape} is larger than any that is read; store its parts as tensors of their own"
    ))
}

/// Keys beside `nested` below which its tensors are once more, such as averaged ones.
fn copies(names: &[String], nested: &str) -> Vec<String> {
    let parts = || names.iter().filter_map(|name| name.split_once('.'));
    let inside: BTreeSet<&str> = parts().filter(|(key, _)| *key == nested).map(|(_, name)| name).collect();
    let others = parts().filter(|(key, name)| *key != nested && inside.contains(name));
    others.map(|(key, _)| key.to_owned()).collect::<BTreeSet<_>>().into_iter().collect()
}
