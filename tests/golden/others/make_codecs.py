"""Tables of a LeRobot dataset and of one of Minari in every codec that pyarrow writes: `python make_codecs.py` makes them anew.

pyarrow 26.0.1. The rows are those of `datasets/lerobot_v3.0` and of episode 1 of `field/minari_parquet`.
"""

from pathlib import Path

import pyarrow.parquet as pq

HERE = Path(__file__).parent
OUT = HERE / "codecs"
LEROBOT = HERE.parent / "datasets/lerobot_v3.0/data/chunk-000/file-000.parquet"
MINARI = HERE.parent / "field/minari_parquet/data/1/part-0.parquet"
CODECS = ("none", "snappy", "gzip", "zstd", "lz4", "brotli")


def main() -> None:
    OUT.mkdir(exist_ok=True)
    lerobot, minari = pq.read_table(LEROBOT), pq.read_table(MINARI)
    for codec in CODECS:
        pq.write_table(lerobot, OUT / f"lerobot_{codec}.parquet", compression=codec)
    # Codecs belong to columns: one of them that is not read is one too many.
    codecs = {name: "snappy" for name in lerobot.column_names} | {"action.list.element": "brotli"}
    del codecs["action"]
    pq.write_table(lerobot, OUT / "lerobot_one_brotli.parquet", compression=codecs)
    for codec in ("gzip", "zstd", "lz4", "brotli"):
        pq.write_table(minari, OUT / f"minari_{codec}.parquet", compression=codec)


if __name__ == "__main__":
    main()
