//! What the opcodes of a pickle made: values, and tensors of the calls that stand for them.

use swm_data::error::{Result, invalid, unsupported};

use super::{Item, Layout, MAX_DEPTH, Machine, Node, Object};

impl Machine<'_> {
    /// A copy of a value, two levels deep: of an argument.
    pub(super) fn shallow(&self, at: usize) -> Result<Object> {
        let mut left = 1 << 12;
        self.object(at, MAX_DEPTH - 4, &mut left)
    }

    pub(super) fn storage(&self, id: usize) -> Result<Object> {
        let Object::List(parts) = self.shallow(id)? else {
            return Err(invalid("its pickle names no storage"));
        };
        match &parts[..] {
            [Object::Text(word), Object::Global(kind), Object::Text(key), ..] if word == "storage" => {
                let kind = kind.strip_prefix("torch ").or_else(|| kind.strip_prefix("torch.storage "));
                let kind = kind.ok_or_else(|| invalid("its pickle names no type of a storage"))?;
                Ok(Object::Storage(kind.to_owned(), key.clone()))
            }
            _ => Err(invalid("its pickle names no storage")),
        }
    }

    /// What the call of a known name stands for.
    pub(super) fn reduce(&mut self, function: usize, arguments: usize) -> Result<()> {
        let Object::Global(name) = self.shallow(function)? else {
            return Err(invalid("its pickle calls no name"));
        };
        let Node::List(parts) = self.arena[arguments].clone() else {
            return Err(invalid("its pickle has no arguments"));
        };
        match name.as_str() {
            "torch._utils _rebuild_tensor_v2" | "torch._utils _rebuild_tensor" => {
                let object = self.tensor(&parts)?;
                self.push(object);
            }
            "torch._utils _rebuild_parameter" | "torch Size" if !parts.is_empty() => {
                self.stack.push(Item::At(parts[0]));
            }
            "collections OrderedDict" if parts.is_empty() => self.push_node(Node::Dict(Vec::new())),
            "tensordict._reductions _make_td" if parts.len() == 2 => self.stack.push(Item::At(parts[1])),
            "tensordict._td TensorDict" | "tensordict.tensordict TensorDict" if parts.is_empty() => {
                self.push_node(Node::Dict(Vec::new()));
            }
            name => {
                let name = name.replace(' ', ".");
                return Err(unsupported(format!(
                    "its pickle calls `{name}`; nothing is executed here, and only tensors are known"
                )));
            }
        }
        Ok(())
    }

    pub(super) fn tensor(&self, parts: &[usize]) -> Result<Object> {
        let wrong = || invalid("its pickle describes no tensor");
        let &[storage, offset, sizes, strides, ..] = parts else { return Err(wrong()) };
        let integers = |at: usize| match self.shallow(at) {
            Ok(Object::List(values)) if values.len() <= MAX_DEPTH => values
                .iter()
                .map(|value| {
                    if let Object::Int(value) = value {
                        u64::try_from(*value).map_err(|_| wrong())
                    } else {
                        Err(wrong())
                    }
                })
                .collect::<Result<Vec<u64>>>(),
            _ => Err(wrong()),
        };
        let (Object::Storage(kind, storage), Object::Int(offset)) =
            (self.shallow(storage)?, self.shallow(offset)?)
        else {
            return Err(wrong());
        };
        let (sizes, strides) = (integers(sizes)?, integers(strides)?);
        let offset = u64::try_from(offset).map_err(|_| wrong())?;
        match sizes.len() == strides.len() {
            true => Ok(Object::Tensor(Layout { storage, kind, offset, sizes, strides })),
            false => Err(wrong()),
        }
    }

    /// A value with all of its parts.
    pub(super) fn object(&self, at: usize, depth: usize, left: &mut usize) -> Result<Object> {
        if depth > MAX_DEPTH || *left == 0 {
            return Err(unsupported("its pickle is nested too deeply, or holds too many values"));
        }
        *left -= 1;
        match &self.arena[at] {
            Node::Value(object) => Ok(object.clone()),
            Node::List(items) => {
                let items = items.iter().map(|&item| self.object(item, depth + 1, left));
                items.collect::<Result<_>>().map(Object::List)
            }
            Node::Dict(entries) => {
                let mut found = Vec::new();
                for &(key, value) in entries {
                    found.push((self.object(key, depth + 1, left)?, self.object(value, depth + 1, left)?));
                }
                Ok(Object::Dict(found))
            }
        }
    }
}
