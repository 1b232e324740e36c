"""What a scan's fields hold: their ranges, and the points of each class."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core.interfaces import ScanError
from z2p_renderer.pipeline.coloring.fields import RGB, VECTOR_FIELDS, find_scalars
from z2p_renderer.storage.scans.clouds import PointFields, Scan

MAX_LISTED_CLASSES = 24
"""How many classes of a field are listed for people; all are in the JSON."""


def summarize_scan(scan: Scan) -> dict[str, Any]:
    """What a scan holds, as JSON values: its points, their bounding box, and its fields by name."""
    fields = scan.fields or PointFields(scan.points)
    return {
        "label": scan.label,
        "points": len(scan.points),
        "total": scan.total or len(scan.points) + scan.dropped + scan.repeated,
        "dropped": scan.dropped,
        "repeated": scan.repeated,
        "low": scan.points.min(axis=0).tolist(),
        "high": scan.points.max(axis=0).tolist(),
        "note": scan.note,
        "fields": {name: _summarize_field(scan, fields, name) for name in fields.values},
    }


def summary_rows(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """The table that people read: (name, text) for the points and each field."""
    size = ", ".join(f"{axis} {low:.6g} to {high:.6g}"
                     for axis, low, high in zip("xyz", summary["low"], summary["high"], strict=True))  # fmt: skip
    left_out = [f"{summary[key]} {words}" for key, words in (("dropped", "not finite"), ("repeated", "repeated"))
                if summary[key]]  # fmt: skip
    rows = [("points", "; ".join([str(summary["points"]), *left_out])), ("extent", size)]
    rows += [("note", summary["note"])] if summary["note"] else []
    rows += [(name, _describe(field)) for name, field in summary["fields"].items()]
    return rows if summary["fields"] else [*rows, ("fields", "none: only points")]


def _summarize_field(scan: Scan, fields: PointFields, name: str) -> dict[str, Any]:
    values = fields.values[name]
    if name in VECTOR_FIELDS:
        known = int(np.isfinite(values).all(axis=1).sum())
        kind = {"kind": fields.color_kind or "colours"} if name == RGB else {"kind": "normals"}
        return {**kind, "known": known, "of": len(values)}
    try:
        scalars = find_scalars(scan, name)
    except ScanError:
        return {"kind": "no scalars"}
    finite = scalars.values[np.isfinite(scalars.values)] if values.dtype.kind == "f" else scalars.values
    summary: dict[str, Any] = {"kind": str(values.dtype), "known": len(finite), "of": len(values)}
    if len(finite):
        summary.update(low=finite.min().item(), high=finite.max().item())
    if scalars.unit:
        summary["unit"] = scalars.unit
    if len(finite) and scalars.is_categorical:
        labels, counts = np.unique(finite, return_counts=True)
        summary["classes"] = [
            {"value": int(label), "name": scalars.class_names.get(int(label), ""), "points": int(count)}
            for label, count in zip(labels.tolist(), counts.tolist(), strict=True)
        ]
    return summary


def _describe(field: dict[str, Any]) -> str:
    """One field in words."""
    parts = [field["kind"]]
    if "low" in field:
        unit = f" {field['unit']}" if "unit" in field else ""
        is_constant = field["low"] == field["high"]
        parts.append(f"{field['low']:.6g}" + ("" if is_constant else f" to {field['high']:.6g}") + unit)
        if is_constant:
            parts.append("the same at every point")
    elif field.get("known") == 0:
        parts.append("no value at any point")
    if 0 < field.get("known", 0) < field.get("of", 0):
        parts.append(f"{field['of'] - field['known']} points without a value")
    classes = field.get("classes", [])
    if len(classes) > 1 or any(one["name"] for one in classes):
        named = [f"{one['value']} {one['name']}".strip() + f": {one['points']}" for one in classes]
        more = len(named) - MAX_LISTED_CLASSES
        listed = named[:MAX_LISTED_CLASSES] + ([f"and {more} more"] if more > 0 else [])
        parts.append(f"{len(classes)} {'class' if len(classes) == 1 else 'classes'} ({', '.join(listed)})")
    return ", ".join(parts)
