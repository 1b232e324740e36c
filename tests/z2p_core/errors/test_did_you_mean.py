"""Suggestions for unknown names: synonyms, typing errors, and none if it is not clear what was meant."""

from __future__ import annotations

import pytest

from z2p_core.errors.did_you_mean import closest_name, edit_distance, suggest_name

KNOWN = ("output", "format", "up", "view", "azimuth", "load-camera", "resolution", "size", "background", "fit",
         "margin", "same-frame", "palette", "overwrite", "json", "jobs", "color", "light", "metallic")  # fmt: skip


@pytest.mark.parametrize(
    ("name", "guess"),
    [("out", "output"), ("output_dir", "output"), ("--colour", "color"), ("width", "resolution"), ("res", "resolution"),
     ("bg", "background"), ("transparent", "background transparent"), ("rotate", "azimuth"), ("jpg", "format jpeg"),
     ("camera", "load-camera"), ("padding", "margin"), ("force", "overwrite"), ("threads", "jobs"),
     ("crop", "fit tight"), ("same_frame", "same-frame"), ("UP_AXIS", "up")],
)  # fmt: skip
def test_a_synonym_suggests_the_option_of_its_meaning(name: str, guess: str) -> None:
    assert suggest_name(name, KNOWN) == guess


@pytest.mark.parametrize(
    ("name", "guess"),
    [("ouput", "output"), ("lihgt", "light"), ("colr", "color"), ("sise", "size"), ("heigth", "resolution"),
     ("backgrund", "background"), ("resoltuoin", "resolution"), ("overwirte", "overwrite")],
)  # fmt: skip
def test_typing_errors_are_corrected(name: str, guess: str) -> None:
    assert suggest_name(name, KNOWN) == guess


@pytest.mark.parametrize("name", ["frames", "noise", "views", "points", "seed", "blubb", "x", "", "dpi"])
def test_a_word_of_another_meaning_is_not_corrected(name: str) -> None:
    assert suggest_name(name, KNOWN) is None


def test_a_name_equally_close_to_two_others_is_not_corrected() -> None:
    assert closest_name("lath", ["path", "lathe"]) is None
    assert closest_name("lathee", ["path", "lathe"]) == "lathe"


def test_the_edit_distance_counts_each_typing_error_once() -> None:
    pairs = (("same", "same"), ("light", "lihgt"), ("light", "ligt"), ("light", "lights"), ("light", "sight"))
    assert [edit_distance(*pair) for pair in pairs] == [0, 1, 1, 1, 1]
    assert edit_distance("kitten", "sitting") == 3
