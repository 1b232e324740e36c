"""Which engine runs a network: the one that the user forces, or the first that is installed and can."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
from typing import NoReturn
from weakref import WeakSet

from z2p_core import registry
from z2p_core.errors.install_advice import ENGINE_EXTRAS, install_advice
from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import Engine, TrainedNetwork
from z2p_core.network.final_convs import FinalConvs
from z2p_renderer.pipeline.inference.loading import LoadedWeights
from z2p_renderer.storage.models.checkpoints import WeightsError
from z2p_renderer.storage.models.engine_cache import user_cache
from z2p_renderer.storage.models.onnx_deltas import INT8, graph_path, load_graph
from z2p_renderer.storage.models.onnx_files import load_onnx

REFERENCE_ENGINE = "torch"
"""What quality is measured with, and the other engines against."""
_started: WeakSet[Engine] = WeakSet()
"""All engines of this process."""


def _keep_for_good() -> None:
    """Engines that a fork has of its parent are without their threads: to take them apart would wait for ever."""
    for engine in _started:
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(engine))


os.register_at_fork(after_in_child=_keep_for_good)


def start_engine(
    loaded: LoadedWeights, file: Path, name: str | None = None, threads: int | None = None, exact: bool = False
) -> Engine:
    """The engine called `name`, or of those that may run unasked the one of the lowest rank, on the weights of `file`.

    `exact` leaves those out that are not, unless forced.

    Raises:
        PluginError: no such engine, or its library is not installed.
        WeightsError: no engine can run these weights: the export beside them is missing, damaged or of others.
    """
    digest = loaded.weights.digest
    whole = load_onnx(file, digest)
    onnx, int8 = whole or load_graph(file, digest), load_graph(file, digest, INT8)
    network = TrainedNetwork(
        loaded.buffer_channels, loaded.encoder.channels, loaded.settings, onnx, loaded.build, int8, user_cache(),
        loaded.windows,
    )  # fmt: skip
    chosen = _chosen(name, network, file, exact)
    try:
        engine = chosen(network, threads)
    except (WeightsError, registry.PluginError, ImportError, MemoryError):
        raise
    except Exception as error:  # whatever an engine's library makes of a stranger's network
        raise WeightsError(f"{file}: engine {chosen.name!r} cannot run its network ({type(error).__name__}: "
                           f"{error_reason(error)}); write its export again: {_export(file)}") from error
    _started.add(engine)
    if chosen.reads_onnx and (chosen.reads_int8 or whole is None):  # graph files leave out the last of a network
        engine.last = FinalConvs.from_tensors(loaded.weights.tensors, loaded.config)
    return engine


def check_engine(name: str) -> type[Engine]:
    """The engine called so.

    Raises:
        PluginError: no such engine, or its library is not installed.
    """
    engine: type[Engine] = registry.load("engines", name)
    if not engine.installed():
        raise registry.PluginError(f"engine {name!r} needs {engine.package}, which is not installed; {_advice(engine)}")
    return engine


def _chosen(name: str | None, network: TrainedNetwork, file: Path, exact: bool) -> type[Engine]:
    if name is not None:
        engine = check_engine(name)
        if not _can_run(engine, network):
            _refuse(engine, file)
        return engine
    known: list[type[Engine]] = sorted((registry.load("engines", one) for one in registry.names("engines")),
                                       key=lambda one: (one.rank, one.name))  # fmt: skip
    for engine in known:
        if (engine.exact if exact else engine.unasked()) and engine.installed() and _can_run(engine, network):
            return engine
    raise WeightsError(
        f"{file}: expected {file.with_suffix('.onnx').name} beside it, or torch; {_export(file)}, or torch here: "
        f"{install_advice('torch')}"
    )


def _can_run(engine: type[Engine], network: TrainedNetwork) -> bool:
    if engine.reads_int8:
        return network.int8 is not None
    return network.onnx is not None or not engine.reads_onnx


def _refuse(engine: type[Engine], file: Path) -> NoReturn:
    if engine.reads_int8:
        raise WeightsError(f"engine {engine.name!r} needs {graph_path(file, INT8).name} beside {file}, which shipped "
                           "weights have where 8 bits are good enough for them; choose another engine")
    raise WeightsError(f"engine {engine.name!r} needs {file.with_suffix('.onnx').name} beside {file}; {_export(file)}")


def _advice(engine: type[Engine]) -> str:
    """How to install what an engine needs: as an extra of z2p for its own."""
    ours = engine.__module__.startswith("z2p_renderer.plugins.")
    if not ours:
        return f"pip install {engine.package}"
    return install_advice(engine.package if engine.package in ENGINE_EXTRAS else "")


def _export(file: Path) -> str:
    return f"where torch and onnx are installed, python -m z2p_renderer.pipeline.export {file} writes it"
