"""``python -m workflows COMMAND``: see `workflows.commands`."""

from workflows.commands import run

run()
