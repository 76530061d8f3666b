//! FSST: texts whose bytes are codes of up to 255 frequent symbols.

use crate::block::Items;
use crate::error::{Result, damaged, unsupported};

const HEAD: usize = 8;
const SYMBOL: usize = 8;
/// What follows is a byte and no code.
const ESCAPE: u8 = 255;

/// A table of symbols.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Symbols {
    /// Whether anything is coded.
    is_on: bool,
    symbols: Vec<[u8; SYMBOL]>,
    sizes: Vec<u8>,
}

impl Symbols {
    pub(crate) fn parse(table: &[u8]) -> Result<Self> {
        let cut = || damaged("the symbols of FSST are cut");
        let (head, rest) = table.split_first_chunk::<HEAD>().ok_or_else(cut)?;
        if head[4..] != *b"TSSF" {
            return Err(unsupported("the symbols of FSST are of another version"));
        }
        let count = usize::from(head[0]);
        let (symbols, rest) = rest.split_at_checked(count * SYMBOL).ok_or_else(cut)?;
        let sizes = rest.get(..count).ok_or_else(cut)?;
        if sizes.iter().any(|&size| !(1..=SYMBOL).contains(&usize::from(size))) {
            return Err(damaged("a symbol of FSST has no size of 1 to 8"));
        }
        let symbols = symbols.chunks_exact(SYMBOL).filter_map(|symbol| symbol.try_into().ok()).collect();
        Ok(Self { is_on: head[3] & 1 == 1, symbols, sizes: sizes.to_vec() })
    }

    pub(crate) fn decode(&self, coded: Items) -> Result<Items> {
        if !self.is_on {
            return Ok(coded);
        }
        let mut texts = Items::empty(0);
        let mut text = Vec::new();
        for at in 0..coded.count() {
            text.clear();
            let mut codes = coded.get(at).unwrap_or_default().iter();
            while let Some(&code) = codes.next() {
                if code == ESCAPE {
                    text.push(*codes.next().ok_or_else(|| damaged("a text of FSST ends in an escape"))?);
                    continue;
                }
                let code = usize::from(code);
                let (Some(symbol), Some(&size)) = (self.symbols.get(code), self.sizes.get(code)) else {
                    return Err(damaged(format!("a text of FSST has the code {code}, which is no symbol")));
                };
                text.extend_from_slice(&symbol[..usize::from(size)]);
            }
            texts.push(&text);
        }
        Ok(texts)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(symbols: &[&str]) -> Vec<u8> {
        let mut table = vec![symbols.len() as u8, 0, 0, 1];
        table.extend_from_slice(b"TSSF");
        for symbol in symbols {
            table.extend_from_slice(symbol.as_bytes());
            table.resize(table.len() + SYMBOL - symbol.len(), 0);
        }
        table.extend(symbols.iter().map(|symbol| symbol.len() as u8));
        table
    }

    #[test]
    fn texts_are_decoded() {
        let symbols = Symbols::parse(&table(&["push ", "the", "a"])).unwrap();
        let coded = |codes: &[u8]| {
            let mut items = Items::empty(0);
            items.push(codes);
            symbols.decode(items)
        };
        assert_eq!(coded(&[0, 1, ESCAPE, b' ', 2]).unwrap().get(0).unwrap(), b"push the a");
        assert!(coded(&[3]).is_err() && coded(&[0, ESCAPE]).is_err());
        assert!(Symbols::parse(&table(&["ab"])[..16]).is_err());
    }
}
