#!/usr/bin/env bash
# imageio-ffmpeg 0.8.1: an H.264 video of RGB frames is converted by the matrix of standard definition (BT.601), whatever
# its size, and names none in the file. Players take the one of high definition (BT.709) for large pictures: reds and greens shift.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check imageio-ffmpeg==0.8.1 numpy==2.3.5
venv/bin/python - <<'PY'
import subprocess

import imageio_ffmpeg
import numpy as np

frame = np.zeros((720, 1280, 3), np.uint8)
frame[..., 0] = 255
writer = imageio_ffmpeg.write_frames("red.mp4", (1280, 720), macro_block_size=8)
writer.send(None)
for _ in range(5):
    writer.send(frame.tobytes())
writer.close()
program = imageio_ffmpeg.get_ffmpeg_exe()
[stream] = [line for line in subprocess.run([program, "-i", "red.mp4"], capture_output=True, text=True).stderr.splitlines() if "Video:" in line]
raw = subprocess.run([program, "-v", "error", "-i", "red.mp4", "-frames:v", "1", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-"], capture_output=True).stdout
luma = raw[1280 * 360 + 640]
print(imageio_ffmpeg.__version__, stream.strip(), "luma of pure red:", luma)
assert "bt709" not in stream and abs(luma - 81) <= 2, "BT.601 gives 81 for pure red, BT.709 gives 63"
PY
