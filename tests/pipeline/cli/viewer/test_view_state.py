"""The page's settings become the options of the command and the keywords of the call."""

from __future__ import annotations

import pytest

from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.cli.viewer.view_state import (
    ViewState,
    call_text,
    command_text,
    control_flags,
    parse_options,
    state_from_json,
)


def test_what_was_not_touched_needs_no_words() -> None:
    assert state_from_json({}).options() == [] and state_from_json({}).keywords() == {}


def test_each_setting_has_its_option() -> None:
    state = state_from_json({"azimuth": -10, "up": "-Y", "style": "balls", "controls": {"elevation": [12.3456789]},
                             "size": [64, 48], "color_by": "heat", "colormap": "turbo", "color_bar": True,
                             "background": "#102030", "same_frame": True})  # fmt: skip
    assert state.options() == [
        "--up", "-Y", "--style", "balls", "--view", "350", "--elevation", "12.3457", "--color-by", "heat",
        "--colormap", "turbo", "--resolution", "64,48", "--background", "#102030", "--color-bar", "--same-frame",
    ]  # fmt: skip
    parsed = parse_options(state.options())
    assert parsed.controls == {"elevation": (12.3457,)} and parsed.options["view"] == 350.0
    assert state.keywords()["elevation"] == parsed.controls["elevation"][0] and state.keywords()["cmap"] == "turbo"


def test_a_colormap_without_a_field_is_left_out() -> None:
    assert "--colormap" not in ViewState(colormap="turbo").options()


def test_options_that_contradict_each_other_are_refused_as_by_the_command() -> None:
    with pytest.raises(SettingError, match="both choose the colour"):
        parse_options(ViewState(color_by="heat", controls={"color": (0.1, 0.2, 0.3)}).options())


def test_names_of_files_are_quoted() -> None:
    assert command_text(["-a b.ply"], "it's.png", []) == """z2p run-inference './-a b.ply' --output 'it'"'"'s.png'"""
    compile(call_text([repr("it's.ply")], "a.png", {"color": (0.1, 0.2, 0.3)}), "call", "exec")
    compile(call_text([repr("a.ply"), repr("b.ply")], "out", {}, has_batches=True), "call", "exec")


def test_every_installed_control_has_an_option() -> None:
    assert control_flags()["light"] == "--light"
