"""What differs is told in words that a user can act on."""

import pytest

from z2p_renderer.storage.results.differences import compare_fields

PLUGIN = {"name": "metallic", "version": "1", "code": "a"}
OLD = {
    "schema": 2, "stage": "render", "stage_version": 1, "code": {"pipeline.render": "a"}, "packages": {"bpy": "5.0.1"},
    "mesh": "aa", "meshes": [["cow", "1"], ["ape", "2"]], "train": "bb",
    "parameters": {"samples": 4, "passes": [], "loss": {"ssim": 0.2}, "controls": [PLUGIN]},
}  # fmt: skip


def told(**changed):
    return list(map(str, compare_fields(OLD, {**OLD, **changed})))


@pytest.mark.parametrize(
    "changed, expected",
    [
        ({}, []),
        ({"parameters": {**OLD["parameters"], "passes": ()}}, []),
        ({"stage_version": 2}, ["stage version 1 -> 2"]),
        ({"code": {"pipeline.render": "b"}}, ["code of pipeline.render changed"]),
        ({"packages": {"bpy": "5.0.2"}}, ["package bpy 5.0.1 -> 5.0.2"]),
        ({"mesh": "ab"}, ["mesh contents changed"]),
        ({"meshes": [["cow", "3"], ["bee", "2"]]}, ["meshes of the evaluation changed: ape, bee, cow"]),
        ({"train": "cc"}, ["upstream train changed"]),
        ({"parameters": {**OLD["parameters"], "samples": 5}}, ["samples 4 -> 5"]),
        ({"parameters": {**OLD["parameters"], "loss": {"ssim": 0.5}}}, ["loss.ssim 0.2 -> 0.5"]),
        ({"parameters": {**OLD["parameters"], "passes": ["depth", "normal"]}}, ["passes  -> depth, normal"]),
        (
            {"parameters": {**OLD["parameters"], "controls": [{**PLUGIN, "version": "2", "code": "b"}]}},
            ["plugin metallic version 1 -> 2", "plugin metallic code changed"],
        ),
        (
            {"parameters": {**OLD["parameters"], "controls": [{**PLUGIN, "name": "coat"}]}},
            ["controls metallic -> coat"],
        ),
    ],
)
def test_each_difference_has_a_sentence(changed, expected):
    assert told(**changed) == expected


def test_results_of_the_schema_without_code_are_told_once():
    old = {key: value for key, value in OLD.items() if key not in ("code", "packages")} | {"schema": 1}
    assert list(map(str, compare_fields(old, OLD))) == ["its code was not yet recorded"]


def test_only_results_made_of_others_differ_upstream():
    assert [one.upstream for one in compare_fields(OLD, {**OLD, "train": "cc", "stage_version": 2})] == [False, True]
