"""``python -m z2p_renderer.workflows COMMAND``: see `z2p_renderer.workflows.commands`."""

from z2p_renderer.workflows.commands import run

run()
