"""`z2p view`: look around scans in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from z2p_renderer.pipeline.cli.errors import ExitStatus
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.param_types import OutputPath
from z2p_renderer.pipeline.cli.options.pictures import check_writable, parse_columns


@click.command(context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="SCAN...")
@click.option(
    "--output",
    "-o",
    default="pictures",
    type=OutputPath(),
    metavar="OUT",
    help="Folder that the page's buttons save pictures and cameras to.",
)
@click.option(
    "--host",
    default="127.0.0.1",
    metavar="HOST",
    help="Address to listen on. The default is reached from this machine only; 0.0.0.0 from all of the "
    "network, by whoever knows the printed address.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    show_default=False,
    help="Port to listen on.  [default: 8731, or a free one if that is in use]",
)
@click.option("--no-browser", is_flag=True, help="Print the address only.")
@click.option("--keep", is_flag=True, help="Go on when the page is closed; Ctrl+C ends it.")
@click.option("--engine", metavar="NAME", help="Engine that runs the network, as for z2p render.")
@click.option("--columns", metavar="NAMES", help="Names of the columns of text files, as for z2p render.")
@click.option("--recursive", "-r", is_flag=True, help="Read sub folders as well.")
@click.pass_context
def view(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Look around scans in the browser, then take the picture: each SCAN is a file, a folder or a quoted glob.

    \b
    z2p view bunny.ply
    z2p view ours.ply theirs.ply --output figure

    Drag turns and tilts, shift and drag moves the light, the wheel zooms. The page's buttons save the picture and its
    camera, and copy the command that makes the same picture. Close the page, or press Ctrl+C, to end.
    """
    columns = parse_columns(options)
    paths = find_input_scans(ctx, inputs, {**options, "quiet": False}, columns is not None)
    check_writable(output)
    from z2p_renderer.pipeline.cli.viewer.saving import Saver
    from z2p_renderer.pipeline.cli.viewer.server import ViewServer
    from z2p_renderer.pipeline.cli.viewer.viewed_scans import ViewedScans

    scans = ViewedScans(paths, options["engine"], columns)
    for fault in scans.faults:
        click.echo(f"not shown: {fault}", err=True)
    words = [word for name in ("engine", "columns") if options[name] for word in (f"--{name}", options[name])]
    server = ViewServer(scans, Saver(scans, output, words), options["host"], options["port"], not options["keep"])
    with server:
        _announce(server, options["no_browser"])
        try:
            server.serve_forever(poll_interval=0.2)
        except KeyboardInterrupt:
            click.echo("ended", err=True)
            ctx.exit(ExitStatus.DONE)
    click.echo("the page was closed: ended", err=True)


def _announce(server: Any, is_quiet: bool) -> None:
    """Prints the address, and opens it in a browser if there is one."""
    from z2p_renderer.pipeline.cli.viewer.server import DEFAULT_PORT

    if server.is_default_port_taken:
        click.echo(f"port {DEFAULT_PORT} is in use; took {server.server_port}", err=True)
    if not server.is_on_loopback:
        click.echo("whoever on the network knows this address can look and save; it is not encrypted", err=True)
    click.echo(server.address)
    if not is_quiet and not _open_browser(server.address):
        click.echo("no browser found here: open the address in one; Ctrl+C ends", err=True)


def _open_browser(address: str) -> bool:
    """Whether a browser with a window was asked to open the address; text browsers would take the terminal."""
    import os
    import sys
    import webbrowser

    has_window = sys.platform in ("darwin", "win32") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    try:
        return bool(has_window) and webbrowser.open(address)
    except (webbrowser.Error, OSError):
        return False
