//! Pickles of tensors, numbers, texts, lists and dictionaries: a reader of the opcodes that these need. A global name is a word here and is
//! called never: those that stand for tensors are known, all others are refused by name.
//!
//! Source of the format: Python's `pickletools`, protocols 0 to 5.

mod values;

use std::collections::HashMap;

use swm_data::error::{FormatError, Result, invalid, unsupported};

/// Nested values, and axes of a tensor, are never more.
const MAX_DEPTH: usize = 64;
/// Values of a pickle that are used several times are copied: to so many at most.
const MAX_VALUES: usize = 1 << 24;

/// Where a tensor lies in its storage; all counted in values.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub(super) storage: String,
    /// The name of the type of the storage.
    pub(super) kind: String,
    pub(super) offset: u64,
    pub(super) sizes: Vec<u64>,
    pub(super) strides: Vec<u64>,
}

/// A value of a pickle.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Object {
    None,
    Bool(bool),
    Int(i64),
    Float,
    Text(String),
    /// A list, a tuple, a set.
    List(Vec<Object>),
    Dict(Vec<(Object, Object)>),
    /// `module name`.
    Global(String),
    /// Type and name.
    Storage(String, String),
    Tensor(Layout),
}

impl Object {
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a truth value",
            Self::Int(_) | Self::Float => "a number",
            Self::Text(_) => "a text",
            Self::List(_) => "a list",
            Self::Dict(_) => "a dictionary",
            Self::Global(_) => "a name",
            Self::Storage(..) => "a storage",
            Self::Tensor(_) => "a tensor",
        }
    }
}

/// What is on the stack while a pickle is read: lists and dictionaries grow after they were memorized.
#[derive(Clone)]
enum Item {
    Mark,
    At(usize),
}

/// Parts of a list or dictionary are positions in the arena.
#[derive(Clone)]
enum Node {
    Value(Object),
    List(Vec<usize>),
    Dict(Vec<(usize, usize)>),
}

struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    arena: Vec<Node>,
    stack: Vec<Item>,
    memo: HashMap<u32, usize>,
}

/// The value of a pickle.
pub(super) fn load(bytes: &[u8]) -> Result<Object> {
    let mut machine = Machine { bytes, at: 0, arena: Vec::new(), stack: Vec::new(), memo: HashMap::new() };
    let root = machine.run()?;
    let mut left = MAX_VALUES;
    machine.object(root, 0, &mut left)
}

impl Machine<'_> {
    fn take(&mut self, count: usize) -> Result<&[u8]> {
        let end = self.at.checked_add(count).ok_or_else(cut)?;
        let taken = self.bytes.get(self.at..end).ok_or_else(cut)?;
        self.at = end;
        Ok(taken)
    }

    fn number(&mut self, width: usize) -> Result<u64> {
        Ok(self.take(width)?.iter().rev().fold(0, |value, &byte| value << 8 | u64::from(byte)))
    }

    fn line(&mut self) -> Result<String> {
        let rest = self.bytes.get(self.at..).ok_or_else(cut)?;
        let length = rest.iter().position(|&byte| byte == b'\n').ok_or_else(cut)?;
        let line = text(&rest[..length])?;
        self.at += length + 1;
        Ok(line)
    }

    fn text(&mut self, width: usize) -> Result<Object> {
        let length = usize::try_from(self.number(width)?).map_err(|_| cut())?;
        Ok(Object::Text(text(self.take(length)?)?))
    }

    fn push_node(&mut self, node: Node) {
        self.arena.push(node);
        self.stack.push(Item::At(self.arena.len() - 1));
    }

    fn push(&mut self, object: Object) {
        self.push_node(Node::Value(object));
    }

    fn pop(&mut self) -> Result<usize> {
        match self.stack.pop() {
            Some(Item::At(at)) => Ok(at),
            _ => Err(invalid("its pickle takes values that it does not have")),
        }
    }

    /// The value on top.
    fn top(&self) -> Result<usize> {
        match self.stack.last() {
            Some(&Item::At(at)) => Ok(at),
            _ => Err(invalid("its pickle takes values that it does not have")),
        }
    }

    /// All values behind the last mark.
    fn marked(&mut self) -> Result<Vec<usize>> {
        let mark = self.stack.iter().rposition(|item| matches!(item, Item::Mark));
        let mark = mark.ok_or_else(|| invalid("its pickle has no mark"))?;
        let values = self.stack.split_off(mark);
        Ok(values.iter().filter_map(|item| if let Item::At(at) = item { Some(*at) } else { None }).collect())
    }

    fn remember(&mut self, key: u32) -> Result<()> {
        let top = self.top()?;
        self.memo.insert(key, top);
        Ok(())
    }

    fn recall(&mut self, key: u32) -> Result<()> {
        let found = self.memo.get(&key);
        let &at = found.ok_or_else(|| invalid("its pickle recalls what it did not remember"))?;
        self.stack.push(Item::At(at));
        Ok(())
    }

    fn append(&mut self, values: Vec<usize>) -> Result<()> {
        let list = self.top()?;
        match &mut self.arena[list] {
            Node::List(items) => items.extend(values),
            _ => return Err(invalid("its pickle appends to what is no list")),
        }
        Ok(())
    }

    fn set(&mut self, values: &[usize]) -> Result<()> {
        let dict = self.top()?;
        match &mut self.arena[dict] {
            Node::Dict(entries) => {
                entries.extend(values.as_chunks::<2>().0.iter().map(|&[key, value]| (key, value)));
            }
            // Attributes and entries of an object that stands for its state.
            _ => return Err(invalid("its pickle sets entries of what is no dictionary")),
        }
        Ok(())
    }

    fn run(&mut self) -> Result<usize> {
        loop {
            let opcode = self.number(1)? as u8;
            match opcode {
                b'.' => return self.pop(),
                0x80 => {
                    self.take(1)?;
                }
                0x95 => {
                    self.take(8)?;
                }
                b'(' => self.stack.push(Item::Mark),
                b'0' => {
                    self.stack.pop();
                }
                b'1' => {
                    self.marked()?;
                }
                b'2' => {
                    let top = self.top()?;
                    self.stack.push(Item::At(top));
                }
                b'N' => self.push(Object::None),
                0x88 => self.push(Object::Bool(true)),
                0x89 => self.push(Object::Bool(false)),
                b'K' => {
                    let value = self.number(1)?;
                    self.push(Object::Int(value as i64));
                }
                b'M' => {
                    let value = self.number(2)?;
                    self.push(Object::Int(value as i64));
                }
                b'J' => {
                    let value = self.number(4)? as u32;
                    self.push(Object::Int(i64::from(value.cast_signed())));
                }
                0x8a => {
                    let size = self.number(1)? as usize;
                    let bytes = self.take(size)?;
                    let negative = bytes.last().is_some_and(|&byte| byte & 0x80 != 0);
                    if size > 8 {
                        return Err(unsupported("its pickle holds an integer of more than 64 bits"));
                    }
                    let mut wide = [if negative { 0xff } else { 0 }; 8];
                    wide[..size].copy_from_slice(bytes);
                    self.push(Object::Int(i64::from_le_bytes(wide)));
                }
                b'I' => {
                    let line = self.line()?;
                    self.push(match line.as_str() {
                        "00" => Object::Bool(false),
                        "01" => Object::Bool(true),
                        value => {
                            Object::Int(value.parse().map_err(|_| invalid("its pickle has a wrong number"))?)
                        }
                    });
                }
                b'L' => {
                    let line = self.line()?;
                    let value = line.trim_end_matches('L').parse();
                    self.push(Object::Int(value.map_err(|_| invalid("its pickle has a wrong number"))?));
                }
                b'G' => {
                    self.take(8)?;
                    self.push(Object::Float);
                }
                b'X' => {
                    let value = self.text(4)?;
                    self.push(value);
                }
                0x8c | b'U' => {
                    let value = self.text(1)?;
                    self.push(value);
                }
                b')' => self.push_node(Node::List(Vec::new())),
                b']' | 0x8f => self.push_node(Node::List(Vec::new())),
                b'}' => self.push_node(Node::Dict(Vec::new())),
                b't' | b'l' => {
                    let values = self.marked()?;
                    self.push_node(Node::List(values));
                }
                b'd' => {
                    let values = self.marked()?;
                    self.push_node(Node::Dict(Vec::new()));
                    self.set(&values)?;
                }
                0x85..=0x87 => {
                    let mut values = Vec::new();
                    for _ in 0..opcode - 0x84 {
                        values.insert(0, self.pop()?);
                    }
                    self.push_node(Node::List(values));
                }
                b'a' => {
                    let value = self.pop()?;
                    self.append(vec![value])?;
                }
                b'e' | 0x90 => {
                    let values = self.marked()?;
                    self.append(values)?;
                }
                b's' => {
                    let (value, key) = (self.pop()?, self.pop()?);
                    self.set(&[key, value])?;
                }
                b'u' => {
                    let values = self.marked()?;
                    self.set(&values)?;
                }
                b'p' => {
                    let key = self.line()?.parse().map_err(|_| invalid("its pickle has a wrong number"))?;
                    self.remember(key)?;
                }
                b'q' => {
                    let key = self.number(1)? as u32;
                    self.remember(key)?;
                }
                b'r' => {
                    let key = self.number(4)? as u32;
                    self.remember(key)?;
                }
                0x94 => {
                    let key = self.memo.len() as u32;
                    self.remember(key)?;
                }
                b'h' => {
                    let key = self.number(1)? as u32;
                    self.recall(key)?;
                }
                b'j' => {
                    let key = self.number(4)? as u32;
                    self.recall(key)?;
                }
                b'c' => {
                    let (module, name) = (self.line()?, self.line()?);
                    self.push(Object::Global(format!("{module} {name}")));
                }
                0x93 => {
                    let (name, module) = (self.pop()?, self.pop()?);
                    let (module, name) = (self.shallow(module)?, self.shallow(name)?);
                    let (Object::Text(module), Object::Text(name)) = (module, name) else {
                        return Err(invalid("its pickle names no name"));
                    };
                    self.push(Object::Global(format!("{module} {name}")));
                }
                b'Q' => {
                    let id = self.pop()?;
                    let storage = self.storage(id)?;
                    self.push(storage);
                }
                b'R' | 0x81 => {
                    let (arguments, function) = (self.pop()?, self.pop()?);
                    self.reduce(function, arguments)?;
                }
                // The state of an object that is a dictionary here.
                b'b' => {
                    let (state, object) = (self.pop()?, self.top()?);
                    if let (Node::Dict(entries), Node::Dict(new)) =
                        (self.arena[object].clone(), self.arena[state].clone())
                    {
                        self.arena[object] = Node::Dict(entries.into_iter().chain(new).collect());
                    }
                }
                other => {
                    return Err(unsupported(format!(
                        "its pickle has the opcode {other:#04x}, which tensors do not need"
                    )));
                }
            }
        }
    }
}

fn text(bytes: &[u8]) -> Result<String> {
    std::str::from_utf8(bytes)
        .map(str::to_owned)
        .map_err(|_| invalid("its pickle holds a text that is not UTF-8"))
}

fn cut() -> FormatError {
    invalid("its pickle is cut short")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_every_protocol_are_read() {
        let expected =
            Object::List(vec![Object::Int(12), Object::Int(300), Object::Int(-1), Object::Int(70_000)]);
        for bytes in [
            &b"(lp0\nI12\naI300\naI-1\naI70000\na."[..],
            b"\x80\x02]q\x00(K\x0cM,\x01J\xff\xff\xff\xffJp\x11\x01\x00e.",
            b"\x80\x04\x95\x13\x00\x00\x00\x00\x00\x00\x00]\x94(K\x0cM,\x01J\xff\xff\xff\xffJp\x11\x01\x00e.",
        ] {
            assert_eq!(load(bytes).unwrap(), expected);
        }
    }

    #[test]
    fn nothing_is_called() {
        let error = load(b"cos\nsystem\n(X\x02\x00\x00\x00lstR.").unwrap_err().to_string();
        assert!(error.contains("`os.system`") && error.contains("nothing is executed"), "{error}");
        for bytes in [&b"."[..], b"R.", b"(((", b"h\x05.", b"]q\x00(h\x00e.", b"X\xff\xff\xff\xffab", b""] {
            assert!(load(bytes).is_err(), "{bytes:?}");
        }
    }
}
