"""Suggestions for an unknown option or name: from synonyms that other programs use, and from typing errors."""

from __future__ import annotations

from collections.abc import Iterable

_SYNONYMS = {
    "output": "out outdir out-dir outfile out-file out-path output-dir output-directory output-file output-folder "
              "output-path dir directory folder save save-to dest destination target",
    "overwrite": "force replace clobber yes redo rerender",
    "color": "colour albedo base-color paint tint object-color surface-color material-color",
    "background": "bg back background-color backdrop bgcolor bg-color background-colour",
    "background transparent": "transparent transparency alpha no-background rgba",
    "resolution": "res size image-size img-size picture-size dimensions dimension dim pixels width height side",
    "supersample": "ssaa antialias antialiasing anti-alias aa super-sample supersampling oversample samples spp",
    "margin": "padding pad border gap space",
    "fit tight": "tight trim crop autocrop",
    "fit": "framing",
    "motion turn": "turn turntable spin", "motion orbit": "orbit fly-around flyaround",
    "motion light": "light-sweep sweep",
    "azimuth": "rotate rotation yaw turn angle spin azim rot rotate-z",
    "elevation": "pitch elev tilt altitude height-angle",
    "view": "side direction view-angle viewpoint look-from left right top", "view front": "front",
    "load-camera": "camera cam camera-file pose use-camera camera-pose extrinsics",
    "camera": "load-camera cam viewpoint pose",
    "save-camera": "write-camera export-camera camera-out",
    "up": "up-axis upaxis axis up-vector up-dir upright z-up y-up",
    "light": "light-position light-pos light-dir light-direction lamp lighting sun light-azimuth light-angle",
    "metallic": "metal metalness metallicity",
    "roughness": "rough gloss glossiness shininess",
    "keep-outliers": "keep-strays no-outlier-removal no-filter keep-all all-points",
    "cut-top": "cut clip ceiling remove-top remove-ceiling clip-top crop-top",
    "smooth": "denoise smoothing blur",
    "weights": "model checkpoint ckpt network net weight model-path",
    "engine": "backend device runtime provider",
    "jobs": "threads workers num-workers parallel processes n-jobs num-threads cores j",
    "format": "fmt type ext extension file-type filetype",
    "format png": "png", "format webp": "webp", "format jpeg": "jpg jpeg", "format tiff": "tif tiff",
    "format gif": "gif", "format mp4": "mp4 video",
    "recursive": "recurse subfolders sub-folders walk",
    "columns": "column-names cols header names fields usecols",
    "same-frame": "shared-frame common-frame same-camera same-scale shared-camera one-frame sequence",
    "palette": "colors colours",
    "colormap": "cmap colour-map color-map colourmap lut",
    "color-by": "colour-by color-field scalar scalars scalar-field attribute point-colors rgb",
    "clim": "range color-range limits vmin vmax color-limits value-range",
    "color-bar": "colorbar colour-bar colourbar scalar-bar",
    "classes": "class keep-classes keep-class labels",
    "relight": "relighting unlit shading",
    "sheet": "contact-sheet contactsheet montage grid collage",
    "gallery": "html web page",
    "json": "jsonl as-json machine-readable",
    "quiet": "silent no-progress",
    "fps": "framerate frame-rate rate",
    "frames": "n-frames num-frames frame-count steps",
    "motion": "mode animation kind",
    "steady": "motion-blur",
    "meshes": "mesh mesh-dir mesh-folder data dataset",
    "config": "cfg conf settings config-file",
    "workspace": "workdir work-dir run-dir runs",
    "dry-run": "dry dryrun plan-only",
    "seed": "random-seed rng",
    "noise": "sigma std jitter",
    "points": "n-points num-points npoints",
    "views": "n-views num-views",
    "samples": "spp cycles-samples",
    "help": "usage",
}  # fmt: skip
"""Option, or option and value -> the names that other programs give it."""
_OPTIONS_OF_SYNONYM: dict[str, list[str]] = {}
for _option, _words in _SYNONYMS.items():
    for _word in _words.split():
        _OPTIONS_OF_SYNONYM.setdefault(_word, []).append(_option)
MIN_LETTERS = 4
"""Shorter names are not corrected: one changed letter may make another name of them."""
MIN_LETTERS_FOR_TWO_SLIPS = 8
"""Names of this length or more may hold two typing errors, shorter ones one."""


def suggest_name(name: str, known: Iterable[str]) -> str | None:
    """The known name, with a value if need be, that an unknown name most likely stands for; None if it is not clear.

    Names are joined by dashes and have none in front: ``output-dir`` gives ``output``, ``transparent`` gives
    ``background transparent``. A word with a meaning of its own is not corrected to a name that means something else.
    """
    known = list(known)
    name = name.strip("-").replace("_", "-").lower()
    if name in known:
        return name
    options = [option for option in _OPTIONS_OF_SYNONYM.get(name, ()) if option.split()[0] in known]
    if options:
        return options[0]
    if name in _OPTIONS_OF_SYNONYM or name in _SYNONYMS or len(name) < 3:  # its meaning has no option here
        return None
    corrected = closest_name(name, known)
    if corrected is not None:
        return corrected
    synonym = closest_name(name, _OPTIONS_OF_SYNONYM)
    return None if synonym is None else suggest_name(synonym, known)


def closest_name(name: str, known: Iterable[str]) -> str | None:
    """The known name that differs by one typing error, or by two in a long name; None if none or several do."""
    if len(name) < MIN_LETTERS:
        return None
    candidates = [(edit_distance(name, other), other) for other in known if abs(len(other) - len(name)) < 3]
    near = sorted((distance, other) for distance, other in candidates if distance <= _max_slips(name, other))
    is_unique = len(near) == 1 or (len(near) > 1 and near[0][0] < near[1][0])
    return near[0][1] if is_unique else None


def _max_slips(name: str, other: str) -> int:
    return 2 if min(len(name), len(other)) >= MIN_LETTERS_FOR_TWO_SLIPS else 1


def edit_distance(one: str, other: str) -> int:
    """Number of insertions, deletions, substitutions and swaps of neighboring letters that turn one word into another.

    This is the restricted Damerau-Levenshtein distance (optimal string alignment).
    """
    rows = [list(range(len(other) + 1))]
    for i, letter in enumerate(one):
        row = [i + 1]
        for j, other_letter in enumerate(other):
            row.append(min(rows[-1][j + 1] + 1, row[j] + 1, rows[-1][j] + (letter != other_letter)))
            if i and j and (letter, one[i - 1]) == (other[j - 1], other_letter):
                row[-1] = min(row[-1], rows[-2][j - 1] + 1)
        rows.append(row)
    return rows[-1][-1]
