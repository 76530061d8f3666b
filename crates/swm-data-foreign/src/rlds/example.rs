//! Values of a record: `tf.train.Example`, which is a map from keys to lists of texts, floats or integers.

use std::collections::BTreeMap;
use std::ops::Range;

use swm_data::error::{FormatError, Result, invalid};

/// Where a list is in its record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum List {
    Bytes(Range<usize>),
    Floats(Range<usize>),
    Integers(Range<usize>),
    /// Nothing is in it.
    None,
}

/// Lists by their keys.
pub(super) type Lists = BTreeMap<String, List>;

/// A field of a message.
enum Field<'a> {
    /// A number as it is stored: in 7 bits a byte, or in 4 or 8 bytes.
    Number(u64),
    Fixed(&'a [u8]),
    /// A message, a text, or numbers one behind the other; and where it begins in the record.
    Part(&'a [u8], usize),
}

/// A cursor in a message, which begins at `base` of the record.
struct Message<'a> {
    bytes: &'a [u8],
    at: usize,
    base: usize,
}

fn cut() -> FormatError {
    invalid("a record is cut short, or holds no `tf.train.Example`")
}

impl<'a> Message<'a> {
    fn new(bytes: &'a [u8], base: usize) -> Self {
        Self { bytes, at: 0, base }
    }

    fn number(&mut self) -> Result<u64> {
        let mut value = 0u64;
        for shift in (0..64).step_by(7) {
            let byte = *self.bytes.get(self.at).ok_or_else(cut)?;
            self.at += 1;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Ok(value);
            }
        }
        Err(cut())
    }

    fn take(&mut self, count: u64) -> Result<&'a [u8]> {
        let end = usize::try_from(count).ok().and_then(|count| self.at.checked_add(count));
        let taken = end.and_then(|end| self.bytes.get(self.at..end)).ok_or_else(cut)?;
        self.at += taken.len();
        Ok(taken)
    }

    /// The next field, by its number.
    fn next(&mut self) -> Result<Option<(u64, Field<'a>)>> {
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let tag = self.number()?;
        let field = match tag & 7 {
            0 => Field::Number(self.number()?),
            1 => Field::Fixed(self.take(8)?),
            2 => {
                let count = self.number()?;
                let from = self.base + self.at;
                Field::Part(self.take(count)?, from)
            }
            5 => Field::Fixed(self.take(4)?),
            _ => return Err(cut()),
        };
        Ok(Some((tag >> 3, field)))
    }
}

/// The lists of a record, by key.
pub(super) fn lists(record: &[u8]) -> Result<Lists> {
    let mut found = Lists::new();
    let mut example = Message::new(record, 0);
    while let Some((number, field)) = example.next()? {
        let (1, Field::Part(features, base)) = (number, field) else { continue };
        let mut features = Message::new(features, base);
        while let Some((number, field)) = features.next()? {
            let (1, Field::Part(entry, base)) = (number, field) else { continue };
            let (mut entry, mut key, mut list) = (Message::new(entry, base), String::new(), List::None);
            while let Some((number, field)) = entry.next()? {
                match (number, field) {
                    (1, Field::Part(name, _)) => {
                        std::str::from_utf8(name)
                            .map_err(|_| invalid("a key is not UTF-8"))?
                            .clone_into(&mut key);
                    }
                    (2, Field::Part(feature, base)) => list = list_of(feature, base)?,
                    _ => {}
                }
            }
            found.insert(key, list);
        }
    }
    Ok(found)
}

fn list_of(feature: &[u8], base: usize) -> Result<List> {
    let (mut feature, mut found) = (Message::new(feature, base), List::None);
    while let Some((number, field)) = feature.next()? {
        let Field::Part(list, at) = field else { continue };
        let range = at..at + list.len();
        found = match number {
            1 => List::Bytes(range),
            2 => List::Floats(range),
            3 => List::Integers(range),
            _ => found,
        };
    }
    Ok(found)
}

/// Where the list of a key is in its record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) key: String,
    /// The number of its kind, its first byte, and its bytes; `None`: it has no values.
    pub(super) list: Option<(u64, u64, u64)>,
}

/// The entries of a record, of which no values are read: images stay where they are. `None`: they are not as they usually are.
pub(super) fn scan(length: u64, read: &dyn Fn(&mut [u8], u64) -> bool) -> Option<Vec<Entry>> {
    /// Bytes that hold a key and what is before the values.
    const START: u64 = 512;
    /// Entries that are read one by one; records of more are read as a whole.
    const MOST: usize = 1 << 12;
    let start = |at: u64, end: u64| {
        let mut bytes = vec![0; (end - at).min(START) as usize];
        read(&mut bytes, at).then_some(bytes)
    };
    // The number of a field, where its bytes begin, and how many they are.
    let field = |bytes: &[u8]| {
        let mut message = Message::new(bytes, 0);
        let (tag, size) = (message.number().ok()?, message.number().ok()?);
        (tag & 7 == 2).then_some((tag >> 3, message.at, size))
    };
    let (1, head, size) = field(&start(0, length)?)? else { return None };
    let mut at = head as u64;
    at.checked_add(size).filter(|&end| end == length)?;
    let mut found = Vec::new();
    while at < length {
        if found.len() == MOST {
            return None;
        }
        let bytes = start(at, length)?;
        let (1, head, size) = field(&bytes)? else { return None };
        let next = (at + head as u64).checked_add(size).filter(|&next| next <= length)?;
        let (1, begin, count) = field(&bytes[head..])? else { return None };
        let from = head + begin;
        let behind = from.checked_add(usize::try_from(count).ok()?)?;
        let key = std::str::from_utf8(bytes.get(from..behind)?).ok()?.to_owned();
        let mut list = None;
        if at + (behind as u64) < next {
            let (2, begin, size) = field(bytes.get(behind..)?)? else { return None };
            let feature = behind + begin;
            if size > 0 {
                let (number, begin, size) = field(bytes.get(feature..)?)?;
                let from = at + (feature + begin) as u64;
                from.checked_add(size).filter(|&end| end <= next)?;
                list = (size > 0).then_some((number, from, size));
            }
        }
        found.push(Entry { key, list });
        at = next;
    }
    Some(found)
}

/// The texts of a list.
pub(super) fn texts(list: &[u8]) -> Result<Vec<&[u8]>> {
    let (mut message, mut found) = (Message::new(list, 0), Vec::new());
    while let Some((number, field)) = message.next()? {
        if let (1, Field::Part(text, _)) = (number, field) {
            found.push(text);
        }
    }
    Ok(found)
}

/// The floats of a list.
pub(super) fn floats(list: &[u8]) -> Result<Vec<f32>> {
    let (mut message, mut found) = (Message::new(list, 0), Vec::new());
    while let Some((number, field)) = message.next()? {
        match (number, field) {
            (1, Field::Part(packed, _)) => {
                let (whole, []) = packed.as_chunks::<4>() else { return Err(cut()) };
                found.extend(whole.iter().map(|bytes| f32::from_le_bytes(*bytes)));
            }
            (1, Field::Fixed(bytes)) => {
                found.push(f32::from_le_bytes(bytes.try_into().map_err(|_| cut())?));
            }
            _ => {}
        }
    }
    Ok(found)
}

/// The integers of a list.
pub(super) fn integers(list: &[u8]) -> Result<Vec<i64>> {
    let (mut message, mut found) = (Message::new(list, 0), Vec::new());
    while let Some((number, field)) = message.next()? {
        match (number, field) {
            (1, Field::Part(packed, _)) => {
                let mut packed = Message::new(packed, 0);
                while packed.at < packed.bytes.len() {
                    found.push(packed.number()? as i64);
                }
            }
            (1, Field::Number(value)) => found.push(value as i64),
            _ => {}
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(number: u8, bytes: &[u8]) -> Vec<u8> {
        [&[number << 3 | 2, bytes.len() as u8], bytes].concat()
    }

    fn entry(key: &str, feature: &[u8]) -> Vec<u8> {
        part(1, &[part(1, key.as_bytes()), part(2, feature)].concat())
    }

    #[test]
    fn records_are_maps_of_lists() {
        let floats_of = part(2, &part(1, &[1.5f32.to_le_bytes(), 2f32.to_le_bytes()].concat()));
        let unpacked = part(3, &[8, 1, 8, 0x96, 1]);
        let negative = part(3, &part(1, &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1]));
        let texts_of = part(1, &[part(1, b"ab"), part(1, b"")].concat());
        let all = [
            entry("f", &floats_of),
            entry("i", &unpacked),
            entry("n", &negative),
            entry("t", &texts_of),
            entry("none", &[]),
        ];
        let record = part(1, &all.concat());
        let found = lists(&record).unwrap();
        let range = |key: &str| match &found[key] {
            List::Bytes(range) | List::Floats(range) | List::Integers(range) => &record[range.clone()],
            List::None => panic!("{key}"),
        };
        assert_eq!(floats(range("f")).unwrap(), [1.5, 2.0]);
        assert_eq!(integers(range("i")).unwrap(), [1, 150]);
        assert_eq!(integers(range("n")).unwrap(), [-1]);
        assert_eq!(texts(range("t")).unwrap(), [&b"ab"[..], b""]);
        assert_eq!(found["none"], List::None);
        let read = |out: &mut [u8], at: u64| {
            let bytes = record.get(at as usize..at as usize + out.len());
            bytes.map(|bytes| out.copy_from_slice(bytes)).is_some()
        };
        let entries = scan(record.len() as u64, &read).unwrap();
        let list = |key: &str| entries.iter().find(|entry| entry.key == key).unwrap().list;
        let (number, from, size) = list("i").unwrap();
        let values = integers(&record[from as usize..(from + size) as usize]).unwrap();
        assert_eq!((number, values, list("none")), (3, vec![1, 150], None));
        assert_eq!(entries.len(), all.len());
        assert_eq!(scan(record.len() as u64 - 1, &read), None);
        for end in 1..record.len() {
            // No cut record is read past its end.
            let _ = lists(&record[..end]);
        }
        assert!(lists(&record[..record.len() - 1]).is_err());
        assert!(floats(&part(1, &[0; 5])).is_err() && lists(&[0xff; 11]).is_err());
    }
}
