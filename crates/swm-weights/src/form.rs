//! Forms of tensors that are not read, told by what a pickle rebuilds them from.

use std::fmt;
use std::rc::Rc;

/// A view of more bytes than this, over fewer, is no weight: a pickle can claim terabytes over one value.
const LARGEST_VIEW: u64 = 1 << 30;

/// A form of a tensor that is not read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Form {
    /// Sparse, quantized, of a type that there is none of here.
    Kind(Rc<str>),
    /// A view of so many bytes over the fewer that are stored.
    View { bytes: u64, stored: u64 },
}

impl Form {
    /// A form by its name.
    pub(crate) fn kind(name: &str) -> Self {
        Self::Kind(name.into())
    }

    /// What a tensor of this shape is, of items of so many bytes over so many bytes that are stored; `None`: one that is read.
    pub(crate) fn of_view(shape: impl Iterator<Item = u64>, item: u64, stored: u64) -> Option<Self> {
        let bytes = shape.fold(item, u64::saturating_mul);
        (bytes > stored && bytes > LARGEST_VIEW).then_some(Self::View { bytes, stored })
    }

    /// What to do about it.
    pub(crate) fn fix(&self) -> &'static str {
        match self {
            Self::Kind(_) => "store it as a dense tensor of 32- or 16-bit floats",
            Self::View { .. } => "store the tensor that it is a view of",
        }
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Kind(name) => f.write_str(name),
            Self::View { bytes, stored } => write!(f, "a view of {} over {}", size(*bytes), size(*stored)),
        }
    }
}

/// Bytes in the largest unit of which there is one.
fn size(bytes: u64) -> String {
    let units = ["bytes", "KiB", "MiB", "GiB", "TiB", "PiB", "EiB"];
    let power = (bytes.max(1).ilog2() / 10) as usize;
    let count = bytes as f64 / (1_u64 << (10 * power)) as f64;
    format!("{} {}", (count * 10.0).round() / 10.0, units[power])
}

/// Bytes of an item of a class of storages, such as `torch.FloatStorage`, or of a type, such as `torch.float64`.
pub(crate) fn item_size(class: &str) -> u64 {
    let has = |parts: &[&str]| parts.iter().any(|part| class.contains(part));
    match () {
        () if class.ends_with("UntypedStorage") => 1,
        () if has(&["128", "ComplexDouble"]) => 16,
        () if has(&["64", "Double", "Long", "ComplexFloat"]) => 8,
        () if has(&["16", "Half", "Short"]) => 2,
        () if has(&["8", "Byte", "Char", "Bool", "bool"]) => 1,
        () => 4,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_those_of_pytorch() {
        let sizes = [
            ("torch.FloatStorage", 4),
            ("torch.DoubleStorage", 8),
            ("torch.BFloat16Storage", 2),
            ("torch.BoolStorage", 1),
            ("torch.storage.UntypedStorage", 1),
            ("torch.float8_e4m3fn", 1),
            ("torch.complex64", 8),
            ("torch.uint32", 4),
        ];
        for (class, bytes) in sizes {
            assert_eq!(item_size(class), bytes, "{class}");
        }
        assert_eq!(
            [0, 4, 1536, 1 << 42, u64::MAX].map(size),
            ["0 bytes", "4 bytes", "1.5 KiB", "4 TiB", "16 EiB"]
        );
    }
}
