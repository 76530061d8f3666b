"""Writes the tables of this folder: python make.py (pylance 14.0.2, pyarrow, numpy). README.md describes them.

Values are formulas of the row, which crates/swm-lance/tests/golden/values.rs has too."""
import glob, json, os, shutil, struct, zlib
import lance, numpy as np, pyarrow as pa
HERE = os.path.dirname(os.path.abspath(__file__))
def h(row, salt):
    x = (row * 2654435761 + salt * 40503 + 12345) & 0xFFFFFFFF
    x ^= x >> 15; x = (x * 2246822519) & 0xFFFFFFFF; x ^= x >> 13
    return x
WORDS = ["push", "the", "block", "to", "the goal", "", "grün", "turn left", "stop", "pick up"]
def text(row, salt, count): return " ".join(WORDS[h(row * 16 + i, salt) % 10] for i in range(count))
def data(row, salt, size): return bytes(h(row * 4096 + i, salt) & 0xFF for i in range(size))
def fsl(item, width): return pa.list_(item, width)
def small(row, salt, every): return h(row, salt) % every == 0
f = lambda bits: (bits % 20001 - 10000) / 64
# name: (type, formula)
ALL = ("2.0", "2.1", "2.2")
COLUMNS = {
 "u8": (pa.uint8(), lambda r: h(r, 1) & 0xFF), "i8": (pa.int8(), lambda r: (h(r, 2) & 0xFF) - 128),
 "u16": (pa.uint16(), lambda r: h(r, 3) & 0xFFFF), "i16": (pa.int16(), lambda r: (h(r, 4) & 0xFFFF) - 32768),
 "u32": (pa.uint32(), lambda r: h(r, 5)), "i32": (pa.int32(), lambda r: h(r, 6) - (1 << 31)),
 "u64": (pa.uint64(), lambda r: h(r, 7) << 32 | h(r, 8)), "i64": (pa.int64(), lambda r: (h(r, 9) << 32 | h(r, 10)) - (1 << 63)),
 "f16": (pa.float16(), lambda r: np.float16(h(r, 11) % 2048 / 8)), "f32": (pa.float32(), lambda r: f(h(r, 12))), "f64": (pa.float64(), lambda r: h(r, 13) / 7.0),
 "bool": (pa.bool_(), lambda r: h(r, 14) % 2 == 1),
 "few": (pa.int32(), lambda r: h(r, 15) % 7), "step": (pa.int32(), lambda r: r % 100), "episode": (pa.int32(), lambda r: r // 100),
 "count": (pa.int64(), lambda r: 1000 + r), "narrow_u16": (pa.uint16(), lambda r: h(r, 45) % 100), "narrow_u8": (pa.uint8(), lambda r: h(r, 46) % 5),
 "same_bool": (pa.bool_(), lambda r: True), "same_null": (pa.int32(), lambda r: None if small(r, 76, 4) else 3), "matrix": (fsl(fsl(pa.float32(), 2), 3), lambda r: [[f(h(r * 6 + i * 2 + j, 77)) for j in range(2)] for i in range(3)]),
 "same_i32": (pa.int32(), lambda r: 5), "same_f32": (pa.float32(), lambda r: 0.5), "same_text": (pa.string(), lambda r: "always the same words, and more than thirty-two bytes"), "runs": (pa.float32(), lambda r: r // 50 * 0.5),
 "runs_bool": (pa.bool_(), lambda r: r % 100 == 99),
 "null_i32": (pa.int32(), lambda r: None if small(r, 16, 5) else h(r, 17) % 1000), "null_f64": (pa.float64(), lambda r: None if small(r, 18, 3) else h(r, 19) / 7.0),
 "null_bool": (pa.bool_(), lambda r: None if small(r, 20, 4) else h(r, 21) % 2 == 1), "null_text": (pa.string(), lambda r: None if small(r, 22, 3) else text(r, 23, 2)),
 "no_i32": (pa.int32(), lambda r: None), "no_text": (pa.string(), lambda r: None), "rare_f32": (pa.float32(), lambda r: None if r == 77 else f(h(r, 24))),
 "vec": (fsl(pa.float32(), 2), lambda r: [f(h(r * 2 + i, 25)) for i in range(2)]), "vec_f64": (fsl(pa.float64(), 3), lambda r: [h(r * 3 + i, 26) / 7.0 for i in range(3)]),
 "one": (fsl(pa.float32(), 1), lambda r: [f(h(r, 27))]), "bits": (fsl(pa.bool_(), 8), lambda r: [h(r * 8 + i, 28) % 2 == 1 for i in range(8)]),
 "vec_same": (fsl(pa.float32(), 4), lambda r: [1.0, 2.0, 3.0, 4.0]), "vec_few": (fsl(pa.int32(), 3), lambda r: [h(r * 3 + i, 29) % 3 for i in range(3)]),
 "vec_null": (fsl(pa.float32(), 3), lambda r: None if small(r, 30, 6) else [f(h(r * 3 + i, 31)) for i in range(3)]),
 "vec_items": (fsl(pa.float32(), 3), lambda r: [None if small(r * 3 + i, 32, 7) else f(h(r * 3 + i, 33)) for i in range(3)]),
 "text": (pa.string(), lambda r: text(r, 34, 3)), "text_few": (pa.string(), lambda r: "task " + WORDS[h(r, 35) % 10]), "text_large": (pa.large_string(), lambda r: text(r, 36, 1)),
 "bytes": (pa.binary(), lambda r: data(r, 37, h(r, 38) % 12)),
}
MORE = {
 "list": (pa.list_(pa.float32()), lambda r: None if small(r, 39, 11) else [f(h(r * 8 + i, 40)) for i in range(h(r, 41) % 4)]),
 "list_items": (pa.list_(pa.int64()), lambda r: [None if small(r * 8 + i, 42, 5) else h(r * 8 + i, 43) for i in range(1 + h(r, 44) % 3)]),
 "list_text": (pa.list_(pa.string()), lambda r: [text(r * 4 + i, 47, 1) for i in range(h(r, 48) % 3)]),
 "pair": (pa.struct([("a", pa.int32()), ("b", pa.float32())]), lambda r: {"a": h(r, 49) % 50, "b": f(h(r, 50))}),
}
LARGE = {  # rows above 256 bytes: full-zip
 "image": (fsl(pa.uint8(), 300), lambda r: [h(r * 300 + i, 51) & 0xFF for i in range(300)]), "jpeg": (pa.binary(), lambda r: data(r, 52, 300 + h(r, 53) % 200)),
 "jpeg_null": (pa.binary(), lambda r: None if small(r, 54, 4) else data(r, 55, 300)), "wide_null": (fsl(pa.float32(), 80), lambda r: None if small(r, 56, 3) else [f(h(r * 80 + i, 57)) for i in range(80)]),
 "wide_items": (fsl(pa.float32(), 70), lambda r: [None if small(r * 70 + i, 58, 9) else f(h(r * 70 + i, 59)) for i in range(70)]), "same_jpeg": (pa.binary(), lambda r: data(0, 60, 400)),
 "long_text": (pa.large_string(), lambda r: text(r, 61, 70)), "blob_large": (pa.large_binary(), lambda r: data(r, 62, 270)),
}
LISTS = {"zip_list": (pa.list_(pa.binary()), lambda r: None if small(r, 78, 5) else [data(r * 4 + i, 80, 300) for i in range(h(r, 79) % 4)]),
 "long_list": (pa.list_(pa.float32()), lambda r: None if small(r, 63, 5) else [f(h(r * 128 + i, 64)) for i in range(h(r, 65) % 100)])}
PACKED = {  # asked-for compression: metadata of the field
 "zstd_text": (pa.string(), lambda r: text(r, 66, 3), {"lance-encoding:compression": "zstd"}), "lz4_text": (pa.string(), lambda r: text(r, 67, 3), {"lance-encoding:compression": "lz4"}),
 "zstd_f32": (pa.float32(), lambda r: f(h(r, 68) % 40), {"lance-encoding:compression": "zstd"}), "lz4_i64": (pa.int64(), lambda r: h(r, 69) % 3 - 1, {"lance-encoding:compression": "lz4"}),
 "fsst_text": (pa.string(), lambda r: text(r, 70, 4), {"lance-encoding:compression": "fsst"}), "bss_f32": (pa.float32(), lambda r: f(h(r, 71)), {"lance-encoding:compression": "lz4", "lance-encoding:bss": "on"}),
 "rle_i32": (pa.int32(), lambda r: r // 9, {"lance-encoding:rle-threshold": "0.9"}), "lz4_null": (pa.string(), lambda r: None if small(r, 72, 4) else text(r, 73, 3), {"lance-encoding:compression": "lz4"}),
 "zstd_vec": (fsl(pa.float32(), 2), lambda r: [f(h(r * 2 + i, 74) % 20) for i in range(2)], {"lance-encoding:compression": "zstd"}),
 "zip_each": (pa.binary(), lambda r: data(r, 81, 40) * 8, {"lance-encoding:compression": "zstd", "lance-encoding:structural-encoding": "fullzip"}), "zip_zstd": (pa.binary(), lambda r: data(r % 3, 75, 40) * 8, {"lance-encoding:compression": "zstd", "lance-encoding:structural-encoding": "fullzip"}),
}
def table(columns, first, rows):
    fields = [pa.field(n, c[0], metadata=(c[2] if len(c) > 2 else None)) for n, c in columns.items()]
    return pa.table([pa.array([c[1](r) for r in range(first, first + rows)], c[0]) for c in columns.values()], schema=pa.schema(fields))
def write(name, columns, parts, version, **more):
    path = f"{HERE}/{name}.lance"; shutil.rmtree(path, ignore_errors=True); first = 0
    for rows in parts:
        lance.write_dataset(table(columns, first, rows), path, mode="append" if first else "create", data_storage_version=version, **more); first += rows
    for extra in ("_transactions", "_indices"): shutil.rmtree(f"{path}/{extra}", ignore_errors=True)
    finish(path, None, first)
def write_pages(name, columns, rows, version):
    """One file of many pages, which write_dataset makes of megabytes only."""
    from lance.file import LanceFileWriter
    from lance.fragment import DataFile, FragmentMetadata
    path = f"{HERE}/{name}.lance"; shutil.rmtree(path, ignore_errors=True); whole = table(columns, 0, rows)
    model = lance.write_dataset(whole, path, data_storage_version=version, enable_v2_manifest_paths=False); made = model.get_fragments()[0].data_files()[0]
    os.remove(f"{path}/data/{made.path}")
    with LanceFileWriter(f"{path}/data/pages.lance", whole.schema, data_cache_bytes=64, version=version) as w:
        for b in whole.to_batches(max_chunksize=9): w.write_batch(b)
    file = DataFile("pages.lance", made.fields, made.column_indices, made.file_major_version, made.file_minor_version)
    lance.LanceDataset.commit(path, lance.LanceOperation.Overwrite(whole.schema, [FragmentMetadata(0, [file], rows)]), enable_v2_manifest_paths=False)
    finish(path, whole, rows)
def finish(path, expected, rows):
    for extra in ("_transactions", "_indices"): shutil.rmtree(f"{path}/{extra}", ignore_errors=True)
    found = lance.dataset(path).to_table(); assert found.num_rows == rows and (expected is None or found.equals(expected.cast(found.schema))), path
    print(path.split("/")[-1], rows, sum(os.path.getsize(os.path.join(d, x)) for d, _, xs in os.walk(path) for x in xs))
def png(row):
    """An image of 8 x 9 pixels, whose red is the row."""
    raw = b"".join(b"\0" + bytes(v for x in range(9) for v in (row, x, y)) for y in range(8))
    chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 9, 8, 8, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(raw)) + chunk(b"IEND", b"")
def recorded():
    """Episodes of 3 and 2 rows as the reference and as this package write them: with an index, images, a record of what Lance cannot express."""
    rows = range(5); index = {"episode_idx": pa.array([4, 4, 4, 7, 7], pa.int32()), "step_idx": pa.array([0, 1, 2, 0, 1], pa.int32())}
    vec = lambda item, width, value: pa.array([[value(r * width + i) for i in range(width)] for r in rows], fsl(item, width))
    columns = {**index, "pixels": pa.array([png(r) for r in rows], pa.binary()), "action": pa.array([[r / 2, None if r == 1 else -r] if r != 4 else None for r in rows], fsl(pa.float32(), 2)),
        "a_b": vec(pa.uint8(), 1, lambda at: at % 2), "matrix": vec(pa.float64(), 6, lambda at: at / 4), "words": pa.array([json.dumps([f"w{r}", "x"]) for r in rows]), "task": pa.array([f"task {int(r > 2)}" for r in rows]), "count": vec(pa.int64(), 1, lambda at: 10**12 + at)}
    fields = [("pixels", "u8", [8, 9, 3], "step"), ("action", "f32", [2], "step"), ("a.b", "bool", [], "step"), ("matrix", "f64", [2, 3], "step"), ("words", "str", [2], "step"), ("task", "str", [], "episode"), ("count", "i64", [], "step")]
    record = {"version": 1, "frames_per_second": 25.0, "runs": [], "columns": [dict(zip(("name", "dtype", "shape", "kind"), field)) for field in fields]}
    for name in ("plain", "recorded"):
        path = f"{HERE}/{name}.lance"; shutil.rmtree(path, ignore_errors=True); d = lance.write_dataset(pa.table(columns), path, data_storage_version="2.1")
        if name == "recorded": d.update_metadata({"swm": json.dumps(record)})
        finish(path, None, 5)
    path = f"{HERE}/plain_episodes.lance"; shutil.rmtree(path, ignore_errors=True)
    lance.write_dataset(pa.table({"episode_idx": pa.array([7, 4], pa.int32()), "seed": pa.array([70, 40], pa.int64()), "scene": ["seven", None], "goal": pa.array([[7.0, 7.5], [4.0, 4.5]], pa.list_(pa.float32())), "mixed": pa.array([[1.0], []], pa.list_(pa.float32()))}), path); finish(path, None, 2)
BORDERS = ["few", "step", "episode", "count", "narrow_u16", "narrow_u8", "same_i32", "runs", "runs_bool", "bool", "null_i32", "rare_f32", "text_few", "vec_few"]
PAGES = ["i32", "vec", "text", "bytes", "bool", "null_i32", "list", "list_text", "jpeg", "vec_null", "text_few", "same_i32", "no_i32", "zip_list", "pair"]
if __name__ == "__main__":
    EVERY = {**COLUMNS, **MORE, **LARGE, **LISTS}
    for v in ALL:
        s = v.replace(".", "_")
        write(f"narrow_{s}", COLUMNS, [96], v)
        write(f"borders_{s}", {n: COLUMNS[n] for n in BORDERS}, [150, 20] if v == "2.0" else [1060, 40], v)
        write(f"lists_{s}", {**MORE, **LISTS}, [30], v)
        write(f"large_{s}", LARGE, [8], v)
        if v != "2.0": write(f"packed_{s}", PACKED, [150], v)
        write_pages(f"pages_{s}", {n: EVERY[n] for n in PAGES}, 19, v)
    recorded()
    # Columns in several files, one gone, one renamed.
    path = f"{HERE}/altered.lance"; write("altered", {n: COLUMNS[n] for n in ["i32", "few", "step"]}, [30, 10], "2.1"); d = lance.dataset(path)
    d.add_columns({"twice": "few * 2"}); d.drop_columns(["step"]); d.alter_columns({"path": "i32", "name": "renamed"}); finish(path, None, 40)
    # Rows that are deleted: lists of them for two fragments, the second one deleted from twice; and one so long that it is a bitmap.
    write("deleted", {"episode_idx": (pa.int32(), lambda r: r // 12), "count": COLUMNS["count"]}, [20, 130], "2.1"); d = lance.dataset(f"{HERE}/deleted.lance")
    d.delete("count in (1000, 1001, 1015, 1016, 1019, 1020)"); d.delete("count >= 1046 and count < 1144"); finish(f"{HERE}/deleted.lance", None, 46)
    zstd = {"lance-encoding:compression": "zstd"}; path = f"{HERE}/deleted_many.lance"
    write("deleted_many", {"episode_index": (pa.int32(), lambda r: r // 60, zstd), "frame_index": (pa.int32(), lambda r: r % 60, zstd)}, [6600], "2.1")
    lance.dataset(path).delete("(episode_index >= 20 and episode_index < 105) or (episode_index = 3 and frame_index >= 10 and frame_index < 20) or (episode_index = 5 and frame_index < 5) or (episode_index = 7 and frame_index >= 55)"); finish(path, None, 1480)
    # What the newest versions do not need; `altered` and `pages_2_0` keep it, for it has to be left alone.
    for name in ("borders_2_0", "borders_2_1", "borders_2_2", "pages_2_1", "pages_2_2", "recorded", "deleted", "deleted_many"):
        newest = lance.dataset(f"{HERE}/{name}.lance").version; names = {f"{newest}.manifest", f"{2**64 - 1 - newest}.manifest"}
        [os.remove(path) for path in glob.glob(f"{HERE}/{name}.lance/_versions/*.manifest") if os.path.basename(path) not in names]
    [os.remove(path) for path in glob.glob(f"{HERE}/deleted.lance/_deletions/1-2-*")]
