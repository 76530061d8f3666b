"""Stores of Zarr with every codec that is read: `python make_codecs.py 2` with zarr 2.18.7, `python make_codecs.py 3` with zarr 3.1.6.

All arrays hold the values of `action`; `slashed` and `dotted` four times as much, as whole numbers.
"""

import shutil
import sys
from pathlib import Path

import numcodecs
import numpy as np
import zarr

HERE = Path(__file__).parent
WHOLE = np.cumsum(np.random.default_rng(0).integers(-3, 4, size=(310, 3)), axis=0)
VALUES = WHOLE.astype("<f4") / 4
ENDS = np.array([7, 150, 310])


def second() -> None:
    shutil.rmtree(HERE / "codecs.zarr", ignore_errors=True)
    root = zarr.open_group(str(HERE / "codecs.zarr"), mode="w", zarr_version=2)
    data, meta = root.create_group("data"), root.create_group("meta")
    meta.create_dataset("episode_ends", data=ENDS, chunks=(3,), dtype="<i8", compressor=None)
    blosc, zlib = numcodecs.Blosc, numcodecs.Zlib(5)

    def put(group, name, values, chunks, compressor, **options):
        group.create_dataset(name, data=values, chunks=chunks, dtype=options.pop("dtype", "<f4"), compressor=compressor, **options)

    put(data, "action", VALUES, (310, 3), None)
    for name in ("blosclz", "lz4", "lz4hc", "zlib", "zstd"):
        for shuffle in (0, 1, 2):
            put(data, f"{name}_{shuffle}", VALUES, (310, 3), blosc(name, 5, shuffle))
    codecs = {"zlib": zlib, "gzip": numcodecs.GZip(5), "zstd": numcodecs.Zstd(3), "lz4": numcodecs.LZ4()}
    for name, codec in codecs.items():
        put(data, f"plain_{name}", VALUES, (200, 2), codec)
    put(data, "fortran", VALUES, (200, 2), zlib, order="F")
    put(data, "big", VALUES, (100, 3), zlib, dtype=">f4")
    put(data, "slashed", WHOLE.astype("<i2"), (200, 2), blosc("lz4", 5, 1), dtype="<i2", dimension_separator="/")
    absent = data.create_dataset("absent", shape=VALUES.shape, chunks=(100, 3), dtype="<f4", compressor=zlib, fill_value=2.5)
    absent[100:200] = VALUES[100:200]
    put(data, "marks", WHOLE[:, 0] % 2 == 0, (310,), blosc("lz4", 5, 2), dtype="|b1")
    put(data.create_group("robot"), "joints", VALUES.astype("<f8"), (310, 3), blosc("zstd", 5, 2), dtype="<f8")
    put(data, "filtered", WHOLE.astype("<i4"), (310, 3), zlib, dtype="<i4", filters=[numcodecs.Delta("<i4")])


def third() -> None:
    from zarr.codecs import BloscCodec, BytesCodec, Crc32cCodec, GzipCodec, ShardingCodec, TransposeCodec, ZstdCodec

    shutil.rmtree(HERE / "codecs3.zarr", ignore_errors=True)
    root = zarr.open_group(str(HERE / "codecs3.zarr"), mode="w", zarr_format=3)
    data, meta = root.create_group("data"), root.create_group("meta")
    gzip, columns = GzipCodec(level=5), TransposeCodec(order=(1, 0))

    def put(group, name, values, **options):
        group.create_array(name, shape=values.shape, dtype=values.dtype, **options)[...] = values

    put(meta, "episode_ends", ENDS.astype("i8"), chunks=(3,), compressors=None)
    put(data, "action", VALUES, chunks=(310, 3), compressors=None)
    put(data, "blosc", VALUES, chunks=(200, 3), compressors=BloscCodec(cname="zstd", clevel=5, shuffle="bitshuffle"))
    put(data, "gzip", VALUES, chunks=(200, 2), compressors=gzip)
    put(data, "zstd", VALUES, chunks=(200, 2), compressors=ZstdCodec(level=3, checksum=True))
    put(data, "transposed", VALUES, chunks=(200, 2), filters=[columns], compressors=gzip)
    put(data, "big", VALUES, chunks=(100, 3), serializer=BytesCodec(endian="big"), compressors=gzip)
    put(data, "summed", VALUES, chunks=(200, 3), compressors=[gzip, Crc32cCodec()])
    naming = {"name": "v2", "separator": "."}
    put(data, "dotted", WHOLE.astype("i2"), chunks=(200, 2), chunk_key_encoding=naming, compressors=gzip)
    absent = data.create_array("absent", shape=VALUES.shape, dtype="f4", chunks=(100, 3), fill_value=float("nan"), compressors=gzip)
    absent[100:200] = VALUES[100:200]
    data.create_array("zeros", shape=VALUES.shape, dtype="f4", chunks=(100, 3))
    options = {"chunks": (10, 3), "shards": (100, 3), "fill_value": 2.5, "compressors": gzip}
    sharded = data.create_array("sharded", shape=VALUES.shape, dtype="f4", **options)
    sharded[:40], sharded[200:] = VALUES[:40], VALUES[200:]
    inner = [columns, BytesCodec(), BloscCodec(cname="lz4", shuffle="shuffle")]
    shards = ShardingCodec(chunk_shape=(10, 2), codecs=inner, index_location="start")
    put(data, "sharded_start", VALUES, chunks=(100, 4), serializer=shards, compressors=None, filters=None)


if __name__ == "__main__":
    {"2": second, "3": third}[sys.argv[1]]()
