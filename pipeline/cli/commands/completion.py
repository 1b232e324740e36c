"""`z2p completion`: the script that completes commands and options in a shell."""

from __future__ import annotations

import click


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    """Print the script that completes z2p's commands and options with the Tab key.

    \b
    bash: echo 'eval "$(z2p completion bash)"' >> ~/.bashrc
    zsh:  echo 'eval "$(z2p completion zsh)"' >> ~/.zshrc
    fish: z2p completion fish > ~/.config/fish/completions/z2p.fish
    """
    from click.shell_completion import get_completion_class

    from z2p_renderer.pipeline.cli import main

    complete = get_completion_class(shell)
    if complete is None:
        raise click.UsageError(f"no completion for {shell}")
    click.echo(complete(main, {}, "z2p", "_Z2P_COMPLETE").source())
