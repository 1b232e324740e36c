"""``python -m z2p_renderer.workflows COMMAND``: see `workflows.commands`."""

from z2p_renderer.workflows.commands import run

run()
