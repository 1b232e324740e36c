"""``python -m z2p_renderer.pipeline.cli COMMAND``: `z2p` where its script is not in PATH."""

from z2p_renderer.pipeline.cli import main

main()
