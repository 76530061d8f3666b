//! Hashes of rows, bytes and files.

use std::collections::BTreeMap;
use std::io::{self, Read};

use serde_json::Value as Json;
use sha2::{Digest as _, Sha256};

use crate::batch::{Dtype, Row, Slice};
use crate::env::EnvSpec;

/// A digest of the environment's fields in a row, images apart: 16 hexadecimal digits. Equal rows have equal digests.
pub fn witness(spec: &EnvSpec, row: Row<'_>) -> String {
    let mut digest = Fnv::default();
    for (index, field) in spec.fields.iter().enumerate() {
        let image = field.dtype == Dtype::U8 && field.shape.len() == 3;
        if !image {
            digest.slice(row.at(index));
        }
    }
    digest.finish()
}

/// FNV-1a, 64 bits, over the bits of numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fnv(u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    pub(crate) fn slice(&mut self, values: Slice<'_>) {
        match values {
            Slice::Bool(v) => v.iter().for_each(|&v| self.bytes(&[u8::from(v)])),
            Slice::U8(v) => self.bytes(v),
            Slice::I32(v) => v.iter().for_each(|v| self.bytes(&v.to_le_bytes())),
            Slice::I64(v) => v.iter().for_each(|v| self.bytes(&v.to_le_bytes())),
            // All NaN are one: which of them a machine makes is its own affair.
            Slice::F32(v) => v.iter().for_each(|v| {
                self.bytes(&(if v.is_nan() { f32::NAN } else { *v }).to_le_bytes());
            }),
            Slice::F64(v) => v.iter().for_each(|v| {
                self.bytes(&(if v.is_nan() { f64::NAN } else { *v }).to_le_bytes());
            }),
            Slice::Str(v) => v.iter().for_each(|v| self.bytes(v.as_bytes())),
        }
    }

    pub(crate) fn finish(self) -> String {
        format!("{:016x}", self.0)
    }
}

/// SHA-256 in hexadecimal digits.
pub fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// As [`sha256`], of all that a reader gives, which is never held in memory as a whole.
///
/// # Errors
///
/// Reading failed.
pub fn sha256_of(mut source: impl Read) -> io::Result<String> {
    let (mut hasher, mut piece) = (Sha256::new(), vec![0; 1 << 20]);
    loop {
        match source.read(&mut piece) {
            Ok(0) => return Ok(hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()),
            Ok(count) => hasher.update(&piece[..count]),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
}

/// The same JSON with keys in order.
pub fn sorted(json: Json) -> Json {
    match json {
        Json::Object(map) => {
            let sorted: BTreeMap<String, Json> =
                map.into_iter().map(|(key, value)| (key, sorted(value))).collect();
            Json::Object(sorted.into_iter().collect())
        }
        Json::Array(items) => Json::Array(items.into_iter().map(sorted).collect()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_hashed_in_pieces_as_if_at_once() {
        for size in [0, 1, (1 << 20) - 1, 1 << 20, (1 << 20) + 1, 3 << 20] {
            let bytes: Vec<u8> = (0..size).map(|at| (at % 251) as u8).collect();
            assert_eq!(sha256_of(&bytes[..]).unwrap(), sha256(&bytes), "{size}");
        }
    }
}
