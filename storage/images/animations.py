"""Animations on disk: loops as WebP, GIF or MP4, written whole or not at all."""

from __future__ import annotations

import io
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_renderer.storage.files.atomic_write import NotAFileError, atomic_write, check_file_target
from z2p_renderer.storage.images.image_files import OPAQUE_SUFFIXES, WHITE, PictureError, record_text

ANIMATION_SUFFIXES = (".webp", ".gif", ".mp4")
QUALITY = {"webp": 90, "crf": 18}
BT709_CONVERSION = ("scale=in_range=pc:out_range=tv:out_color_matrix=bt709:flags=bicubic+accurate_rnd+full_chroma_int,"
            "format=yuv420p")
BT709_TAGS = "setparams=range=tv:color_primaries=bt709:color_trc=bt709:colorspace=bt709"
"""What makes the colours of a video those of BT.709, and says so in the file: of untagged ones players guess by the
picture's size, and ffmpeg's own choice is BT.601, which turns greens and reds."""
MIN_FRAME_MS = 16
"""Milliseconds that a frame stays at least: viewers take 10 for a mistake, and show it for 100."""


def write_animation(
    frames: Sequence[np.ndarray],
    path: Path,
    rate: float,
    background: tuple[float, float, float] | None = None,
    record: dict[str, Any] | None = None,
) -> None:
    """Write frames (H, W, 4) uint8, straight RGBA, as an endless loop of `rate` frames a second.

    A WebP keeps the transparency; a GIF has one palette of 256 colours for all frames, so that none flickers with its
    palette; an MP4 (H.264) has even sides, for which a row or column of the background is added.

    Raises:
        PictureError: a suffix of another format, an MP4 without its extra, or something other than a file lies there.
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
        frames = [bytes_from_unit(composite(unit_from_bytes(frame), background)) for frame in frames]
    match suffix:
        case ".webp":
            atomic_write(_encode_webp(frames, rate, record), path)
        case ".gif":
            behind = bytes_from_unit(np.array(background))
            atomic_write(_encode_gif(frames, rate, behind, record), path)
        case _:
            atomic_write(_encode_mp4(frames, rate, record), path)


def check_animation_suffix(suffix: str) -> None:
    """Nothing, when loops can be written in the format of the suffix (lower-case, with its dot).

    Raises:
        PictureError: it stands for another format, or for MP4 and its extra is missing.
    """
    if suffix not in ANIMATION_SUFFIXES:
        raise PictureError(f"expected an animation named {', '.join(ANIMATION_SUFFIXES)}, got {suffix or 'no suffix'!r}")
    if suffix == ".mp4":
        _ffmpeg()


def _encode_webp(frames: Sequence[np.ndarray], rate: float, record: dict[str, Any] | None) -> bytes:
    from PIL import Image

    exif = Image.Exif()
    if record is not None:
        exif[0x010E] = record_text(record)
    first, *rest = (Image.fromarray(frame) for frame in frames)
    encoded = io.BytesIO()
    first.save(encoded, format="WEBP", save_all=True, append_images=rest, loop=0, quality=QUALITY["webp"], method=4,
               duration=_frame_durations(len(frames), rate, 1), minimize_size=True, exif=exif)  # fmt: skip
    return encoded.getvalue()


def _encode_gif(
    frames: Sequence[np.ndarray], rate: float, behind: np.ndarray, record: dict[str, Any] | None
) -> bytes:
    """The last of the colours is what is `behind` (3,) uint8: a page of that colour must show no edge."""
    from PIL import Image

    sample = np.concatenate([frame.reshape(-1, 3)[:: max(1, len(frames))] for frame in frames])
    side = int(np.sqrt(len(sample)))
    found = Image.fromarray(sample[: side * side].reshape(side, side, 3)).quantize(255, Image.Quantize.MEDIANCUT)
    colors = np.zeros((256, 3), dtype=np.uint8)
    known = np.array(found.getpalette(), dtype=np.uint8).reshape(-1, 3)[:255]
    colors[: len(known)], colors[255] = known, behind
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors.tobytes())

    def indexed(frame: np.ndarray) -> Image.Image:
        nearest = np.array(Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE))
        nearest[(frame == behind).all(-1)] = 255  # pillow takes neighbouring colours together
        image = Image.fromarray(nearest)
        image.putpalette(colors.tobytes())
        return image

    first, *rest = map(indexed, frames)
    encoded = io.BytesIO()
    comment = {} if record is None else {"comment": record_text(record).encode()}
    first.save(encoded, format="GIF", save_all=True, append_images=rest, loop=0,
               duration=_frame_durations(len(frames), rate, 10), optimize=False, disposal=1, **comment)  # fmt: skip
    return encoded.getvalue()


def _frame_durations(count: int, rate: float, step: int) -> list[int]:
    """Milliseconds that each frame stays, in whole steps of the format, so that all together keep the rate."""
    ends = np.rint(np.arange(count + 1) * 1000 / (rate * step)) * step
    return [max(int(stay), -(-MIN_FRAME_MS // step) * step) for stay in np.diff(ends)]


def _encode_mp4(frames: Sequence[np.ndarray], rate: float, record: dict[str, Any] | None) -> bytes:
    height, width = frames[0].shape[:2]
    odd = ((0, height % 2), (0, width % 2), (0, 0))
    with tempfile.TemporaryDirectory(prefix="z2p-") as folder:
        made = Path(folder) / "loop.mp4"
        command = [_ffmpeg(), "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
                   "-s", f"{width + width % 2}x{height + height % 2}", "-r", f"{rate:g}", "-i", "-",
                   "-vf", f"{BT709_CONVERSION},{BT709_TAGS}", "-color_primaries", "bt709", "-color_trc", "bt709",
                   "-colorspace", "bt709", "-color_range", "tv",
                   "-c:v", "libx264", "-crf", str(QUALITY["crf"]), "-pix_fmt", "yuv420p", "-movflags", "+faststart"]
        if record is not None:
            command += ["-metadata", f"comment={record_text(record)}"]
        raw = b"".join(np.pad(frame, odd, mode="edge").tobytes() for frame in frames)
        done = subprocess.run([*command, str(made)], input=raw, capture_output=True)
        if done.returncode != 0:
            reason = " ".join(done.stderr.decode(errors="replace").split())[-200:]
            raise PictureError(f"the video could not be encoded ({reason}); name a .webp instead")
        return made.read_bytes()


def _ffmpeg() -> str:
    """The encoder's program, which comes with an extra."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe
    except ImportError:
        raise PictureError(f"MP4 needs an extra; {install_advice('video')}; or name a .webp") from None
    program: str = get_ffmpeg_exe()
    return program
