//! What a pickle would do if Python loaded it: found by following its stack, of which only classes and names matter.
//! Nothing is executed, and no object is made.

use std::collections::HashMap;
use std::rc::Rc;

use crate::form::{Form, item_size};

/// What was found in a pickle.
#[derive(Debug, Default)]
pub(crate) struct Found {
    /// Functions that Python would call and that make no tensor, such as `builtins.print`.
    pub(crate) calls: Vec<String>,
    /// Tensors of a form that is not read: their name, and the form.
    pub(crate) strange: Vec<(String, Form)>,
    /// Where an object gets its attributes: its class, and the place of the opcode.
    pub(crate) built: Vec<(String, usize)>,
    /// Classes of modules in the form of the older container.
    modules: Vec<Module>,
    /// Where the last whole pickle ends.
    pub(crate) end: usize,
    /// Whether the bytes end within a pickle.
    pub(crate) is_cut: bool,
}

/// A class of modules that stands in the file with its source: what is in the place of `(tag, class, file, source)` from the end of that tuple
/// on, and the key under which the tuple is kept.
#[derive(Debug)]
struct Module {
    start: usize,
    end: usize,
    key: u32,
}

/// A value on the stack.
#[derive(Clone)]
enum Slot {
    Mark,
    Text(Rc<str>),
    Class(Rc<str>),
    /// An object of this class.
    Object(Rc<str>),
    Number(i64),
    /// A tuple of a few values, and how deeply it is nested.
    Tuple(Rc<[Slot]>, u8),
    /// The values of a tensor: bytes of an item, and of all.
    Storage {
        item: u64,
        bytes: u64,
    },
    /// What belongs to a tensor of this form.
    Strange(Form),
    Other,
}

/// Modules whose functions a checkpoint calls when it is loaded as its writer meant it.
const USUAL: &[&str] = &[
    "torch.",
    "collections.",
    "numpy.",
    "_codecs.encode",
    "copyreg.",
    "copy_reg.",
    "functools.partial",
    "pathlib.",
    "datetime.",
    "omegaconf.",
    "argparse.Namespace",
];
/// Built-in types among them.
const TYPES: [&str; 12] = [
    "set",
    "frozenset",
    "dict",
    "list",
    "tuple",
    "bytearray",
    "complex",
    "slice",
    "range",
    "object",
    "int",
    "float",
];

/// More names of functions say no more.
const MOST: usize = 32;
/// The arguments of a tensor are tuples of no more values, and no deeper; none larger is followed.
const MOST_PARTS: usize = 64;
const DEEPEST: u8 = 4;

/// Looks through so many pickles, one after the other, as far as they can be followed.
pub(crate) fn look_through(bytes: &[u8], count: usize) -> Found {
    let mut machine = Machine {
        bytes,
        at: 0,
        stack: Vec::new(),
        memo: HashMap::new(),
        tuple_at: None,
        has_stopped: false,
        found: Found::default(),
    };
    for _ in 0..count {
        while machine.step().is_some() {}
        if !machine.has_stopped {
            break;
        }
        (machine.found.end, machine.has_stopped) = (machine.at, false);
        machine.stack.clear();
        machine.memo.clear();
    }
    machine.found
}

impl Found {
    /// Takes over what was found in another pickle, but for places in it.
    pub(crate) fn add(&mut self, other: Self) {
        self.calls.extend(other.calls);
        self.strange.extend(other.strange);
    }

    /// The pickles without the attributes of objects of these classes: where they would be set, they are dropped. Of classes of modules in the
    /// older form, the class alone is left, as newer files have it. `None`: nothing changes.
    pub(crate) fn changed(&self, bytes: &[u8], classes: &[String]) -> Option<Vec<u8>> {
        let pop = |(_, place): &(String, usize)| (*place, *place + 1, b"0".to_vec());
        let dropped = self.built.iter().filter(|(class, _)| classes.contains(class)).map(pop);
        let alone = self.modules.iter().map(|module| {
            // Drops source and file, keeps the class under the tuple's key, drops all from the mark on, and fetches the class. No other key moves.
            let key = module.key.to_le_bytes();
            let code = [&b"00r"[..], &key, b"1j", &key].concat();
            (module.start, module.end, code)
        });
        let mut edits: Vec<(usize, usize, Vec<u8>)> = dropped.chain(alone).collect();
        edits.sort();
        let (mut changed, mut at) = (Vec::new(), 0);
        for (start, end, code) in &edits {
            changed.extend_from_slice(bytes.get(at..*start)?);
            changed.extend_from_slice(code);
            at = *end;
        }
        changed.extend_from_slice(bytes.get(at..)?);
        (!edits.is_empty()).then_some(changed)
    }
}

/// The form of the tensor that a call rebuilds, if it is one that is not read.
fn strange(function: &str, args: &Slot) -> Option<Form> {
    match (function, args) {
        (_, Slot::Strange(form)) => Some(form.clone()),
        (name, _) if name.starts_with("torch._utils._rebuild_sparse") => Some(Form::kind("sparse")),
        ("torch._utils._rebuild_qtensor", _) => Some(Form::kind("quantized")),
        ("torch._utils._rebuild_nested_tensor", _) => Some(Form::kind("nested")),
        ("torch._utils._rebuild_meta_tensor_no_storage", _) => {
            Some(Form::kind("on the device `meta`, without values"))
        }
        ("torch._tensor._rebuild_from_type_v2", Slot::Tuple(parts, _)) => match &parts[..] {
            [Slot::Class(function), _, args, ..] => strange(function, args),
            _ => None,
        },
        (name, Slot::Tuple(parts, _)) if name.starts_with("torch._utils._rebuild_tensor") => {
            let dtype = match parts.get(6) {
                Some(Slot::Class(dtype)) => Some(dtype),
                _ => None,
            };
            if let Some(dtype) = dtype.filter(|dtype| dtype.starts_with("torch.float8")) {
                return Some(Form::Kind(format!("of type {dtype}").into()));
            }
            let [Slot::Storage { item, bytes }, _, Slot::Tuple(shape, _), ..] = &parts[..] else {
                return None;
            };
            let dims = shape.iter().map(|dim| match dim {
                Slot::Number(dim) => u64::try_from(*dim).unwrap_or(0),
                _ => 0,
            });
            Form::of_view(dims, dtype.map_or(*item, |dtype| item_size(dtype)), *bytes)
        }
        _ => None,
    }
}

/// The class of a module, where that stands with its file and source.
fn module_class(id: &Slot) -> Option<Rc<str>> {
    let Slot::Tuple(parts, _) = id else { return None };
    match &parts[..] {
        [Slot::Text(tag), Slot::Class(class), _, _] if &**tag == "module" => Some(class.clone()),
        _ => None,
    }
}

/// What stands in the place of a storage.
fn persistent(id: Slot) -> Slot {
    match id {
        strange @ Slot::Strange(_) => strange,
        Slot::Tuple(parts, _) => match &parts[..] {
            [Slot::Text(tag), Slot::Class(class), _, _, Slot::Number(count), ..] if &**tag == "storage" => {
                let item = item_size(class);
                Slot::Storage { item, bytes: u64::try_from(*count).unwrap_or(0).saturating_mul(item) }
            }
            _ => Slot::Other,
        },
        _ => Slot::Other,
    }
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    stack: Vec<Slot>,
    memo: HashMap<u64, Slot>,
    /// Where the last tuple was made of what is above a mark.
    tuple_at: Option<usize>,
    /// Whether the pickle has ended as pickles do.
    has_stopped: bool,
    found: Found,
}

impl Machine<'_> {
    fn take(&mut self, count: usize) -> Option<&[u8]> {
        let end = self.at.saturating_add(count);
        let taken = self.bytes.get(self.at..end);
        self.found.is_cut |= taken.is_none();
        self.at = end;
        taken
    }

    fn number(&mut self, bytes: usize) -> Option<u64> {
        Some(self.take(bytes)?.iter().rev().fold(0, |value, byte| value << 8 | u64::from(*byte)))
    }

    fn line(&mut self) -> Option<Rc<str>> {
        let len = self.bytes.get(self.at..)?.iter().position(|byte| *byte == b'\n');
        self.found.is_cut |= len.is_none();
        let len = len?;
        let text = String::from_utf8_lossy(self.take(len)?).into();
        self.at += 1;
        Some(text)
    }

    /// Skips bytes whose number comes first, in so many bytes.
    fn skip(&mut self, length_bytes: usize) -> Option<&[u8]> {
        let len = self.number(length_bytes)?;
        self.take(usize::try_from(len).ok()?)
    }

    fn text(&mut self, length_bytes: usize) -> Option<()> {
        let text = String::from_utf8_lossy(self.skip(length_bytes)?).into();
        self.push(Slot::Text(text))
    }

    fn push(&mut self, slot: Slot) -> Option<()> {
        self.stack.push(slot);
        Some(())
    }

    fn pop(&mut self) -> Option<Slot> {
        self.stack.pop()
    }

    fn pop_to_mark(&mut self) -> Option<Vec<Slot>> {
        let mark = self.stack.iter().rposition(|slot| matches!(slot, Slot::Mark))?;
        let above = self.stack.split_off(mark + 1);
        self.stack.pop();
        Some(above)
    }

    /// A whole number of so many bytes, the highest bit of which is its sign.
    fn integer(&mut self, bytes: usize) -> Option<()> {
        let taken = self.take(bytes)?;
        let is_negative = taken.last().is_some_and(|byte| byte >> 7 == 1);
        let value = match bytes {
            0..=8 => {
                let mut all = [if is_negative { 0xff } else { 0 }; 8];
                all[..bytes].copy_from_slice(taken);
                Slot::Number(i64::from_le_bytes(all))
            }
            _ => Slot::Other,
        };
        self.push(value)
    }

    /// A tuple of these.
    fn tuple(&mut self, parts: &[Slot]) -> Option<()> {
        let of = |part: &Slot| match part {
            Slot::Strange(form) => Some(form.clone()),
            Slot::Class(name) if name.starts_with("torch.Complex") => Some(Form::kind("complex")),
            _ => None,
        };
        if let Some(form) = parts.iter().find_map(of) {
            return self.push(Slot::Strange(form));
        }
        let inner = |part: &Slot| match part {
            Slot::Tuple(_, depth) => *depth,
            _ => 0,
        };
        let depth = 1 + parts.iter().map(inner).max().unwrap_or(0);
        let is_followed = parts.len() <= MOST_PARTS && depth <= DEEPEST;
        self.push(if is_followed { Slot::Tuple(parts.into(), depth) } else { Slot::Other })
    }

    fn last(&mut self, count: usize) -> Option<()> {
        let parts = self.stack.split_off(self.stack.len().checked_sub(count)?);
        self.tuple(&parts)
    }

    fn put(&mut self, key: u64) -> Option<()> {
        let slot = self.stack.last()?.clone();
        self.memo.insert(key, slot);
        Some(())
    }

    fn get(&mut self, key: u64) -> Option<()> {
        let slot = self.memo.get(&key)?.clone();
        self.push(slot)
    }

    /// The class of a module in the older form, which an opcode at `place` has just made of the last tuple.
    fn module(&mut self, place: usize) {
        let Some(start) = self.tuple_at else { return };
        // Between both, nothing but the tuple is kept: else it is another tuple, or another form.
        let key = match self.bytes.get(start + 1..place) {
            Some([b'q', key]) => u32::from(*key),
            Some(&[b'r', a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
            Some([0x94]) => (self.memo.len() - 1) as u32,
            _ => return,
        };
        self.found.modules.push(Module { start, end: place + 1, key });
    }

    /// Puts a value below a name.
    fn name(&mut self, key: &Slot, value: &Slot) {
        if let (Slot::Text(name), Slot::Strange(form)) = (key, value)
            && self.found.strange.len() < MOST
        {
            self.found.strange.push((name.to_string(), form.clone()));
        }
    }

    fn call(&mut self, callable: Slot, args: &Slot) -> Option<()> {
        let Slot::Class(name) = callable else { return self.push(Slot::Other) };
        let is_type = || {
            let type_name = name.strip_prefix("builtins.").or_else(|| name.strip_prefix("__builtin__."));
            type_name.is_some_and(|name| TYPES.contains(&name))
        };
        let form = strange(&name, args);
        if let Some(form) = form {
            return self.push(Slot::Strange(form));
        }
        let is_usual = USUAL.iter().any(|usual| name.starts_with(usual)) || is_type();
        if !is_usual && self.found.calls.len() < MOST && !self.found.calls.contains(&name.to_string()) {
            self.found.calls.push(name.to_string());
        }
        self.push(Slot::Object(name))
    }

    fn new_object(&mut self, class: Slot) -> Option<()> {
        self.push(match class {
            Slot::Class(name) => Slot::Object(name),
            _ => Slot::Other,
        })
    }

    /// One opcode; `None` at the end, or where it cannot be followed.
    fn step(&mut self) -> Option<()> {
        let place = self.at;
        match self.take(1)?[0] {
            0x80 => self.number(1).map(drop),
            0x95 => self.number(8).map(drop),
            b'(' => self.push(Slot::Mark),
            b'0' => self.pop().map(drop),
            b'1' | b'e' | 0x90 => self.pop_to_mark().map(drop),
            b'2' => {
                let top = self.stack.last()?.clone();
                self.push(top)
            }
            b'F' | b'P' => {
                self.line()?;
                self.push(Slot::Other)
            }
            b'I' | b'L' => {
                let number = self.line()?.trim_end_matches('L').parse();
                self.push(number.map_or(Slot::Other, Slot::Number))
            }
            b'S' | b'V' => {
                let text = self.line()?;
                self.push(Slot::Text(text))
            }
            b'J' => self.integer(4),
            b'K' => self.number(1).and_then(|number| self.push(Slot::Number(number as i64))),
            b'M' => self.number(2).and_then(|number| self.push(Slot::Number(number as i64))),
            b'G' => self.number(8).and_then(|_| self.push(Slot::Other)),
            0x8a => self.number(1).and_then(|bytes| self.integer(bytes as usize)),
            0x8b => self.number(4).and_then(|bytes| self.integer(bytes as usize)),
            b')' => self.tuple(&[]),
            b'N' | 0x88 | 0x89 | b']' | b'}' | 0x8f => self.push(Slot::Other),
            b'B' => self.skip(4).map(drop).and_then(|()| self.push(Slot::Other)),
            b'C' => self.skip(1).map(drop).and_then(|()| self.push(Slot::Other)),
            0x8e | 0x96 => self.skip(8).map(drop).and_then(|()| self.push(Slot::Other)),
            b'T' | b'X' => self.text(4),
            b'U' | 0x8c => self.text(1),
            0x8d => self.text(8),
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                self.push(Slot::Class(format!("{module}.{name}").into()))
            }
            0x93 => match (self.pop()?, self.pop()?) {
                (Slot::Text(name), Slot::Text(module)) => {
                    self.push(Slot::Class(format!("{module}.{name}").into()))
                }
                _ => self.push(Slot::Other),
            },
            // What stands for a storage is of the storage's form.
            b'Q' => {
                let id = self.pop()?;
                if let Some(class) = module_class(&id) {
                    self.module(place);
                    return self.push(Slot::Class(class));
                }
                self.push(persistent(id))
            }
            b'R' => {
                let (args, callable) = (self.pop()?, self.pop()?);
                self.call(callable, &args)
            }
            0x81 => {
                self.pop()?;
                let class = self.pop()?;
                self.new_object(class)
            }
            0x92 => {
                self.pop()?;
                self.pop()?;
                let class = self.pop()?;
                self.new_object(class)
            }
            b'o' => {
                let class = self.pop_to_mark()?.into_iter().next()?;
                self.new_object(class)
            }
            b'i' => {
                let (module, name) = (self.line()?, self.line()?);
                self.pop_to_mark()?;
                self.push(Slot::Object(format!("{module}.{name}").into()))
            }
            b'b' => {
                self.pop()?;
                if let Slot::Object(class) = self.stack.last()? {
                    self.found.built.push((class.to_string(), place));
                }
                Some(())
            }
            b't' => {
                self.tuple_at = Some(place);
                let parts = self.pop_to_mark()?;
                self.tuple(&parts)
            }
            b'l' | b'd' | 0x91 => self.pop_to_mark().and_then(|_| self.push(Slot::Other)),
            0x85 => self.last(1),
            0x86 => self.last(2),
            0x87 => self.last(3),
            b'a' => self.pop().map(drop),
            b's' => {
                let (value, key) = (self.pop()?, self.pop()?);
                self.name(&key, &value);
                Some(())
            }
            b'u' => {
                for pair in self.pop_to_mark()?.chunks_exact(2) {
                    self.name(&pair[0], &pair[1]);
                }
                Some(())
            }
            b'p' => {
                let key = self.line()?.parse().ok()?;
                self.put(key)
            }
            b'q' => self.number(1).and_then(|key| self.put(key)),
            b'r' => self.number(4).and_then(|key| self.put(key)),
            0x94 => self.put(self.memo.len() as u64),
            b'g' => {
                let key = self.line()?.parse().ok()?;
                self.get(key)
            }
            b'h' => self.number(1).and_then(|key| self.get(key)),
            b'j' => self.number(4).and_then(|key| self.get(key)),
            b'.' => {
                self.has_stopped = true;
                None
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_be_called_is_named_and_attributes_can_be_dropped() {
        // {"x": print("a")}
        let calls = b"\x80\x02}X\x01\x00\x00\x00xcbuiltins\nprint\nX\x01\x00\x00\x00a\x85Rs.";
        assert_eq!(look_through(calls, 1).calls, ["builtins.print"]);
        // An object of `torch.optim.AdamW` with attributes.
        let object = b"\x80\x02ctorch.optim\nAdamW\n)\x81}b.";
        let found = look_through(object, 1);
        assert_eq!(found.built, [("torch.optim.AdamW".to_owned(), object.len() - 2)]);
        assert!(found.changed(object, &[]).is_none());
        let without = found.changed(object, &["torch.optim.AdamW".to_owned()]).unwrap();
        assert_eq!(&without[object.len() - 2..], b"0.");
        assert!(look_through(&without, 1).built.is_empty());
    }

    #[test]
    fn bytes_that_are_no_pickle_end_somewhere() {
        for length in 0..40_usize {
            let bytes: Vec<u8> =
                (0..length * 7).map(|i| (i.wrapping_mul(2_654_435_761) >> 5) as u8).collect();
            look_through(&bytes, 5);
        }
        let long = look_through(b"\x80\x02\x8e\xff\xff\xff\xff\xff\xff\xff\xffx", 1);
        assert!(long.calls.is_empty() && long.end == 0);
    }
}
