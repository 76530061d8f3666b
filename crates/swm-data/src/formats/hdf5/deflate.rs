//! Decoding of whole chunks that HDF5's own filters made: deflate (gzip), with or without byte shuffle before it. Other
//! programs write them; this one writes blosc, whose chunks can be decoded in part.

use std::fmt;

use libdeflater::Decompressor;

use super::blosc::unshuffle;

/// Deflate shortens to no less than a 1032nd; see <https://zlib.net/zlib_tech.html>. This bounds what a forged chunk can
/// make us allocate.
const GREATEST_RATIO: usize = 1032;

/// A decoder and the last chunk that it decoded.
pub(super) struct Inflated {
    decoder: Decompressor,
    /// The address of the chunk; `None` if there is none.
    address: Option<u64>,
    shuffled: Vec<u8>,
    bytes: Vec<u8>,
}

impl Default for Inflated {
    fn default() -> Self {
        Self { decoder: Decompressor::new(), address: None, shuffled: Vec::new(), bytes: Vec::new() }
    }
}

impl fmt::Debug for Inflated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Inflated").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Inflated {
    /// Forgets the chunk: the file may have changed.
    pub(super) fn forget(&mut self) {
        self.address = None;
    }

    /// The bytes of the chunk at `address`, if it was the last one.
    pub(super) fn held(&self, address: u64) -> Option<&[u8]> {
        (self.address == Some(address)).then_some(&self.bytes)
    }

    /// Decodes the chunk at `address`, `source`, which must hold `total` bytes; `shuffled` is the size of its elements if
    /// their bytes were shuffled.
    pub(super) fn decode(
        &mut self,
        address: u64,
        source: &[u8],
        total: usize,
        shuffled: Option<usize>,
    ) -> Result<&[u8], &'static str> {
        self.address = None;
        if total / GREATEST_RATIO > source.len() {
            return Err("too short for its size");
        }
        let inflated = if shuffled.is_some() { &mut self.shuffled } else { &mut self.bytes };
        inflated.resize(total, 0);
        if self.decoder.zlib_decompress(source, inflated) != Ok(total) {
            return Err("no valid deflate data");
        }
        if let Some(element) = shuffled {
            self.bytes.resize(total, 0);
            unshuffle(&self.shuffled, element.max(1), &mut self.bytes);
        }
        self.address = Some(address);
        Ok(&self.bytes)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    #[test]
    fn whole_chunks_and_nothing_else() {
        let bytes: Vec<u8> = (0..1000_u32).map(|i| (i * i) as u8).collect();
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&bytes).unwrap();
        let source = encoder.finish().unwrap();
        let mut inflated = Inflated::default();
        assert_eq!(inflated.decode(8, &source, 1000, None), Ok(&bytes[..]));
        assert_eq!((inflated.held(8), inflated.held(9)), (Some(&bytes[..]), None));
        for cut in 0..source.len() {
            assert!(inflated.decode(8, &source[..cut], 1000, None).is_err(), "{cut}");
        }
        assert_eq!(inflated.held(8), None);
        assert!(inflated.decode(8, &source, 999, None).is_err());
        assert!(inflated.decode(8, &source, 1001, None).is_err());
        assert!(inflated.decode(8, &source, usize::MAX, None).is_err());
        let shuffled = inflated.decode(8, &source, 1000, Some(2)).unwrap();
        assert_eq!(shuffled[..4], [bytes[0], bytes[500], bytes[1], bytes[501]]);
    }
}
