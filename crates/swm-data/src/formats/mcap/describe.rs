//! The beginning of an MCAP file: what it is, how messages are to be read, which columns the dataset has.

use swm_core::{Dtype, Field};

use super::foxglove;
use super::index::{DATASET, STEP_TOPIC, is_image, topic};
use super::records::{CHANNEL, Content, HEADER, MAGIC, METADATA, SCHEMA};
use crate::recording::EP_IDX;

const LIBRARY: &str = concat!("swm-data ", env!("CARGO_PKG_VERSION"));
const JSON_SCHEMA: u16 = 1;
const IMAGE_SCHEMA: u16 = 2;

/// The beginning of a file, up to the first episode.
pub(super) fn head(fields: &[Field], row_ns: u64) -> Vec<u8> {
    let mut columns = fields.to_vec();
    columns.push(Field::step(EP_IDX, Dtype::I32, &[]));
    let mut bytes = MAGIC.to_vec();
    bytes.extend(Content::default().text("").text(LIBRARY).record(HEADER));
    bytes.extend(description(&columns).concat());
    let text = serde_json::to_string(&columns).unwrap_or_default();
    let values = [("version", "1".to_owned()), ("columns", text), ("row_ns", row_ns.to_string())];
    bytes.extend(Content::default().text(DATASET).map(&values).record(METADATA));
    bytes
}

/// The records that describe messages: schemas, and a channel per topic.
pub(super) fn description(columns: &[Field]) -> [Vec<u8>; 2] {
    let of = |dtype: Dtype| match dtype {
        Dtype::Bool => "boolean",
        Dtype::Str => "string",
        Dtype::U8 | Dtype::I32 | Dtype::I64 => "integer",
        Dtype::F32 | Dtype::F64 => "number",
    };
    let members: serde_json::Map<String, serde_json::Value> = columns
        .iter()
        .filter(|field| !is_image(field))
        .map(|field| {
            let one = serde_json::json!({"type": of(field.dtype)});
            let json =
                if field.shape.is_empty() { one } else { serde_json::json!({"type": "array", "items": one}) };
            (field.name.clone(), json)
        })
        .collect();
    let json = serde_json::json!({"type": "object", "properties": members}).to_string();
    let schema = |id: u16, name: &str, encoding: &str, data: &[u8]| {
        Content::default().u16(id).text(name).text(encoding).list(data).record(SCHEMA)
    };
    let mut schemas = schema(JSON_SCHEMA, "swm.Step", "jsonschema", json.as_bytes());
    schemas.extend(schema(IMAGE_SCHEMA, foxglove::NAME, "protobuf", &foxglove::description()));
    let channel = |id: u16, schema: u16, topic: &str, encoding: &str| {
        Content::default().u16(id).u16(schema).text(topic).text(encoding).map(&[]).record(CHANNEL)
    };
    let mut channels = channel(1, JSON_SCHEMA, STEP_TOPIC, "json");
    for (at, field) in columns.iter().filter(|field| is_image(field)).enumerate() {
        channels.extend(channel(at as u16 + 2, IMAGE_SCHEMA, &topic(&field.name), "protobuf"));
    }
    [schemas, channels]
}
