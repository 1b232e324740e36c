"""Animations on disk: endless loops as WebP, GIF, APNG or MP4, written atomically."""

from __future__ import annotations

import io
import json
import subprocess
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_write, check_file_target
from z2p_renderer.storage.images.image_files import OPAQUE_SUFFIXES, RECORD_KEYWORD, WHITE, PictureError, format_record

ANIMATION_SUFFIXES = (".webp", ".gif", ".mp4", ".apng")
WEBP_QUALITY = 90
"""Of 100; lossy."""
MP4_CRF = 18
"""Constant rate factor of x264: 0 is lossless, 23 the default, 18 visually lossless."""
BT709_CONVERSION = (
    "scale=in_range=pc:out_range=tv:out_color_matrix=bt709:flags=bicubic+accurate_rnd+full_chroma_int,format=yuv420p"
)
"""ffmpeg filters that convert RGB to the colors of BT.709; the default, BT.601, shifts greens and reds."""
BT709_TAGS = "setparams=range=tv:color_primaries=bt709:color_trc=bt709:colorspace=bt709"
"""ffmpeg filter that tags the file with BT.709; players guess the color space of untagged files by their size."""
MIN_FRAME_MS = 16
"""Shortest duration of a frame, ms: viewers take 10 ms for an error and show the frame for 100 ms."""


def write_animation(
    frames: Iterable[np.ndarray],
    path: Path,
    rate: float,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
) -> None:
    """Writes frames (H, W, 4) uint8, straight RGBA, as an endless loop of `rate` frames per second.

    WebP and APNG keep the transparency, APNG without any loss. GIF has one palette of 256 colors for all frames, so
    that colors do not flicker. MP4 (H.264) needs even sides; an odd side gets one more row or column by repeating the
    last. Frames of an MP4 are encoded as they come; of the others all are kept in memory.

    Raises:
        PictureError: the suffix is of another format, MP4 is asked for without its extra, or the path is that of
            something other than a file.
    """
    suffix = path.suffix.lower()
    check_animation_suffix(suffix)
    try:
        check_file_target(path)
    except NotAFileError as error:
        raise PictureError(str(error)) from None
    if background is None and suffix in OPAQUE_SUFFIXES:
        background = WHITE
    if background is not None:
        behind = background
        frames = (bytes_from_unit(composite(unit_from_bytes(frame), behind)) for frame in frames)
    match suffix:
        case ".webp":
            atomic_write(_encode_webp(list(frames), rate, record), path)
        case ".apng":
            atomic_write(_encode_apng(list(frames), rate, record), path)
        case ".gif":
            background_color = bytes_from_unit(np.array(background))
            atomic_write(_encode_gif(list(frames), rate, background_color, record), path)
        case _:
            atomic_write(_encode_mp4(iter(frames), rate, record), path)


def check_animation_suffix(suffix: str) -> None:
    """Makes sure that loops can be written in the format of a suffix (in lower case, with its dot).

    Raises:
        PictureError: the suffix is of another format, or it is .mp4 and the extra for it is not installed.
    """
    if suffix not in ANIMATION_SUFFIXES:
        suffixes = ", ".join(ANIMATION_SUFFIXES)
        raise PictureError(f"expected an animation named {suffixes}, got {suffix or 'no suffix'!r}")
    if suffix == ".mp4":
        _ffmpeg()


def _encode_webp(frames: Sequence[np.ndarray], rate: float, record: dict[str, Any] | None) -> bytes:
    from PIL import Image

    exif = Image.Exif()
    if record is not None:
        exif[0x010E] = format_record(record)
    first, *rest = (Image.fromarray(frame) for frame in frames)
    encoded = io.BytesIO()
    first.save(encoded, format="WEBP", save_all=True, append_images=rest, loop=0, quality=WEBP_QUALITY, method=4,
               duration=_frame_durations(len(frames), rate, 1), minimize_size=True, exif=exif)  # fmt: skip
    return encoded.getvalue()


def _encode_apng(frames: Sequence[np.ndarray], rate: float, record: dict[str, Any] | None) -> bytes:
    from PIL import Image, PngImagePlugin

    texts = PngImagePlugin.PngInfo()
    if record is not None:
        texts.add_text(RECORD_KEYWORD, json.dumps(record, allow_nan=False))
    first, *rest = (Image.fromarray(frame) for frame in frames)
    encoded = io.BytesIO()
    first.save(encoded, format="PNG", save_all=True, append_images=rest, loop=0, pnginfo=texts,
               duration=_frame_durations(len(frames), rate, 1), blend=PngImagePlugin.Blend.OP_SOURCE)  # fmt: skip
    return encoded.getvalue()


def _encode_gif(
    frames: Sequence[np.ndarray], rate: float, background: np.ndarray, record: dict[str, Any] | None
) -> bytes:
    """The last color of the palette is exactly `background` (3,) uint8: on a page of that color no edge may show."""
    from PIL import Image

    sample = np.concatenate([frame.reshape(-1, 3)[:: max(1, len(frames))] for frame in frames])
    side = int(np.sqrt(len(sample)))
    quantized = Image.fromarray(sample[: side * side].reshape(side, side, 3)).quantize(255, Image.Quantize.MEDIANCUT)
    colors = np.zeros((256, 3), dtype=np.uint8)
    sampled_colors = np.array(quantized.getpalette(), dtype=np.uint8).reshape(-1, 3)[:255]
    colors[: len(sampled_colors)], colors[255] = sampled_colors, background
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors.tobytes())

    def quantize(frame: np.ndarray) -> Image.Image:
        nearest = np.array(Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE))
        nearest[(frame == background).all(-1)] = 255  # pillow merges similar colors
        image = Image.fromarray(nearest)
        image.putpalette(colors.tobytes())
        return image

    first, *rest = map(quantize, frames)
    encoded = io.BytesIO()
    comment = {} if record is None else {"comment": format_record(record).encode()}
    first.save(encoded, format="GIF", save_all=True, append_images=rest, loop=0,
               duration=_frame_durations(len(frames), rate, 10), optimize=False, disposal=1, **comment)  # fmt: skip
    return encoded.getvalue()


def _frame_durations(count: int, rate: float, step: int) -> list[int]:
    """Duration of each frame in ms, in whole steps of the format; their sum keeps the frame rate."""
    ends = np.rint(np.arange(count + 1) * 1000 / (rate * step)) * step
    return [max(int(duration), -(-MIN_FRAME_MS // step) * step) for duration in np.diff(ends)]


def _encode_mp4(frames: Iterator[np.ndarray], rate: float, record: dict[str, Any] | None) -> bytes:
    """Each frame is handed to ffmpeg as it comes, so that a long film need not be in memory."""
    first = next(frames)
    height, width = first.shape[:2]
    padding = ((0, height % 2), (0, width % 2), (0, 0))
    with tempfile.TemporaryDirectory(prefix="z2p-") as folder:
        file = Path(folder) / "loop.mp4"
        command = [_ffmpeg(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
                   "-s", f"{width + width % 2}x{height + height % 2}", "-r", f"{rate:g}", "-i", "-",
                   "-vf", f"{BT709_CONVERSION},{BT709_TAGS}", "-color_primaries", "bt709", "-color_trc", "bt709",
                   "-colorspace", "bt709", "-color_range", "tv",
                   "-c:v", "libx264", "-crf", str(MP4_CRF), "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        if record is not None:
            command += ["-metadata", f"comment={format_record(record)}"]
        messages = Path(folder) / "messages.txt"
        with messages.open("wb") as log:
            encoder = subprocess.Popen([*command, str(file)], stdin=subprocess.PIPE, stdout=log, stderr=log)
            try:
                _feed(encoder, (np.pad(frame, padding, mode="edge") for frame in chain([first], frames)))
            finally:
                failed = encoder.wait() != 0
        if failed:
            reason = " ".join(messages.read_bytes().decode(errors="replace").split())[-200:]
            raise PictureError(f"the video could not be encoded ({reason}); name a .webp instead")
        return file.read_bytes()


def _feed(encoder: subprocess.Popen[bytes], frames: Iterator[np.ndarray]) -> None:
    """Writes raw frames to a process; stops if it ended early, whose exit status then says so."""
    assert encoder.stdin is not None
    with suppress(BrokenPipeError), encoder.stdin as pipe:
        for frame in frames:
            pipe.write(frame.tobytes())


def _ffmpeg() -> str:
    """Path of the ffmpeg program, which an extra installs.

    Raises:
        PictureError: the extra is not installed.
    """
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        raise PictureError(f"MP4 needs an extra; {install_advice('video')}; or name a .webp") from None
    program: str = get_ffmpeg_exe()
    return program
