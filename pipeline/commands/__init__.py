"""Subcommands of `z2p`, one file each; `z2p_renderer.pipeline.cli` names them and imports them when they are called."""
