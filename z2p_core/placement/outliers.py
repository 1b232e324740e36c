"""Which points to leave out of the frame: strays that would make the object small in it."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import bounding_box
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.isolated_points import non_isolated_mask
from z2p_core.surface.subsampling import subsample_uniform

MOST_LOOKED_AT = 20_000
"""A larger cloud is thinned to this many points before it is weighed as a whole."""
FEWEST_TO_CLIP, FEWEST_APART = 100, 64
"""Points of which some may be strays, and of which a cluster may be all that is drawn; fewer are drawn as balls."""
SMALL_CLUSTER, MOST_CLIPPED = 0.01, 0.02
"""Shares of all points: of one stray cluster at most, and of everything that is clipped."""
GAP, NEIGHBOURS = 4.0, 12
"""How far off a part of a thing may be, in the spacings of its points there, and the neighbours that tell these."""
MOST_PARTS, ASKED, BODY_CELLS = 64, 8, 64
"""Small clusters that may be parts of a thing (more are not looked at), and points of each; and cells along the thing's
widest side, each with one point, to find the nearest."""
LEAST_SPAN = 1e-300
"""Of a cloud whose places in a grid are still numbers."""
LEAST_GAIN = 0.1
"""Clipping must shrink the bounding sphere's radius by this share at least, or the height where strays lie below;
otherwise they do no harm."""
SMALL_BELOW = 0.001
"""Share of all points, of strays that lie below a thing in all."""


UNSEEN = 0.02
"""Share of the picture's disc that all clusters fill at most, each by its own sphere, where next to nothing shows."""
MOST_SCATTERED = 0.25
"""Share of the points that may lie scattered in small clusters, and still count as strays."""
MOST, MANY_CELLS = 0.7, 150
"""Share of the points that specks hold at least, and more cells of a coarse grid than they can take up."""
MOST_FAR = 8
"""Times that a cloud is looked at for what lies far away: each time the rest is a tenth as wide or less."""


def few_of(points: np.ndarray) -> np.ndarray:
    """`MOST_LOOKED_AT` of points (N, 3) at most, whatever their order."""
    return subsample_uniform(points, MOST_LOOKED_AT)


def remove_outliers(points: np.ndarray) -> tuple[np.ndarray, int]:
    """Points (M, 3) without outliers of finite points (N, 3), and how many were too far away for anything to show.

    Small clusters go first, then clusters so far away that the frame would show specks, and last isolated points.
    """
    kept = inlier_mask(points)
    points = points[kept] if not kept.all() else points
    near = visible_cluster_mask(points)
    far_count = len(near) - int(near.sum())
    if far_count:
        points = points[near]
        points = points[inlier_mask(points)]
    connected = non_isolated_mask(points)
    return points[connected] if not connected.all() else points, far_count


def inlier_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for strays that would make the object small in its sphere.

    Strays are clusters of under 1 % of the points, apart from the rest by a cell or more of a coarse grid. They go only
    when that shrinks the bounding sphere's radius by over 10 %, and never more than 2 % of the points in all.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < FEWEST_TO_CLIP:
        return kept
    for _ in range(4):  # a stray very far away hides the nearer ones from the first grid
        rows = np.flatnonzero(kept)
        budget = int(MOST_CLIPPED * len(points)) - (len(points) - len(rows))
        strays = _strays(points[rows], int(SMALL_CLUSTER * len(points)), budget)
        if not strays.any():
            break
        kept[rows[strays]] = False
    return kept


def visible_cluster_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for clusters so far from the largest one that nothing would show.

    Clusters far from each other are specks in a picture of them all. The one with the most points is kept then, with
    what lies near enough for all of it to be seen; where two have as many, the wider one is.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < FEWEST_APART:
        return kept
    for _ in range(MOST_FAR):
        rows = np.flatnonzero(kept)
        largest = _largest_of_specks(points[rows])
        if largest is None:
            break
        kept[rows[~largest]] = False
    return kept


def _largest_of_specks(points: np.ndarray) -> np.ndarray | None:
    """Mask (N,) of the largest cluster of points (N, 3), where all of them together would hardly show; else None."""
    if _spread_out(points):
        return None
    cluster = _clusters(points)
    sizes = np.bincount(cluster)
    low, high = np.full((len(sizes), 3), np.inf), np.full((len(sizes), 3), -np.inf)
    order = np.argsort(cluster, kind="stable")
    starts = np.flatnonzero(np.diff(cluster[order], prepend=-1))
    for axis in range(3):
        low[:, axis] = np.minimum.reduceat(points[order, axis], starts)
        high[:, axis] = np.maximum.reduceat(points[order, axis], starts)
    radii = np.linalg.norm(high - low, axis=1) / 2
    whole = float(np.linalg.norm(high.max(0) - low.min(0))) / 2
    small = sizes <= SMALL_CLUSTER * len(points)
    if sizes[small].sum() <= MOST_SCATTERED * len(points):  # strays may lie in wide chains, of which nothing shows
        radii[small] = 0.0
    if (radii**2).sum() >= UNSEEN * whole**2:
        return None
    return np.asarray(cluster == np.lexsort((low[:, 0], radii, sizes))[-1])


def _spread_out(points: np.ndarray) -> bool:
    """Whether most of points (N, 3) take up more of the space about them than specks in it do; told at once."""
    low, high = bounding_box(points)
    step = max(float((high - low).max()), LEAST_SPAN) / 24
    some = points[:: -(-len(points) // MOST_LOOKED_AT)]  # no order makes many cells of few
    place = ((some - low) / step).astype(np.int64)
    count = np.bincount((place[:, 0] * 25 + place[:, 1]) * 25 + place[:, 2])
    count = count[count > 0]
    if len(count) <= MANY_CELLS:
        return False
    return bool(np.partition(count, -MANY_CELLS)[-MANY_CELLS:].sum() < MOST * len(some))


def above_low_outliers_mask(points: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3) and their heights (N,): False for strays that would lift the thing up.

    The floor touches the lowest point, so a few wrong ones below, as lidar has, leave the rest to hover above it.
    They go when they are small clusters, of under 0.1 % of the points in all, and the height shrinks by over 10 %.
    """
    kept = np.ones(len(points), dtype=bool)
    most = int(SMALL_BELOW * len(points))
    if most == 0:
        return kept
    lowest = np.argpartition(height, most)[: most + 1]
    lowest = lowest[np.argsort(height[lowest], kind="stable")]
    rise = height[lowest] - height[lowest[0]]
    if rise[-1] < LEAST_GAIN * np.ptp(height):
        return kept
    cluster = _clusters(points)
    small = (np.bincount(cluster) <= most)[cluster[lowest]]
    count = len(lowest) if small.all() else int(small.argmin())  # all that lie below the first that is no stray
    if count <= most and rise[count] >= LEAST_GAIN * np.ptp(height):
        kept[lowest[:count]] = False
    return kept


def _strays(points: np.ndarray, largest: int, budget: int) -> np.ndarray:
    """Mask (N,) of the points in small clusters outside the sphere of the others, when that sphere is clearly smaller.

    Clusters of up to `largest` points count, the farthest ones first, up to `budget` points in all.
    """
    none = np.zeros(len(points), dtype=bool)
    cluster = _clusters(points)
    sizes = np.bincount(cluster)
    small = sizes <= largest
    if small.all() or not small.any():
        return none
    rows = np.flatnonzero(small[cluster])
    reach = np.zeros(len(sizes))
    centre = points[~small[cluster]].mean(0)
    np.maximum.at(reach, cluster[rows], np.sqrt(((points[rows] - centre) ** 2).sum(1)))
    farthest = np.flatnonzero(small)[np.argsort(-reach[small], kind="stable")]
    taken = np.zeros(len(sizes), dtype=bool)
    taken[farthest[np.cumsum(sizes[farthest]) <= budget]] = True
    strays = taken[cluster]
    rest_of = few_of(points[~strays])
    rest = bounding_sphere(rest_of)
    whole = bounding_sphere(np.vstack([rest_of, points[strays]])) if strays.any() else rest
    if rest.radius > (1 - LEAST_GAIN) * whole.radius:
        return none
    outside = np.sqrt(((points - rest.centre) ** 2).sum(1)) > 1.02 * rest.radius
    return strays & outside & ~_adjoining(points, cluster, taken, sizes > largest)


def _adjoining(points: np.ndarray, cluster: np.ndarray, taken: np.ndarray, large: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points whose cluster is `taken` for strays, but as near to a `large` one as its points there.

    Where one part of a thing is scanned far more finely, the cells are too small for the others, and part them.
    """
    joined: list[int] = []
    clusters = np.flatnonzero(taken)
    if len(clusters) > MOST_PARTS:
        clusters = clusters[:0]
    body = subsample_uniform(points[large[cluster]], len(points))  # in an order that is not the file's
    places = np.floor((body - body.min(axis=0)) * (BODY_CELLS / max(float(np.ptp(body, axis=0).max()), LEAST_SPAN)))
    few = body[np.unique(places @ [1, BODY_CELLS + 1, (BODY_CELLS + 1) ** 2], return_index=True)[1]]
    for one in clusters:
        own = points[cluster == one]
        own = own[np.argsort(((own - body.mean(0)) ** 2).sum(1), kind="stable")[:ASKED]]  # on the body's side
        away = np.sqrt(((own[:, None] - few) ** 2).sum(-1))
        nearest = few[away.min(axis=0).argmin()]
        around = np.partition(((body - nearest) ** 2).sum(1), min(NEIGHBOURS, len(body) - 1))
        spacing = np.sqrt(np.pi * around[min(NEIGHBOURS, len(body) - 1)] / NEIGHBOURS)
        if away.min() < GAP * spacing:
            joined.append(int(one))
    return np.isin(cluster, joined)


def _clusters(points: np.ndarray) -> np.ndarray:
    """Number (N,) of each point's cluster: points in touching cells of a coarse grid.

    Cells are a 24th of the widest side, or wider where the cloud is sparse: four points in a taken cell on average.
    """
    low, high = bounding_box(points)
    span = max(float((high - low).max()), LEAST_SPAN)
    for cells in (24, 16, 12, 8, 6):
        place = ((points - low) * (cells / span * (1 - 1e-9))).astype(np.int64)
        side = cells + 2  # an empty border, so that no neighbour wraps around
        key = ((place[:, 0] + 1) * side + place[:, 1] + 1) * side + place[:, 2] + 1
        count = np.bincount(key, minlength=side**3)
        if len(points) >= 4 * np.count_nonzero(count):
            break
    taken = np.flatnonzero(count)
    label = np.full(side**3, side**3, dtype=np.int64)
    label[taken] = taken
    steps = [(x * side + y) * side + z for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)]
    while True:
        least = np.min([label[taken + step] for step in steps], axis=0)
        least = np.minimum(least, label[least])  # jump along what the neighbour has found
        if np.array_equal(least, label[taken]):
            break
        label[taken] = least
    return np.unique(label[key], return_inverse=True)[1]
