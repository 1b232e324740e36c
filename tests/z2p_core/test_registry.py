"""Plugins are found through entry points alone; what is unknown, doubled, broken or of the wrong kind is told clearly.

Strangers' packages are stood in for by a dist-info folder and a module on the path: all that importlib.metadata reads.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from z2p_core import registry
from z2p_core.interfaces import Control
from z2p_core.registry import PluginError

GLOSS = """
from z2p_core.interfaces import Control, Slider

class Gloss(Control):
    name = "gloss"
    version = "1"
    slider = Slider(("gloss",), (0.0,), (1.0,), (0.5,), help="0 dull to 1 glossy")

    def apply(self, value, scene):
        scene.material["Roughness"] = 1 - value[0]
"""

Install = Callable[..., None]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """Installer: ``install(package, version, group, {name: target}, module_name=source)``."""
    before = set(sys.modules)

    def add(package: str, version: str, group: str, entries: dict[str, str], **modules: str) -> None:
        site = tmp_path / package
        info = site / f"{package.replace('-', '_')}-{version}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n")
        lines = [f"{name} = {target}" for name, target in entries.items()]
        (info / "entry_points.txt").write_text("\n".join([f"[{group}]", *lines, ""]))
        for module, source in modules.items():
            (site / f"{module}.py").write_text(source)
        monkeypatch.syspath_prepend(str(site))
        registry._entries.cache_clear()

    yield add
    for module in set(sys.modules) - before:
        if str(getattr(sys.modules[module], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[module]
    monkeypatch.undo()
    registry._entries.cache_clear()


def test_plugins_are_listed_with_origin_without_importing() -> None:
    listed = {plugin.name: plugin for plugin in registry.installed("controls")}
    assert {"color", "light", "elevation", "metallic", "roughness"} <= set(listed)
    assert listed["color"].origin.startswith("z2p-renderer ")
    assert listed["color"].target == "z2p_renderer.plugins.controls.color:Color"


def test_a_strangers_plugin_is_the_equal_of_a_built_in(install: Install) -> None:
    install("z2p-gloss", "2.0", "z2p.controls", {"gloss": "gloss_plugin:Gloss"}, gloss_plugin=GLOSS)
    assert "gloss" in registry.names("controls")
    assert "gloss_plugin" not in sys.modules
    assert [plugin.origin for plugin in registry.installed("controls") if plugin.name == "gloss"] == ["z2p-gloss 2.0"]
    assert issubclass(registry.load("controls", "gloss"), Control)


def test_an_unknown_name_lists_the_installed_ones() -> None:
    with pytest.raises(PluginError, match=r"unknown control 'metalic'; installed: .*color.*light.*metallic"):
        registry.load("controls", "metalic")


def test_an_unknown_group_lists_the_groups() -> None:
    with pytest.raises(PluginError, match="unknown plugin group 'contols'; groups: controls, zbuffers"):
        registry.names("contols")


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ("import no_such_module_anywhere", "ModuleNotFoundError: No module named 'no_such_module_anywhere'"),
        ("def broken(:", "SyntaxError"),
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
        ("", "AttributeError"),
    ],
)
def test_a_broken_plugin_fails_only_where_it_is_asked_for(install: Install, source: str, reason: str) -> None:
    install("z2p-wreck", "0.3", "z2p.controls", {"wreck": "wreck_plugin:Wreck"}, wreck_plugin=source)
    assert "wreck" in registry.names("controls")
    assert any(plugin.name == "wreck" for plugin in registry.installed("controls"))
    assert registry.load("controls", "color").name == "color"
    with pytest.raises(PluginError, match=r"control 'wreck' from z2p-wreck 0\.3 fails to load") as caught:
        registry.load("controls", "wreck")
    assert reason in str(caught.value)
    assert caught.value.__cause__ is not None


def test_two_packages_with_one_name_are_both_named(install: Install) -> None:
    install("z2p-gloss", "2.0", "z2p.controls", {"gloss": "gloss_plugin:Gloss"}, gloss_plugin=GLOSS)
    install("other-gloss", "1.1", "z2p.controls", {"gloss": "other_gloss:Gloss"}, other_gloss=GLOSS)
    with pytest.raises(PluginError, match=r"'gloss' is claimed by .*; uninstall one") as caught:
        registry.load("controls", "gloss")
    assert "z2p-gloss 2.0" in str(caught.value) and "other-gloss 1.1" in str(caught.value)
    assert len([plugin for plugin in registry.installed("controls") if plugin.name == "gloss"]) == 2


def test_a_built_ins_name_cannot_be_taken_silently(install: Install) -> None:
    install("z2p-gloss", "2.0", "z2p.controls", {"color": "gloss_plugin:Gloss"}, gloss_plugin=GLOSS)
    with pytest.raises(PluginError, match="'color' is claimed by"):
        registry.load("controls", "color")


@pytest.mark.parametrize("target", ["json:JSONDecoder", "json:dumps", "z2p_core.interfaces:ZBuffer"])
def test_a_class_of_another_kind_is_refused(install: Install, target: str) -> None:
    install("z2p-odd", "1", "z2p.controls", {"odd": target})
    with pytest.raises(PluginError, match="'odd' from z2p-odd 1: expected a subclass of Control, got"):
        registry.load("controls", "odd")


def test_every_group_has_its_interface() -> None:
    from z2p_core import interfaces

    assert all(isinstance(getattr(interfaces, name), type) for name in registry.GROUPS.values())
