"""Interfaces of engines and baselines, and the checks that `z2p_core.testing` runs on plugins."""
