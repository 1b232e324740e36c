"""Which points to leave out of the frame: outliers that would make the object small in it."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import bounding_box
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.isolated_points import non_isolated_mask
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS
from z2p_core.surface.subsampling import subsample_uniform

MAX_SAMPLE = 20_000
"""A larger cloud is thinned to this many points before it is weighed as a whole."""
MIN_POINTS_TO_CLIP = 100
"""Smallest cloud in which clusters may be outliers."""
MAX_OUTLIER_CLUSTER_SHARE = 0.01
"""Largest share of all points that one outlier cluster may hold."""
MAX_OUTLIER_SHARE = 0.02
"""Largest share of all points that are removed as outlier clusters."""
MAX_PART_GAP_SPACINGS = 4.0
"""A part of the object may be this far off, in the spacing of the object's points there."""
SPACING_NEIGHBORS = 12
"""Neighbors that this spacing is estimated from."""
MAX_PART_CLUSTERS = 64
"""Small clusters that are tested for being parts of the object; more are not looked at."""
POINTS_PER_PART = 8
"""Points of each such cluster that are compared with the body."""
BODY_CELLS = 64
"""Cells along the body's widest side, each with one point, in which the nearest one is searched."""
MIN_SPAN = 1e-300
"""Smallest extent of a cloud at which its grid coordinates are finite."""
MIN_SHRINKAGE = 0.1
"""Clipping must shrink the bounding sphere's radius by this share at least, or the height where outliers lie below;
otherwise the outliers do no harm."""
MAX_LOW_OUTLIER_SHARE = 0.001
"""Share of the points that may be low outliers."""
MIN_VISIBLE_DISC_SHARE = 0.02
"""Share of the frame's disc that all clusters' spheres together cover at most where next to nothing is visible."""
MAX_SCATTERED_SHARE = 0.25
"""Share of the points that may lie scattered in small clusters, and still count as outliers."""
SPECK_POINT_SHARE = 0.7
"""Share of the points that specks hold at least."""
MAX_SPECK_CELLS = 150
"""Cells of a coarse grid that specks can take up at most."""
MAX_FAR_ROUNDS = 8
"""Rounds in which far clusters are removed: each leaves a cloud at most a tenth as wide."""


def outlier_sample(points: np.ndarray) -> np.ndarray:
    """`MAX_SAMPLE` of points (N, 3) at most, whatever their order."""
    return subsample_uniform(points, MAX_SAMPLE)


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
    """Mask (N,) bool of finite points (N, 3): False for outliers that would make the object small in its sphere.

    Strays are clusters of under 1 % of the points, apart from the rest by a cell or more of a coarse grid. They go only
    when that shrinks the bounding sphere's radius by over 10 %, and never more than 2 % of the points in all.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < MIN_POINTS_TO_CLIP:
        return kept
    for _ in range(4):  # a stray very far away hides the nearer ones from the first grid
        rows = np.flatnonzero(kept)
        budget = int(MAX_OUTLIER_SHARE * len(points)) - (len(points) - len(rows))
        outliers = _outlier_cluster_mask(points[rows], int(MAX_OUTLIER_CLUSTER_SHARE * len(points)), budget)
        if not outliers.any():
            break
        kept[rows[outliers]] = False
    return kept


def visible_cluster_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for clusters so far from the largest one that nothing would show.

    Clusters far from each other are specks in a picture of them all. The one with the most points is kept then, with
    what lies near enough for all of it to be seen; where two have as many, the wider one is.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < MIN_SURFACE_POINTS:
        return kept
    for _ in range(MAX_FAR_ROUNDS):
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
    small = sizes <= MAX_OUTLIER_CLUSTER_SHARE * len(points)
    if sizes[small].sum() <= MAX_SCATTERED_SHARE * len(points):  # wide chains of outliers hardly show
        radii[small] = 0.0
    if (radii**2).sum() >= MIN_VISIBLE_DISC_SHARE * whole**2:
        return None
    return np.asarray(cluster == np.lexsort((low[:, 0], radii, sizes))[-1])


def _spread_out(points: np.ndarray) -> bool:
    """Whether most of points (N, 3) fill more of their bounding box than specks would; a fast test."""
    low, high = bounding_box(points)
    step = max(float((high - low).max()), MIN_SPAN) / 24
    some = points[:: -(-len(points) // MAX_SAMPLE)]  # no order makes many cells of few
    place = ((some - low) / step).astype(np.int64)
    count = np.bincount((place[:, 0] * 25 + place[:, 1]) * 25 + place[:, 2])
    count = count[count > 0]
    if len(count) <= MAX_SPECK_CELLS:
        return False
    return bool(np.partition(count, -MAX_SPECK_CELLS)[-MAX_SPECK_CELLS:].sum() < SPECK_POINT_SHARE * len(some))


def above_low_outliers_mask(points: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3) and their heights (N,): False for those that would put the floor too low.

    The floor touches the lowest point, so a few wrong ones below, as lidar has, leave the rest to hover above it.
    They are removed if they are small clusters with less than 0.1 % of all points, and the height shrinks by over 10 %.
    """
    kept = np.ones(len(points), dtype=bool)
    max_count = int(MAX_LOW_OUTLIER_SHARE * len(points))
    if max_count == 0:
        return kept
    lowest = np.argpartition(height, max_count)[: max_count + 1]
    lowest = lowest[np.argsort(height[lowest], kind="stable")]
    rise = height[lowest] - height[lowest[0]]
    if rise[-1] < MIN_SHRINKAGE * np.ptp(height):
        return kept
    cluster = _clusters(points)
    small = (np.bincount(cluster) <= max_count)[cluster[lowest]]
    count = len(lowest) if small.all() else int(small.argmin())  # all below the first one that is no outlier
    if count <= max_count and rise[count] >= MIN_SHRINKAGE * np.ptp(height):
        kept[lowest[:count]] = False
    return kept


def _outlier_cluster_mask(points: np.ndarray, largest: int, budget: int) -> np.ndarray:
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
    outliers = taken[cluster]
    rest_of = outlier_sample(points[~outliers])
    rest = bounding_sphere(rest_of)
    whole = bounding_sphere(np.vstack([rest_of, points[outliers]])) if outliers.any() else rest
    if rest.radius > (1 - MIN_SHRINKAGE) * whole.radius:
        return none
    outside = np.sqrt(((points - rest.centre) ** 2).sum(1)) > 1.02 * rest.radius
    return outliers & outside & ~_adjoining(points, cluster, taken, sizes > largest)


def _adjoining(points: np.ndarray, cluster: np.ndarray, taken: np.ndarray, large: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points in `taken` clusters that are as near to a `large` one as its points are to each other.

    Where one part of an object is scanned far more finely, the cells are too small for the others, and part them.
    """
    joined: list[int] = []
    clusters = np.flatnonzero(taken)
    if len(clusters) > MAX_PART_CLUSTERS:
        clusters = clusters[:0]
    body = subsample_uniform(points[large[cluster]], len(points))  # in an order that is not the file's
    places = np.floor((body - body.min(axis=0)) * (BODY_CELLS / max(float(np.ptp(body, axis=0).max()), MIN_SPAN)))
    few = body[np.unique(places @ [1, BODY_CELLS + 1, (BODY_CELLS + 1) ** 2], return_index=True)[1]]
    for one in clusters:
        own = points[cluster == one]
        own = own[np.argsort(((own - body.mean(0)) ** 2).sum(1), kind="stable")[:POINTS_PER_PART]]  # on the body's side
        away = np.sqrt(((own[:, None] - few) ** 2).sum(-1))
        nearest = few[away.min(axis=0).argmin()]
        around = np.partition(((body - nearest) ** 2).sum(1), min(SPACING_NEIGHBORS, len(body) - 1))
        spacing = np.sqrt(np.pi * around[min(SPACING_NEIGHBORS, len(body) - 1)] / SPACING_NEIGHBORS)
        if away.min() < MAX_PART_GAP_SPACINGS * spacing:
            joined.append(int(one))
    return np.isin(cluster, joined)


def _clusters(points: np.ndarray) -> np.ndarray:
    """Number (N,) of each point's cluster: points in touching cells of a coarse grid.

    Cells are a 24th of the widest side, or wider where the cloud is sparse: four points in a taken cell on average.
    """
    low, high = bounding_box(points)
    span = max(float((high - low).max()), MIN_SPAN)
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
        least = np.minimum(least, label[least])  # jump to the label that the neighbor has reached
        if np.array_equal(least, label[taken]):
            break
        label[taken] = least
    return np.unique(label[key], return_inverse=True)[1]
