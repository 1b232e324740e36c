"""Scan files are made by the helpers of the readers' own tests."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "plugins"))
