//! The description of an array: `.zarray` of version 2, `zarr.json` of version 3.

use serde_json::Value as Json;
use swm_data::error::{At as _, FormatError, Result, invalid, missing, unsupported};
use swm_data::npz::ArrayType;

use super::codec::Codec;
use super::fill;
use super::store::{Store, V2, V3};

/// More axes are nobody's.
const MAX_AXES: usize = 32;
/// Values of an array, and bytes of a chunk, are never more.
const MAX_VALUES: usize = 1 << 46;
const MAX_CHUNK: usize = 1 << 36;

/// An array.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Meta {
    pub(super) shape: Vec<usize>,
    /// The shape of a chunk: of the inner ones, where there are shards.
    pub(super) chunk: Vec<usize>,
    pub(super) elements: ArrayType,
    pub(super) is_big_endian: bool,
    /// The bytes of an element of a chunk that is not stored, little-endian.
    pub(super) fill: Vec<u8>,
    /// The axes in the order in which a chunk is stored, the last one varying fastest.
    pub(super) order: Vec<usize>,
    /// From the file to the values.
    pub(super) codecs: Vec<Codec>,
    pub(super) keys: Keys,
    pub(super) shards: Option<Shards>,
}

/// How chunks are called.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Keys {
    /// Whether `c` is before the numbers.
    has_prefix: bool,
    separator: char,
}

impl Keys {
    /// The name of a chunk, or of a shard.
    pub(super) fn of(self, array: &str, place: &[usize]) -> String {
        let numbers = place.iter().map(usize::to_string);
        let parts: Vec<String> = self.has_prefix.then(|| "c".to_owned()).into_iter().chain(numbers).collect();
        format!("{array}/{}", parts.join(self.separator.encode_utf8(&mut [0; 4])))
    }
}

/// Files of several chunks each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Shards {
    /// Chunks by axis.
    pub(super) chunks: Vec<usize>,
    /// Whether the list of them is before them.
    pub(super) is_index_first: bool,
    pub(super) has_checksum: bool,
}

impl Shards {
    /// Bytes of the list.
    pub(super) fn index_bytes(&self) -> u64 {
        16 * self.chunks.iter().product::<usize>() as u64 + if self.has_checksum { 4 } else { 0 }
    }
}

impl Meta {
    pub(super) fn read(store: &Store, array: &str) -> Result<Self> {
        let parse = |bytes: Vec<u8>, name: &str| -> Result<Json> {
            serde_json::from_slice(&bytes).at(format_args!("`{name}`"))
        };
        let meta = match (store.about(array, V2)?, store.about(array, V3)?) {
            (_, Some(bytes)) => Self::third(&parse(bytes, V3)?).at(format_args!("`{V3}`"))?,
            (Some(bytes), None) => Self::second(&parse(bytes, V2)?).at(format_args!("`{V2}`"))?,
            (None, None) => return Err(missing(format!("it has neither `{V2}` nor `{V3}`"))),
        };
        meta.check()?;
        Ok(meta)
    }

    fn check(&self) -> Result<()> {
        let Self { shape, chunk, .. } = self;
        let product =
            |sizes: &[usize], first: usize| sizes.iter().try_fold(first, |all, &size| all.checked_mul(size));
        let size = self.elements.size();
        if shape.is_empty() {
            return Err(unsupported("it is a single value, not one per row"));
        }
        let fits = size > 0
            && shape.len() == chunk.len()
            && shape.len() <= MAX_AXES
            && chunk.iter().all(|&size| size > 0)
            && product(shape, size).is_some_and(|bytes| bytes <= MAX_VALUES)
            && product(chunk, size).is_some_and(|bytes| bytes <= MAX_CHUNK);
        match fits {
            true => Ok(()),
            false => Err(invalid(format!("its shape is {shape:?}, in chunks of {chunk:?}"))),
        }
    }

    fn second(about: &Json) -> Result<Self> {
        let (shape, chunk) = (sizes(&about["shape"])?, sizes(&about["chunks"])?);
        let Some(dtype) = about["dtype"].as_str() else {
            return Err(unsupported("elements of several parts are not read"));
        };
        let (elements, is_big_endian) = ArrayType::parse(dtype)?;
        if let Some(filter) = about["filters"].as_array().and_then(|filters| filters.first()) {
            return Err(not_read("filter", &filter["id"]));
        }
        let codecs = match &about["compressor"] {
            Json::Null => Vec::new(),
            compressor => vec![known(&compressor["id"])?],
        };
        let order = match about["order"].as_str() {
            None | Some("C") => (0..shape.len()).collect(),
            Some("F") => (0..shape.len()).rev().collect(),
            Some(other) => return Err(invalid(format!("its order is `{other}`"))),
        };
        let separator = separator(&about["dimension_separator"], '.')?;
        let fill = fill::bytes(elements, &about["fill_value"])?;
        let keys = Keys { has_prefix: false, separator };
        Ok(Self { shape, chunk, elements, is_big_endian, fill, order, codecs, keys, shards: None })
    }

    fn third(about: &Json) -> Result<Self> {
        let (shape, grid) = (sizes(&about["shape"])?, &about["chunk_grid"]);
        if grid["name"] != "regular" {
            return Err(not_read("grid of chunks", &grid["name"]));
        }
        let whole = sizes(&grid["configuration"]["chunk_shape"])?;
        let elements = elements(&about["data_type"])?;
        let transformers = about["storage_transformers"].as_array();
        if let Some(other) = transformers.and_then(|all| all.first()) {
            return Err(not_read("storage transformer", &other["name"]));
        }
        let encoding = &about["chunk_key_encoding"];
        let (has_prefix, usual) = match encoding["name"].as_str() {
            None | Some("default") => (true, '/'),
            Some("v2") => (false, '.'),
            Some(_) => return Err(not_read("naming of chunks", &encoding["name"])),
        };
        let separator = separator(&encoding["configuration"]["separator"], usual)?;
        let fill = fill::bytes(elements, &about["fill_value"])?;
        let (mut chain, mut chunk, mut shards) = (Chain::read(&about["codecs"], shape.len())?, whole, None);
        if let Some(sharding) = chain.sharding.take() {
            if !chain.codecs.is_empty() || chain.order.is_some() {
                return Err(unsupported("codecs around `sharding_indexed` are not read"));
            }
            let inner = sizes(&sharding["chunk_shape"])?;
            shards = Some(shards_of(sharding, &chunk, &inner)?);
            chunk = inner;
            chain = Chain::read(&sharding["codecs"], shape.len())?;
            if chain.sharding.is_some() {
                return Err(unsupported("shards in shards are not read"));
            }
        }
        let order = chain.order.unwrap_or_else(|| (0..shape.len()).collect());
        let (is_big_endian, codecs) = (chain.is_big_endian, chain.codecs);
        let keys = Keys { has_prefix, separator };
        Ok(Self { shape, chunk, elements, is_big_endian, fill, order, codecs, keys, shards })
    }
}

/// The codecs of version 3, of which one makes bytes of an array.
#[derive(Default)]
struct Chain<'a> {
    order: Option<Vec<usize>>,
    is_big_endian: bool,
    sharding: Option<&'a Json>,
    /// From the file to the values.
    codecs: Vec<Codec>,
}

impl<'a> Chain<'a> {
    fn read(codecs: &'a Json, axes: usize) -> Result<Self> {
        let codecs = codecs.as_array().ok_or_else(|| missing("it has no `codecs`"))?;
        let (mut chain, mut has_bytes) = (Self::default(), false);
        for codec in codecs {
            let configuration = &codec["configuration"];
            match codec["name"].as_str().or(codec.as_str()) {
                Some("transpose") if !has_bytes && chain.order.is_none() => {
                    chain.order = Some(order(&configuration["order"], axes)?);
                }
                Some("bytes" | "endian") if !has_bytes => {
                    chain.is_big_endian = configuration["endian"] == "big";
                    has_bytes = true;
                }
                Some("sharding_indexed") if !has_bytes => {
                    chain.sharding = Some(configuration);
                    has_bytes = true;
                }
                Some(_) if has_bytes => chain.codecs.insert(0, known(&codec["name"])?),
                _ => return Err(not_read("codec", &codec["name"])),
            }
        }
        match has_bytes {
            true => Ok(chain),
            false => Err(unsupported("its codecs do not make bytes of it in a known way")),
        }
    }
}

fn shards_of(sharding: &Json, outer: &[usize], inner: &[usize]) -> Result<Shards> {
    let divides = |(&outer, &inner): (&usize, &usize)| inner > 0 && outer.is_multiple_of(inner);
    if outer.len() != inner.len() || !outer.iter().zip(inner).all(divides) {
        return Err(invalid(format!("its shards of {outer:?} have chunks of {inner:?}")));
    }
    let chunks: Vec<usize> = outer.iter().zip(inner).map(|(outer, inner)| outer / inner).collect();
    let count = chunks.iter().try_fold(1_usize, |all, &size| all.checked_mul(size));
    if count.is_none_or(|count| count > 1 << 24) {
        return Err(invalid(format!("its shards have {chunks:?} chunks")));
    }
    let chain = Chain::read(&sharding["index_codecs"], 1)?;
    let has_checksum = match chain.codecs[..] {
        [] => false,
        [Codec::Crc32c] => true,
        _ => return Err(unsupported("a compressed list of the chunks of a shard is not read")),
    };
    if chain.is_big_endian || chain.sharding.is_some() {
        return Err(unsupported("a list of the chunks of a shard in this order of bytes is not read"));
    }
    let is_index_first = match sharding["index_location"].as_str() {
        None | Some("end") => false,
        Some("start") => true,
        Some(other) => return Err(invalid(format!("the list of the chunks of a shard is at its `{other}`"))),
    };
    Ok(Shards { chunks, is_index_first, has_checksum })
}

/// A type of version 3.
fn elements(name: &Json) -> Result<ArrayType> {
    /// By name: as numpy describes it.
    const NAMES: &[(&str, &str)] = &[
        ("bool", "|b1"),
        ("int8", "|i1"),
        ("uint8", "|u1"),
        ("int16", "<i2"),
        ("uint16", "<u2"),
        ("int32", "<i4"),
        ("uint32", "<u4"),
        ("int64", "<i8"),
        ("uint64", "<u8"),
        ("float16", "<f2"),
        ("bfloat16", "<V2"),
        ("float32", "<f4"),
        ("float64", "<f8"),
    ];
    let bytes = name["configuration"]["length_bytes"].as_u64();
    let descriptor = match (name["name"].as_str(), bytes) {
        (Some("fixed_length_utf32"), Some(bytes)) => Some(format!("<U{}", bytes / 4)),
        (Some("null_terminated_bytes"), Some(bytes)) => Some(format!("|S{bytes}")),
        _ => {
            let found = name.as_str().and_then(|name| NAMES.iter().find(|(known, _)| *known == name));
            found.map(|(_, descriptor)| (*descriptor).to_owned())
        }
    };
    let unknown = || {
        let name = name["name"].as_str().or(name.as_str()).map_or_else(|| name.to_string(), str::to_owned);
        unsupported(format!("its elements of type `{name}` are not read"))
    };
    ArrayType::parse(&descriptor.ok_or_else(unknown)?).map(|(elements, _)| elements)
}

fn known(name: &Json) -> Result<Codec> {
    name.as_str().and_then(Codec::named).ok_or_else(|| not_read("codec", name))
}

fn not_read(what: &str, name: &Json) -> FormatError {
    let name = name.as_str().map_or_else(|| name.to_string(), str::to_owned);
    let fix = match what {
        "filter" => "without filters",
        _ => "by Blosc, zstd or gzip, or uncompressed",
    };
    unsupported(format!("its {what} `{name}` is not read; store it {fix}"))
}

fn sizes(list: &Json) -> Result<Vec<usize>> {
    let sizes = list.as_array().map(|list| list.iter().map(|size| Some(size.as_u64()? as usize)).collect());
    sizes.flatten().ok_or_else(|| invalid(format!("{list} is no shape")))
}

fn separator(value: &Json, usual: char) -> Result<char> {
    match value.as_str() {
        None => Ok(usual),
        Some(".") => Ok('.'),
        Some("/") => Ok('/'),
        Some(other) => Err(invalid(format!("`{other}` is no separator of the names of chunks"))),
    }
}

/// An order of axes: each once.
fn order(value: &Json, axes: usize) -> Result<Vec<usize>> {
    let order = match value.as_str() {
        Some("C") => (0..axes).collect(),
        Some("F") => (0..axes).rev().collect(),
        _ => sizes(value)?,
    };
    let mut sorted = order.clone();
    sorted.sort_unstable();
    match sorted.into_iter().eq(0..axes) {
        true => Ok(order),
        false => Err(invalid(format!("{order:?} is no order of {axes} axes"))),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn second() -> Json {
        json!({
            "shape": [5, 3], "chunks": [2, 3], "dtype": "<f4", "filters": null, "order": "C", "fill_value": 0,
            "compressor": { "id": "zlib", "level": 1 }, "zarr_format": 2
        })
    }

    fn third() -> Json {
        json!({
            "shape": [8, 4], "data_type": "int16", "fill_value": 7, "zarr_format": 3, "node_type": "array",
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": [4, 4] } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
            "codecs": [{ "name": "sharding_indexed", "configuration": {
                "chunk_shape": [2, 4], "codecs": [{ "name": "bytes", "configuration": { "endian": "big" } }, { "name": "gzip" }],
                "index_codecs": [{ "name": "bytes", "configuration": { "endian": "little" } }, { "name": "crc32c" }]
            } }]
        })
    }

    #[test]
    fn both_versions_are_read() {
        let meta = Meta::second(&second()).unwrap();
        assert_eq!(
            (&meta.shape[..], &meta.chunk[..], &meta.order[..]),
            (&[5, 3][..], &[2, 3][..], &[0, 1][..])
        );
        assert_eq!(
            (meta.keys.of("data/a", &[2, 0]), meta.codecs),
            ("data/a/2.0".to_owned(), vec![Codec::Zlib])
        );
        let meta = Meta::third(&third()).unwrap();
        assert_eq!((&meta.chunk[..], &meta.fill[..], meta.is_big_endian), (&[2, 4][..], &[7, 0][..], true));
        let shards = meta.shards.unwrap();
        assert_eq!(
            (&shards.chunks[..], shards.index_bytes(), shards.is_index_first),
            (&[2, 1][..], 36, false)
        );
        assert_eq!(meta.keys.of("data/a", &[1, 0]), "data/a/c/1/0");
    }

    #[test]
    fn what_is_not_read_has_a_name() {
        let refused = |change: &dyn Fn(&mut Json)| {
            let mut about = second();
            change(&mut about);
            Meta::second(&about).and_then(|meta| meta.check()).unwrap_err().to_string()
        };
        for (key, value, text) in [
            ("compressor", json!({ "id": "imagecodecs_jpegxl" }), "codec `imagecodecs_jpegxl`"),
            ("filters", json!([{ "id": "delta" }]), "filter `delta`"),
            ("dtype", json!([["a", "<f4"]]), "several parts"),
            ("dtype", json!("|O"), "`|O`"),
            ("order", json!("Z"), "order is `Z`"),
            ("chunks", json!([2, 0]), "chunks of [2, 0]"),
            ("chunks", json!([2]), "chunks of [2]"),
            ("shape", json!([u64::MAX, 3]), "shape is"),
            ("shape", json!("5"), "no shape"),
            ("dimension_separator", json!(":"), "no separator"),
        ] {
            let message = refused(&|about| about[key] = value.clone());
            assert!(message.contains(text), "{message}");
        }
        let refused = |pointer: &str, value: Json| {
            let mut about = third();
            *about.pointer_mut(pointer).unwrap() = value;
            Meta::third(&about).and_then(|meta| meta.check()).unwrap_err().to_string()
        };
        for (pointer, value, text) in [
            ("/data_type", json!({ "name": "numpy.datetime64" }), "`numpy.datetime64`"),
            ("/data_type", json!("string"), "`string`"),
            ("/chunk_grid/name", json!("rectilinear"), "`rectilinear`"),
            ("/codecs/0/configuration/chunk_shape", json!([3, 4]), "chunks of [3, 4]"),
            ("/codecs/0/configuration/codecs/1/name", json!("vlen-utf8"), "`vlen-utf8`"),
            ("/codecs/0/configuration/codecs", json!([]), "in a known way"),
        ] {
            let message = refused(pointer, value);
            assert!(message.contains(text), "{message}");
        }
    }
}
