//! The values of the tables, as tests/golden/lance/make.py has them.

/// The items of a row: one, or those of a list. `None`: the row, or an item, is missing.
pub(crate) type Row = Option<Vec<Option<Vec<u8>>>>;

const WORDS: [&str; 10] =
    ["push", "the", "block", "to", "the goal", "", "grün", "turn left", "stop", "pick up"];

fn h(row: u64, salt: u64) -> u64 {
    let mut x = row.wrapping_mul(2_654_435_761).wrapping_add(salt * 40_503 + 12_345) & 0xffff_ffff;
    x ^= x >> 15;
    x = x.wrapping_mul(2_246_822_519) & 0xffff_ffff;
    x ^ x >> 13
}

fn text(row: u64, salt: u64, count: u64) -> Vec<u8> {
    let words: Vec<&str> = (0..count).map(|at| WORDS[(h(row * 16 + at, salt) % 10) as usize]).collect();
    words.join(" ").into_bytes()
}

fn data(row: u64, salt: u64, size: u64) -> Vec<u8> {
    (0..size).map(|at| h(row * 4096 + at, salt) as u8).collect()
}

fn f32_of(bits: u64) -> Vec<u8> {
    ((bits % 20_001) as f32 - 10_000.0).to_le_bytes().as_slice().try_into().map_or_else(
        |_| Vec::new(),
        |bytes: [u8; 4]| (f32::from_le_bytes(bytes) / 64.0).to_le_bytes().to_vec(),
    )
}

fn f64_of(bits: u64) -> Vec<u8> {
    (bits as f64 / 7.0).to_le_bytes().to_vec()
}

/// Of a multiple of 1/8 below 256.
fn f16_of(eighths: u64) -> Vec<u8> {
    let value = eighths as f32 / 8.0;
    let half = match value.to_bits() {
        0 => 0,
        bits => ((bits >> 23) as i32 - 112) << 10 | (bits >> 13 & 0x3ff) as i32,
    };
    (half as u16).to_le_bytes().to_vec()
}

fn flag(value: bool) -> Vec<u8> {
    vec![u8::from(value)]
}

fn i32_of(value: u64) -> Vec<u8> {
    (value as i32).to_le_bytes().to_vec()
}

fn one(bytes: Vec<u8>) -> Row {
    Some(vec![Some(bytes)])
}

fn optional(is_missing: bool, bytes: impl FnOnce() -> Vec<u8>) -> Row {
    (!is_missing).then(|| vec![Some(bytes())])
}

fn list(count: u64, item: impl Fn(u64) -> Vec<u8>) -> Row {
    Some((0..count).map(|at| Some(item(at))).collect())
}

fn small(row: u64, salt: u64, every: u64) -> bool {
    h(row, salt).is_multiple_of(every)
}

/// The row of a column.
pub(crate) fn row(column: &str, r: u64) -> Row {
    let wide = |salt| h(r, salt) << 32 | h(r, salt + 1);
    match column {
        "u8" => one(vec![h(r, 1) as u8]),
        "i8" => one(vec![((h(r, 2) & 0xff) as i64 - 128) as u8]),
        "u16" => one((h(r, 3) as u16).to_le_bytes().to_vec()),
        "i16" => one((((h(r, 4) & 0xffff) as i64 - 32_768) as i16).to_le_bytes().to_vec()),
        "u32" => one((h(r, 5) as u32).to_le_bytes().to_vec()),
        "i32" | "renamed" => one(((h(r, 6) as i64 - (1 << 31)) as i32).to_le_bytes().to_vec()),
        "u64" => one(wide(7).to_le_bytes().to_vec()),
        "i64" => one((wide(9) ^ 1 << 63).to_le_bytes().to_vec()),
        "f16" => one(f16_of(h(r, 11) % 2048)),
        "f32" => one(f32_of(h(r, 12))),
        "f64" => one(f64_of(h(r, 13))),
        "bool" => one(flag(h(r, 14) % 2 == 1)),
        "few" => one(i32_of(h(r, 15) % 7)),
        "twice" => one(i32_of(h(r, 15) % 7 * 2)),
        "step" => one(i32_of(r % 100)),
        "episode" => one(i32_of(r / 100)),
        "episode_idx" => one(i32_of(r / 12)),
        "episode_index" => one(i32_of(r / 60)),
        "frame_index" => one(i32_of(r % 60)),
        "count" => one((1000 + r).to_le_bytes().to_vec()),
        "narrow_u16" => one(((h(r, 45) % 100) as u16).to_le_bytes().to_vec()),
        "narrow_u8" => one(vec![(h(r, 46) % 5) as u8]),
        "same_i32" => one(i32_of(5)),
        "same_f32" => one(0.5f32.to_le_bytes().to_vec()),
        "same_bool" => one(flag(true)),
        "same_null" => optional(small(r, 76, 4), || i32_of(3)),
        "same_text" => one(b"always the same words, and more than thirty-two bytes".to_vec()),
        "runs" => one(((r / 50) as f32 * 0.5).to_le_bytes().to_vec()),
        "runs_bool" => one(flag(r % 100 == 99)),
        "null_i32" => optional(small(r, 16, 5), || i32_of(h(r, 17) % 1000)),
        "null_f64" => optional(small(r, 18, 3), || f64_of(h(r, 19))),
        "null_bool" => optional(small(r, 20, 4), || flag(h(r, 21) % 2 == 1)),
        "null_text" => optional(small(r, 22, 3), || text(r, 23, 2)),
        "no_i32" | "no_text" => None,
        "rare_f32" => optional(r == 77, || f32_of(h(r, 24))),
        "vec" => list(2, |at| f32_of(h(r * 2 + at, 25))),
        "vec_f64" => list(3, |at| f64_of(h(r * 3 + at, 26))),
        "one" => one(f32_of(h(r, 27))),
        "bits" => list(8, |at| flag(h(r * 8 + at, 28) % 2 == 1)),
        "vec_same" => list(4, |at| (at as f32 + 1.0).to_le_bytes().to_vec()),
        "vec_few" => list(3, |at| i32_of(h(r * 3 + at, 29) % 3)),
        "vec_null" if small(r, 30, 6) => None,
        "vec_null" => list(3, |at| f32_of(h(r * 3 + at, 31))),
        "vec_items" => {
            Some((0..3).map(|at| (!small(r * 3 + at, 32, 7)).then(|| f32_of(h(r * 3 + at, 33)))).collect())
        }
        "matrix" => list(6, |at| f32_of(h(r * 6 + at, 77))),
        "text" => one(text(r, 34, 3)),
        "text_few" => one([b"task ", WORDS[(h(r, 35) % 10) as usize].as_bytes()].concat()),
        "text_large" => one(text(r, 36, 1)),
        "bytes" => one(data(r, 37, h(r, 38) % 12)),
        "list" if small(r, 39, 11) => None,
        "list" => list(h(r, 41) % 4, |at| f32_of(h(r * 8 + at, 40))),
        "list_items" => Some(
            (0..1 + h(r, 44) % 3)
                .map(|at| (!small(r * 8 + at, 42, 5)).then(|| h(r * 8 + at, 43).to_le_bytes().to_vec()))
                .collect(),
        ),
        "list_text" => list(h(r, 48) % 3, |at| text(r * 4 + at, 47, 1)),
        "pair.a" => one(i32_of(h(r, 49) % 50)),
        "pair.b" => one(f32_of(h(r, 50))),
        "image" => list(300, |at| vec![h(r * 300 + at, 51) as u8]),
        "jpeg" => one(data(r, 52, 300 + h(r, 53) % 200)),
        "jpeg_null" => optional(small(r, 54, 4), || data(r, 55, 300)),
        "wide_null" if small(r, 56, 3) => None,
        "wide_null" => list(80, |at| f32_of(h(r * 80 + at, 57))),
        "wide_items" => {
            Some((0..70).map(|at| (!small(r * 70 + at, 58, 9)).then(|| f32_of(h(r * 70 + at, 59)))).collect())
        }
        "same_jpeg" => one(data(0, 60, 400)),
        "long_text" => one(text(r, 61, 70)),
        "blob_large" => one(data(r, 62, 270)),
        "long_list" if small(r, 63, 5) => None,
        "long_list" => list(h(r, 65) % 100, |at| f32_of(h(r * 128 + at, 64))),
        "zip_list" if small(r, 78, 5) => None,
        "zip_list" => list(h(r, 79) % 4, |at| data(r * 4 + at, 80, 300)),
        "zstd_text" => one(text(r, 66, 3)),
        "lz4_text" => one(text(r, 67, 3)),
        "zstd_f32" => one(f32_of(h(r, 68) % 40)),
        "lz4_i64" => one(((h(r, 69) % 3) as i64 - 1).to_le_bytes().to_vec()),
        "fsst_text" => one(text(r, 70, 4)),
        "bss_f32" => one(f32_of(h(r, 71))),
        "rle_i32" => one(i32_of(r / 9)),
        "lz4_null" => optional(small(r, 72, 4), || text(r, 73, 3)),
        "zstd_vec" => list(2, |at| f32_of(h(r * 2 + at, 74) % 20)),
        "zip_zstd" => one(data(r % 3, 75, 40).repeat(8)),
        "zip_each" => one(data(r, 81, 40).repeat(8)),
        other => panic!("no formula of `{other}`"),
    }
}
