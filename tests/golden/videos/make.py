"""Makes the videos of this folder by ffmpeg, and `expected.json`: what PyAV decodes. `python make.py` in this folder; needs av, numpy and pyarrow.

Per video: the arguments of ffmpeg, the size, and of each frame that is shown its time in seconds and the CRC-32 of its RGB bytes. Decoding
H.264 and AV1 is exact, so the planes of PyAV count; RGB is computed from them as in crates/swm-media/src/mp4/colors.rs. Of a video that is
valid and not decoded: the reason. `episodes_apart.parquet` is the list of episodes of `lerobot_v3.0` for a video in which the second one
begins at 2.1 s, 1.7 s after the end of the first.
"""
import json
import subprocess
import zlib
from pathlib import Path

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

HERE = Path(__file__).parent
HEIGHT, WIDTH, FPS = 64, 80, 10


def scene(count, height=HEIGHT, width=WIDTH):
    """A square that crosses a drifting gradient with noise: no frame is like another."""
    y, x = np.mgrid[:height, :width]
    noise = np.random.default_rng(0)
    frames = []
    for t in range(count):
        frame = np.stack([3 * x + 5 * t, 4 * y + 3 * t, np.full_like(x, 40 + 4 * t)], -1) % 256
        top, left = height // 4, (3 * t) % max(width - 12, 1)
        frame[top : top + 12, left : left + 12] = (230, 40, 40)
        frame = frame + noise.integers(-6, 7, frame.shape)
        frames.append(frame.clip(0, 255).astype(np.uint8))
    return np.stack(frames)


def ffmpeg(*arguments, data=None):
    subprocess.run(["ffmpeg", "-y", "-v", "error", *arguments], input=data, check=True, cwd=HERE)


def encode(out, arguments, count=36, height=HEIGHT, width=WIDTH):
    source = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -framerate {FPS} -i -".split()
    ffmpeg(*source, *arguments.split(), out, data=scene(count, height, width).tobytes())


X264 = "-c:v libx264 -crf 26 -pix_fmt yuv420p"
X264_ANY = "-c:v libx264 -crf 26"
SVT = "-c:v libsvtav1 -crf 40 -preset 8 -pix_fmt yuv420p"
AOM = "-c:v libaom-av1 -crf 40 -cpu-used 8 -b:v 0"
FRAGMENTS = "-movflags frag_keyframe+empty_moov+delay_moov"
B = "bframes=3:b-adapt=0:scenecut=0"

# Name: arguments, and how the scene differs.
VIDEOS = {
    "h264_baseline": (f"{X264} -profile:v baseline -x264-params keyint=12:scenecut=0", {}),
    "h264_main_long": (f"{X264} -profile:v main -x264-params {B}:keyint=250:b-pyramid=normal", {"count": 60}),
    "h264_high": (f"{X264} -x264-params {B}:keyint=12:ref=4:weightp=2:slices=3", {"height": 50, "width": 66}),
    "h264_intra": (f"{X264} -x264-params keyint=1", {"count": 8}),
    "h264_open_gop": (f"{X264} -x264-params open-gop=1:{B}:keyint=10", {}),
    "h264_open_gop_without_b": (f"{X264} -x264-params open-gop=1:bframes=0:keyint=10:scenecut=0", {}),
    "h264_intra_refresh": (f"{X264} -x264-params intra-refresh=1:keyint=10:scenecut=0", {}),
    "h264_references": (f"{X264} -x264-params {B}:keyint=20:ref=8:weightb=1:weightp=2:b-pyramid=strict:cabac=0", {}),
    "h264_matrices": (f"{X264} -x264-params cqm=jvt:keyint=20 -vf scale=out_color_matrix=bt709 -colorspace bt709", {"count": 12}),
    "h264_full_range": ("-c:v libx264 -crf 26 -pix_fmt yuvj420p -x264-params keyint=12", {"count": 14}),
    "h264_bt2020": (f"{X264} -vf scale=out_color_matrix=bt2020 -colorspace bt2020nc -x264-params keyint=12", {"count": 6}),
    "h264_gray": (f"{X264_ANY} -pix_fmt gray -x264-params {B}:keyint=12", {"count": 20}),
    "h264_tiny": (f"{X264} -x264-params {B}:keyint=12", {"height": 16, "width": 16, "count": 20}),
    "h264_wide": (f"{X264} -x264-params keyint=12", {"height": 18, "width": 130, "count": 14}),
    "h264_fragments": (f"{X264} -x264-params {B}:keyint=12 {FRAGMENTS}", {}),
    "h264_fragments_open_gop": (f"{X264} -x264-params open-gop=1:{B}:keyint=10 {FRAGMENTS}+default_base_moof", {}),
    "av1_svt": (f"{SVT} -g 10", {}),
    "av1_svt_open_gop": (f"{SVT} -g 10 -svtav1-params irefresh-type=1", {}),
    "av1_aom": (f"{AOM} -pix_fmt yuv420p -g 10 -lag-in-frames 16", {}),
    "av1_aom_intra": (f"{AOM} -pix_fmt yuv420p -g 1", {"count": 6}),
    "av1_aom_gray": (f"{AOM} -pix_fmt gray -g 10", {"count": 14}),
    "av1_aom_odd": (f"{AOM} -pix_fmt yuv420p -g 10", {"height": 65, "width": 63, "count": 12}),
    "av1_fragments": (f"{SVT} -g 10 {FRAGMENTS}", {}),
}

# Name: source, arguments before and behind it. Nothing is encoded, so that an edit list hides what comes before.
CUTS = {
    "h264_cut": ("h264_main_long", "-ss 1.3", "-t 1.2"),
    "h264_cut_between": ("h264_high", "-ss 1.45", "-t 1.1"),
    "h264_cut_baseline": ("h264_baseline", "-ss 1.7", ""),
    "h264_cut_fragments": ("h264_high", "-ss 1.5", "-movflags frag_keyframe+delay_moov"),
    "av1_cut": ("av1_svt", "-ss 1.3", "-t 1.2"),
}

# Name: arguments, the reason. `NO_IDR` begins with a picture that is no IDR picture.
UNSUPPORTED = {
    "no_h264_444": (f"{X264_ANY} -pix_fmt yuv444p", "H.264 in 4:4:4 is not decoded"),
    "no_h264_422": (f"{X264_ANY} -pix_fmt yuv422p", "H.264 in 4:2:2 is not decoded"),
    "no_h264_10_bits": (f"{X264_ANY} -pix_fmt yuv420p10le", "H.264 in 10 bits is not decoded"),
    "no_h264_lossless": ("-c:v libx264 -qp 0 -pix_fmt yuv420p", "lossless H.264 is not decoded"),
    "no_h264_interlaced": (f"{X264} -flags +ilme+ildct -x264-params tff=1", "interlaced H.264 is not decoded"),
    "no_h264_temporal": (f"{X264} -x264-params {B}:direct=temporal:cabac=0", "H.264 in temporal direct mode without CABAC is not decoded"),
    "no_av1_10_bits": (f"{AOM} -pix_fmt yuv420p10le", "AV1 in 10 bits is not decoded"),
    "no_av1_444": (f"{AOM} -pix_fmt yuv444p", "AV1 in 4:4:4 is not decoded"),
    "no_hevc": ("-c:v libx265 -pix_fmt yuv420p -x265-params log-level=none", "its codec is HEVC `hev1`"),
    "no_vp9": ("-c:v libvpx-vp9 -pix_fmt yuv420p", "its codec is VP9 `vp09`"),
}
NO_IDR = ("no_h264_cut_open_gop", "h264_open_gop", "-ss 2.1", "does not begin with an IDR picture")

WEIGHTS = {1: (0.2126, 0.0722), 9: (0.2627, 0.0593)}


def rgb(frame):
    """The frame as `[H, W, 3]`, in 16.16 fixed point, chroma repeated."""
    planes = []
    for plane, half in zip(frame.planes, (False, True, True)):
        values = np.frombuffer(bytes(plane), np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width].astype(np.int64)
        planes.append(np.repeat(np.repeat(values, 2, 0), 2, 1)[: frame.height, : frame.width] if half else values)
    if len(planes) == 1:
        planes += [np.full_like(planes[0], 128)] * 2
    luma, first, second = planes[0], planes[1] - 128, planes[2] - 128
    red, blue = WEIGHTS.get(int(frame.colorspace), (0.299, 0.114))
    green = 1.0 - red - blue
    is_full = int(frame.color_range) == 2
    black, scale, chroma = (0, 1.0, 1.0) if is_full else (16, 255 / 219, 255 / 224)
    fixed = lambda weight: int(np.copysign(np.floor(abs(weight) * 65536 + 0.5), weight))
    gray = fixed(scale) * (luma - black) + (1 << 15)
    parts = [
        fixed(2 * (1 - red) * chroma) * second,
        fixed(-2 * (1 - blue) * blue / green * chroma) * first + fixed(-2 * (1 - red) * red / green * chroma) * second,
        fixed(2 * (1 - blue) * chroma) * first,
    ]
    return np.stack([((gray + part) >> 16).clip(0, 255) for part in parts], -1).astype(np.uint8)


def decoded(path):
    """Frames in the order of their times; what an edit list hides has none or one below 0."""
    with av.open(str(path)) as file:
        frames = sorted((frame for frame in file.decode(video=0) if frame.time >= 0), key=lambda frame: frame.time)
        size = [frames[0].height, frames[0].width]
        return size, [[round(float(frame.time), 6), zlib.crc32(rgb(frame).tobytes())] for frame in frames]


def episodes_apart():
    table = pq.read_table(HERE / "../datasets/lerobot_v3.0/meta/episodes/chunk-000/file-000.parquet")
    camera = "videos/observation.images.top"
    for name, times in ((f"{camera}/from_timestamp", [0.0, 2.1]), (f"{camera}/to_timestamp", [0.4, 2.7])):
        table = table.set_column(table.schema.get_field_index(name), name, pa.array(times))
    pq.write_table(table, HERE / "episodes_apart.parquet")


def main():
    episodes_apart()
    videos, unsupported = {}, {}
    for name, (arguments, options) in VIDEOS.items():
        encode(f"{name}.mp4", arguments, **options)
        videos[name] = {"made_by": arguments}
    for name, (source, before, behind) in CUTS.items():
        ffmpeg(*before.split(), "-i", f"{source}.mp4", *behind.split(), "-c", "copy", f"{name}.mp4")
        videos[name] = {"made_by": f"{before} -i {source}.mp4 {behind} -c copy"}
    for name, video in videos.items():
        video["size"], video["frames"] = decoded(HERE / f"{name}.mp4")
    for name, (arguments, reason) in UNSUPPORTED.items():
        encode(f"{name}.mp4", arguments, count=12 if "temporal" in name else 2)
        unsupported[name] = {"made_by": arguments, "reason": reason}
    name, source, before, reason = NO_IDR
    ffmpeg(*before.split(), "-i", f"{source}.mp4", "-c", "copy", f"{name}.mp4")
    unsupported[name] = {"made_by": f"{before} -i {source}.mp4 -c copy", "reason": reason}
    lines = lambda entries: ",\n".join(f"  {json.dumps(name)}: {json.dumps(entry)}" for name, entry in entries.items())
    text = f'{{"videos": {{\n{lines(videos)}\n}}, "unsupported": {{\n{lines(unsupported)}\n}}}}\n'
    (HERE / "expected.json").write_text(text)
    version = subprocess.run(["ffmpeg", "-version"], capture_output=True, text=True).stdout.split()[2]
    print("ffmpeg", version, "PyAV", av.__version__, "FFmpeg of PyAV", av.library_versions["libavcodec"], "NumPy", np.__version__)


main()
