"""Subcommands of `z2p`, one file each; `pipeline.cli` names them and imports them when they are called."""
