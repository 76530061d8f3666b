//! Images as Foxglove shows them: the message `foxglove.CompressedImage` in Protocol Buffers, and the description of
//! that message that its channel needs.
//!
//! Source: <https://docs.foxglove.dev/docs/sdk/schemas/compressed-image>; the encoding of Protocol Buffers, and their
//! `descriptor.proto`.

use crate::error::{Result, invalid, missing};
/// Name of the message.
pub(super) const NAME: &str = "foxglove.CompressedImage";

const LENGTH_DELIMITED: u64 = 2;
/// Numbers of types in `descriptor.proto`.
const TYPE_INT64: u64 = 3;
const TYPE_INT32: u64 = 5;
const TYPE_STRING: u64 = 9;
const TYPE_MESSAGE: u64 = 11;
const TYPE_BYTES: u64 = 12;

/// An image as a message: time, PNG file, name of its column.
pub(super) fn message(time_ns: u64, png: &[u8], frame: &str) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(png.len() + frame.len() + 40);
    let mut time = Vec::new();
    number(&mut time, 1, time_ns / 1_000_000_000);
    number(&mut time, 2, time_ns % 1_000_000_000);
    field(&mut bytes, 1, &time);
    field(&mut bytes, 2, png);
    field(&mut bytes, 3, b"png");
    field(&mut bytes, 4, frame.as_bytes());
    bytes
}

/// The image file in a message.
pub(super) fn image(mut message: &[u8]) -> Result<&[u8]> {
    while !message.is_empty() {
        let tag = take_varint(&mut message)?;
        match tag & 7 {
            LENGTH_DELIMITED => {
                let length = take_varint(&mut message)?;
                let inner = usize::try_from(length).ok().and_then(|length| message.split_at_checked(length));
                let (inner, rest) = inner.ok_or(invalid("an image's message is cut short"))?;
                if tag >> 3 == 2 {
                    return Ok(inner);
                }
                message = rest;
            }
            0 => drop(take_varint(&mut message)?),
            1 => message = message.get(8..).ok_or(invalid("an image's message is cut short"))?,
            5 => message = message.get(4..).ok_or(invalid("an image's message is cut short"))?,
            kind => return Err(invalid(format!("an image's message has a field of kind {kind}"))),
        }
    }
    Err(missing("an image's message holds no image"))
}

/// The `FileDescriptorSet` of the message.
pub(super) fn description() -> Vec<u8> {
    let time = file(
        "google/protobuf/timestamp.proto",
        "google.protobuf",
        None,
        "Timestamp",
        &[("seconds", TYPE_INT64, None), ("nanos", TYPE_INT32, None)],
    );
    let image = file(
        "foxglove/CompressedImage.proto",
        "foxglove",
        Some("google/protobuf/timestamp.proto"),
        "CompressedImage",
        &[
            ("timestamp", TYPE_MESSAGE, Some(".google.protobuf.Timestamp")),
            ("data", TYPE_BYTES, None),
            ("format", TYPE_STRING, None),
            ("frame_id", TYPE_STRING, None),
        ],
    );
    let mut set = Vec::new();
    field(&mut set, 1, &time);
    field(&mut set, 1, &image);
    set
}

/// A `FileDescriptorProto` of one message, whose fields are numbered from 1.
fn file(
    name: &str,
    package: &str,
    needs: Option<&str>,
    message: &str,
    fields: &[(&str, u64, Option<&str>)],
) -> Vec<u8> {
    let mut inner = Vec::new();
    field(&mut inner, 1, message.as_bytes());
    for (at, (name, kind, of)) in fields.iter().enumerate() {
        let mut one = Vec::new();
        field(&mut one, 1, name.as_bytes());
        number(&mut one, 3, at as u64 + 1);
        // "Optional", which is every field of version 3.
        number(&mut one, 4, 1);
        number(&mut one, 5, *kind);
        if let Some(of) = of {
            field(&mut one, 6, of.as_bytes());
        }
        field(&mut inner, 2, &one);
    }
    let mut bytes = Vec::new();
    field(&mut bytes, 1, name.as_bytes());
    field(&mut bytes, 2, package.as_bytes());
    if let Some(needs) = needs {
        field(&mut bytes, 3, needs.as_bytes());
    }
    field(&mut bytes, 4, &inner);
    field(&mut bytes, 12, b"proto3");
    bytes
}

fn field(out: &mut Vec<u8>, at: u64, content: &[u8]) {
    varint(out, at << 3 | LENGTH_DELIMITED);
    varint(out, content.len() as u64);
    out.extend(content);
}

fn number(out: &mut Vec<u8>, at: u64, value: u64) {
    varint(out, at << 3);
    varint(out, value);
}

fn varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn take_varint(bytes: &mut &[u8]) -> Result<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first().ok_or(invalid("an image's message is cut short"))?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Ok(value);
        }
    }
    Err(invalid("an image's message holds an endless number"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_come_back_from_messages() {
        let png = vec![7; 300];
        let message = message(12_345_678_901, &png, "pixels");
        assert_eq!(image(&message).unwrap(), png);
        for cut in 0..300 {
            assert!(image(&message[..cut]).is_err(), "{cut}");
        }
    }
}
