"""What somebody meant who wrote a name that is not there: by what it means elsewhere, or by a slip of the keys."""

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
    "motion turn": "turn turntable orbit spin", "motion light": "light-sweep sweep",
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
    "palette": "cmap colormap colour-map color-map colors colours",
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
"""Option, and a value that makes it what is meant -> what others call it."""
_MEANINGS: dict[str, list[str]] = {}
for _option, _words in _SYNONYMS.items():
    for _word in _words.split():
        _MEANINGS.setdefault(_word, []).append(_option)
MIN_LETTERS, MIN_LETTERS_FOR_TWO_SLIPS = 4, 8
"""Letters of a name in which one slip is told from another name, and of one that may hold two."""


def closest_name(name: str, known: Iterable[str]) -> str | None:
    """The known name that a name is, but for a slip of the keys, or two in a long one; None if none or several are."""
    if len(name) < MIN_LETTERS:
        return None
    near = [(edit_distance(name, other), other) for other in known if abs(len(other) - len(name)) < 3]
    near = sorted(found for found in near if found[0] <= (2 if min(len(name), len(found[1])) >= MIN_LETTERS_FOR_TWO_SLIPS else 1))
    alone = len(near) == 1 or (len(near) > 1 and near[0][0] < near[1][0])
    return near[0][1] if alone else None


def edit_distance(one: str, other: str) -> int:
    """Letters left out, put in, exchanged, or swapped with the next, that make one word of another."""
    rows = [list(range(len(other) + 1))]
    for i, letter in enumerate(one):
        row = [i + 1]
        for j, theirs in enumerate(other):
            row.append(min(rows[-1][j + 1] + 1, row[j] + 1, rows[-1][j] + (letter != theirs)))
            if i and j and (letter, one[i - 1]) == (other[j - 1], theirs):
                row[-1] = min(row[-1], rows[-2][j - 1] + 1)
        rows.append(row)
    return rows[-1][-1]


def suggest_name(name: str, known: Iterable[str]) -> str | None:
    """Which of the known names, and with which value, somebody means by an unknown one; None where nothing is sure.

    Words are joined by dashes, without any in front: ``output-dir`` means ``output``, ``transparent`` means
    ``background transparent``. A slip may not lead to a name of another meaning.
    """
    known = list(known)
    name = name.strip("-").replace("_", "-").lower()
    if name in known:
        return name
    options = [option for option in _MEANINGS.get(name, ()) if option.split()[0] in known]
    if options:
        return options[0]
    if name in _MEANINGS or name in _SYNONYMS or len(name) < 3:  # a word with a meaning that nothing here has
        return None
    like = closest_name(name, known)
    if like is not None:
        return like
    slipped = closest_name(name, _MEANINGS)
    return None if slipped is None else suggest_name(slipped, known)
