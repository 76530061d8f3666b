//! Files as `torch.save` writes a `state_dict`: a zip archive of a pickle and the bytes of each tensor, all stored as they are.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use crate::archive::Checksum;

/// The folder within the archive.
const ROOT: &str = "weights";
/// Bytes of tensors begin at multiples of this, as PyTorch has it.
const ALIGNMENT: u64 = 64;
/// A larger archive would need records that not every reader knows.
const LARGEST: u64 = u32::MAX as u64;

/// The values of a tensor to write.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// 32-bit floats.
    Floats(Vec<f32>),
    /// 64-bit whole numbers.
    Integers(Vec<i64>),
    /// Truth values, one byte each.
    Bools(Vec<bool>),
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Self::Floats(values) => values.len(),
            Self::Integers(values) => values.len(),
            Self::Bools(values) => values.len(),
        }
    }

    /// PyTorch's class of their storage.
    fn class(&self) -> &'static str {
        match self {
            Self::Floats(_) => "FloatStorage",
            Self::Integers(_) => "LongStorage",
            Self::Bools(_) => "BoolStorage",
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Floats(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Integers(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::Bools(values) => values.iter().map(|value| u8::from(*value)).collect(),
        }
    }
}

/// A tensor to write: its name, shape and values, row-major.
pub type Saved = (String, Vec<usize>, Values);

/// Writes tensors, in this order.
///
/// # Errors
///
/// The operating system refuses, or a zip archive cannot list so much.
pub fn save(path: &Path, tensors: &[Saved]) -> io::Result<()> {
    save_as(ROOT, path, &pickle(tensors), tensors)
}

/// Writes an archive below this folder within it.
pub(crate) fn save_as(root: &'static str, path: &Path, pickle: &[u8], tensors: &[Saved]) -> io::Result<()> {
    let mut archive = Archive { out: BufWriter::new(File::create(path)?), root, at: 0, entries: Vec::new() };
    archive.add("data.pkl", pickle)?;
    archive.add("byteorder", b"little")?;
    for (index, (.., values)) in tensors.iter().enumerate() {
        archive.add(&format!("data/{index}"), &values.bytes())?;
    }
    archive.add("version", b"3\n")?;
    let mut out = archive.finish()?;
    out.flush()?;
    out.get_ref().sync_all()
}

/// An `OrderedDict` of tensors, each with a storage of its own; protocol 2.
fn pickle(tensors: &[Saved]) -> Vec<u8> {
    let mut out = b"\x80\x02ccollections\nOrderedDict\n)R(".to_vec();
    for (index, (name, shape, values)) in tensors.iter().enumerate() {
        text(&mut out, name);
        out.extend_from_slice(b"ctorch._utils\n_rebuild_tensor_v2\n((");
        text(&mut out, "storage");
        out.extend_from_slice(format!("ctorch\n{}\n", values.class()).as_bytes());
        text(&mut out, &index.to_string());
        text(&mut out, "cpu");
        number(&mut out, values.len());
        // The storage by its number, from its first value on.
        out.extend_from_slice(b"tQ");
        number(&mut out, 0);
        numbers(&mut out, shape);
        let strides = (0..shape.len()).map(|axis| shape[axis + 1..].iter().product());
        numbers(&mut out, &strides.collect::<Vec<usize>>());
        // Without gradients and without hooks.
        out.extend_from_slice(b"\x89ccollections\nOrderedDict\n)RtR");
    }
    out.extend_from_slice(b"u.");
    out
}

pub(crate) fn text(out: &mut Vec<u8>, text: &str) {
    out.push(b'X');
    out.extend_from_slice(&(text.len() as u32).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
}

pub(crate) fn number(out: &mut Vec<u8>, number: usize) {
    match i32::try_from(number) {
        Ok(number) => {
            out.push(b'J');
            out.extend_from_slice(&number.to_le_bytes());
        }
        Err(_) => {
            out.extend_from_slice(b"\x8a\x08");
            out.extend_from_slice(&(number as u64).to_le_bytes());
        }
    }
}

pub(crate) fn numbers(out: &mut Vec<u8>, all: &[usize]) {
    out.push(b'(');
    all.iter().for_each(|one| number(out, *one));
    out.push(b't');
}

/// A zip archive that is being written.
struct Archive<W> {
    out: W,
    root: &'static str,
    at: u64,
    entries: Vec<Entry>,
}

struct Entry {
    name: String,
    checksum: u32,
    len: u32,
    start: u32,
}

impl<W: Write> Archive<W> {
    fn add(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let name = format!("{}/{name}", self.root);
        let mut sum = Checksum::default();
        sum.add(bytes);
        let too_large = || {
            io::Error::new(
                io::ErrorKind::FileTooLarge,
                "the weights are larger than 4 GiB, which zip archives end at",
            )
        };
        let len = u32::try_from(bytes.len()).map_err(|_| too_large())?;
        let start = u32::try_from(self.at).map_err(|_| too_large())?;
        let entry = Entry { name, checksum: sum.value(), len, start };
        let begin = self.at + 30 + entry.name.len() as u64;
        // An extra field of four bytes and zeros, so that the content is aligned.
        let padding = (ALIGNMENT - (begin + 4) % ALIGNMENT) % ALIGNMENT;
        if begin + 4 + padding + u64::from(len) > LARGEST {
            return Err(too_large());
        }
        let mut head = b"PK\x03\x04".to_vec();
        entry.write(&mut head, 4 + padding as u16);
        head.extend_from_slice(entry.name.as_bytes());
        head.extend_from_slice(b"FB");
        head.extend_from_slice(&(padding as u16).to_le_bytes());
        head.resize(head.len() + padding as usize, 0);
        self.out.write_all(&head)?;
        self.out.write_all(bytes)?;
        self.at += head.len() as u64 + u64::from(len);
        self.entries.push(entry);
        Ok(())
    }

    fn finish(mut self) -> io::Result<W> {
        let start = self.at;
        let mut tail = Vec::new();
        for entry in &self.entries {
            tail.extend_from_slice(b"PK\x01\x02\x00\x00");
            entry.write(&mut tail, 0);
            tail.extend_from_slice(&[0; 10]);
            tail.extend_from_slice(&entry.start.to_le_bytes());
            tail.extend_from_slice(entry.name.as_bytes());
        }
        let too_many = |_| {
            io::Error::new(io::ErrorKind::FileTooLarge, "the model has more tensors than a zip archive lists")
        };
        let count = u16::try_from(self.entries.len()).map_err(too_many)?;
        let (length, start) = (tail.len() as u32, u32::try_from(start).map_err(too_many)?);
        tail.extend_from_slice(b"PK\x05\x06\x00\x00\x00\x00");
        tail.extend_from_slice(&count.to_le_bytes());
        tail.extend_from_slice(&count.to_le_bytes());
        tail.extend_from_slice(&length.to_le_bytes());
        tail.extend_from_slice(&start.to_le_bytes());
        tail.extend_from_slice(&[0; 2]);
        self.out.write_all(&tail)?;
        Ok(self.out)
    }
}

impl Entry {
    /// What both records of an entry share: from the version on to the length of the extra field.
    fn write(&self, out: &mut Vec<u8>, extra: u16) {
        let &Self { ref name, checksum, len, .. } = self;
        // Version 2.0, names in UTF-8, stored, 1 January 1980.
        out.extend_from_slice(&[20, 0, 0, 8, 0, 0, 0, 0, 0x21, 0]);
        out.extend_from_slice(&checksum.to_le_bytes());
        out.extend_from_slice(&len.to_le_bytes());
        out.extend_from_slice(&len.to_le_bytes());
        out.extend_from_slice(&(name.len() as u16).to_le_bytes());
        out.extend_from_slice(&extra.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Of, Stored, contents};

    #[test]
    fn what_is_saved_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.pt");
        let tensors = [
            ("a.weight".to_owned(), vec![2, 3], Values::Floats((0..6).map(|value| value as f32).collect())),
            ("a.mask".to_owned(), vec![1, 2], Values::Bools(vec![true, false])),
            ("a.count".to_owned(), Vec::new(), Values::Integers(vec![7])),
        ];
        save(&path, &tensors).unwrap();
        let found = contents(&path, Of::Values).unwrap();
        assert_eq!((found.format, found.calls.len(), found.passed_over.len()), ("zip", 0, 0));
        let stored = |shape: &[usize], values: &[f32], is_whole| Stored {
            shape: shape.to_vec(),
            values: values.to_vec(),
            is_whole,
        };
        assert_eq!(found.tensors["a.weight"], stored(&[2, 3], &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0], false));
        assert_eq!(found.tensors["a.mask"], stored(&[1, 2], &[1.0, 0.0], true));
        assert_eq!(found.tensors["a.count"].values, [7.0]);
        // The content of each tensor is aligned, and the archive's checksum is that of its bytes.
        let bytes = std::fs::read(&path).unwrap();
        let at = bytes
            .windows(24)
            .position(|window| window == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0_f32].map(f32::to_le_bytes).concat());
        assert_eq!(at.unwrap() as u64 % ALIGNMENT, 0);
    }

    /// The folder in an archive is the file's stem, and PyTorch writes 76 bytes of records of large archives before the end: as long as
    /// the list's first entry is with 21 letters.
    #[test]
    fn archives_of_any_name_are_read_with_the_records_that_pytorch_writes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.pt");
        let tensors = [
            ("a".to_owned(), vec![1], Values::Floats(vec![1.5])),
            ("b".to_owned(), vec![1], Values::Floats(vec![2.5])),
        ];
        for root in ["lewm_epoch_10_object", "lewm_epoch_100_object", "lewm_epoch_1000_object"] {
            save_as(root, &path, &pickle(&tensors), &tensors).unwrap();
            let bytes = std::fs::read(&path).unwrap();
            let (list, end) = bytes.split_at(bytes.len() - 22);
            let count = u64::from(u16::from_le_bytes([end[10], end[11]]));
            let of = |at: usize| u64::from(u32::from_le_bytes(end[at..at + 4].try_into().unwrap()));
            let mut large = b"PK\x06\x06".to_vec();
            large.extend_from_slice(&44_u64.to_le_bytes());
            large.extend_from_slice(&[45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
            [count, count, of(12), of(16)]
                .iter()
                .for_each(|number| large.extend_from_slice(&number.to_le_bytes()));
            large.extend_from_slice(b"PK\x06\x07\x00\x00\x00\x00");
            large.extend_from_slice(&(list.len() as u64).to_le_bytes());
            large.extend_from_slice(&1_u32.to_le_bytes());
            assert_eq!(large.len(), 76);
            std::fs::write(&path, [list, &large, end].concat()).unwrap();
            let found = contents(&path, Of::Values).unwrap().tensors;
            assert_eq!((&found["a"].values[..], &found["b"].values[..]), (&[1.5][..], &[2.5][..]), "{root}");
        }
    }
    #[test]
    fn copies_of_the_weights_are_named_and_other_objects_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.pt");
        let tensors = [("a.b".to_owned(), vec![1], Values::Floats(vec![1.5]))];
        let whole = pickle(&tensors);
        // {"model": …, "ema": …, "epoch": 3}
        let mut nested = b"\x80\x02}(".to_vec();
        for key in ["model", "ema"] {
            text(&mut nested, key);
            nested.extend_from_slice(&whole[2..whole.len() - 1]);
        }
        text(&mut nested, "epoch");
        number(&mut nested, 3);
        nested.extend_from_slice(b"u.");
        save_as(ROOT, &path, &nested, &tensors).unwrap();
        let found = contents(&path, Of::Shapes).unwrap();
        assert_eq!((found.tensors.len(), &found.passed_over[..]), (1, &["ema".to_owned()][..]));

        let mut list = b"\x80\x02]".to_vec();
        text(&mut list, "a");
        list.extend_from_slice(b"a.");
        save_as(ROOT, &path, &list, &[]).unwrap();
        let message = contents(&path, Of::Shapes).unwrap_err().to_string();
        assert!(
            message.contains("holds one object of type `list`") && message.contains("state_dict()"),
            "{message}"
        );
    }
}
