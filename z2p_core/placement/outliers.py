"""Which points to leave out of the frame: outliers that would make the object small in it."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import CHUNK_POINTS, bounding_box
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.isolated_points import non_isolated_mask
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS
from z2p_core.surface.subsampling import subsample_uniform

MAX_SAMPLE = 20_000
"""Number of points to which a larger cloud is subsampled where bounding spheres and extents are estimated."""
MIN_POINTS_TO_CLIP = 100
"""Smallest cloud in which clusters may be outliers."""
MAX_OUTLIER_CLUSTER_SHARE = 0.01
"""Largest share of all points that one outlier cluster may hold."""
MAX_OUTLIER_SHARE = 0.02
"""Largest share of all points that are removed as outlier clusters."""
MAX_PART_GAP_SPACINGS = 4.0
"""Largest distance between a part and the rest of the object, in the spacing of the object's points there."""
SPACING_NEIGHBORS = 12
"""Neighbors that this spacing is estimated from."""
MAX_PART_CLUSTERS = 64
"""If there are more small clusters than this, none is tested for being a part of the object."""
POINTS_PER_PART = 8
"""Points of each such cluster that are compared with the body."""
BODY_CELLS = 64
"""Cells along the body's widest side; one point of each is compared with a part, to find the nearest."""
MIN_SPAN = 1e-300
"""Smallest extent of a cloud at which its grid coordinates are finite, in the cloud's units."""
MIN_SHRINKAGE = 0.1
"""Outliers are removed only if that shrinks the bounding sphere's radius by at least this share; for low outliers, the
height."""
MAX_LOW_OUTLIER_SHARE = 0.001
"""Largest share of all points that are removed as low outliers."""
MIN_VISIBLE_DISC_SHARE = 0.02
"""Share of the frame's disc: if all clusters' spheres together cover less, the clusters are specks."""
MAX_SCATTERED_SHARE = 0.25
"""Largest share of the points in small clusters for these clusters to be ignored in the test for specks."""
SPECK_POINT_SHARE = 0.7
"""Smallest share of the points that specks hold."""
MAX_SPECK_CELLS = 150
"""Largest number of cells of a coarse grid that specks occupy."""
MAX_FAR_ROUNDS = 8
"""Largest number of rounds in which far clusters are removed: each leaves a cloud at most a tenth as wide."""


def outlier_sample(points: np.ndarray) -> np.ndarray:
    """A uniform sample of at most `MAX_SAMPLE` of points (N, 3); it does not depend on their order."""
    return subsample_uniform(points, MAX_SAMPLE)


def remove_outliers(points: np.ndarray) -> tuple[np.ndarray, int]:
    """Finite points (N, 3) without outliers, (M, 3); and how many were removed because their cluster was too far away.

    Small clusters are removed first, then clusters so far away that the frame would show only specks, then isolated
    points.
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

    Outliers are clusters of under 1 % of the points, separated from the rest by at least one cell of a coarse grid.
    They are removed only if that shrinks the bounding sphere's radius by over 10 %, and at most 2 % of all points are.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < MIN_POINTS_TO_CLIP:
        return kept
    for _ in range(4):  # an outlier very far away makes the first grid too coarse for the nearer ones
        rows = np.flatnonzero(kept)
        budget = int(MAX_OUTLIER_SHARE * len(points)) - (len(points) - len(rows))
        outliers = _outlier_cluster_mask(points[rows], int(MAX_OUTLIER_CLUSTER_SHARE * len(points)), budget)
        if not outliers.any():
            break
        kept[rows[outliers]] = False
    return kept


def visible_cluster_mask(points: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3): False for clusters so far from the largest one that all would be specks.

    Clusters far from each other are specks in a picture of all of them. Then the one with the most points is kept, or
    the widest of several such ones, with all that is near enough to stay visible together with it.
    """
    kept = np.ones(len(points), dtype=bool)
    if len(points) < MIN_SURFACE_POINTS:
        return kept
    for _ in range(MAX_FAR_ROUNDS):
        rows = np.flatnonzero(kept)
        largest = _largest_speck_mask(points[rows])
        if largest is None:
            break
        kept[rows[~largest]] = False
    return kept


def _largest_speck_mask(points: np.ndarray) -> np.ndarray | None:
    """Mask (N,) of the largest cluster of points (N, 3) if all clusters together would be specks; else None."""
    if _fills_its_box(points):
        return None
    cluster = _cluster_indices(points)
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


def _fills_its_box(points: np.ndarray) -> bool:
    """Whether points (N, 3) fill more of their bounding box than specks could; faster than computing clusters."""
    low, high = bounding_box(points)
    step = max(float((high - low).max()), MIN_SPAN) / 24
    some = points[:: -(-len(points) // MAX_SAMPLE)]  # a sample in any order occupies no more cells than all points
    place = ((some - low) / step).astype(np.int64)
    count = np.bincount((place[:, 0] * 25 + place[:, 1]) * 25 + place[:, 2])
    count = count[count > 0]
    if len(count) <= MAX_SPECK_CELLS:
        return False
    return bool(np.partition(count, -MAX_SPECK_CELLS)[-MAX_SPECK_CELLS:].sum() < SPECK_POINT_SHARE * len(some))


def above_low_outliers_mask(points: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Mask (N,) bool of finite points (N, 3) and their heights (N,): False for those that would put the floor too low.

    The floor touches the lowest point, so above a few low outliers, as lidar has, the object would hover. They are
    removed if they are small clusters with less than 0.1 % of all points, and the height shrinks by over 10 %.
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
    cluster = _cluster_indices(points)
    small = (np.bincount(cluster) <= max_count)[cluster[lowest]]
    count = len(lowest) if small.all() else int(small.argmin())  # all below the first one that is no outlier
    if count <= max_count and rise[count] >= MIN_SHRINKAGE * np.ptp(height):
        kept[lowest[:count]] = False
    return kept


def _outlier_cluster_mask(points: np.ndarray, largest: int, budget: int) -> np.ndarray:
    """Mask (N,) of the points in small clusters outside the sphere of the others, if that sphere is clearly smaller.

    Small clusters have up to `largest` points; the farthest ones are taken first, up to `budget` points in all.
    """
    none = np.zeros(len(points), dtype=bool)
    cluster = _cluster_indices(points)
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
    rest_sample = outlier_sample(points[~outliers])
    rest = bounding_sphere(rest_sample)
    whole = bounding_sphere(np.vstack([rest_sample, points[outliers]])) if outliers.any() else rest
    if rest.radius > (1 - MIN_SHRINKAGE) * whole.radius:
        return none
    outside = np.sqrt(((points - rest.centre) ** 2).sum(1)) > 1.02 * rest.radius
    return outliers & outside & ~_adjacent_part_mask(points, cluster, taken, sizes > largest)


def _adjacent_part_mask(points: np.ndarray, cluster: np.ndarray, taken: np.ndarray, large: np.ndarray) -> np.ndarray:
    """Mask (N,) of the points in `taken` clusters that are as near to a `large` one as its points are to each other.

    Where one part of an object is scanned far more densely, the cells are too small for the rest and separate it.
    """
    adjacent: list[int] = []
    clusters = np.flatnonzero(taken)
    if len(clusters) > MAX_PART_CLUSTERS:
        clusters = clusters[:0]
    body = subsample_uniform(points[large[cluster]], len(points))  # an order that does not depend on the file's
    places = np.floor((body - body.min(axis=0)) * (BODY_CELLS / max(float(np.ptp(body, axis=0).max()), MIN_SPAN)))
    one_per_cell = body[np.unique(places @ [1, BODY_CELLS + 1, (BODY_CELLS + 1) ** 2], return_index=True)[1]]
    for index in clusters:
        own = points[cluster == index]
        nearest_first = np.argsort(((own - body.mean(0)) ** 2).sum(1), kind="stable")
        own = own[nearest_first[:POINTS_PER_PART]]
        away = np.sqrt(((own[:, None] - one_per_cell) ** 2).sum(-1))
        nearest = one_per_cell[away.min(axis=0).argmin()]
        around = np.partition(((body - nearest) ** 2).sum(1), min(SPACING_NEIGHBORS, len(body) - 1))
        spacing = np.sqrt(np.pi * around[min(SPACING_NEIGHBORS, len(body) - 1)] / SPACING_NEIGHBORS)
        if away.min() < MAX_PART_GAP_SPACINGS * spacing:
            adjacent.append(int(index))
    return np.isin(cluster, adjacent)


def _cluster_indices(points: np.ndarray) -> np.ndarray:
    """Cluster index (N,) of each point: a cluster is the points in touching cells of a coarse grid.

    The side of a cell is a 24th of the widest side, or more in a sparse cloud, so that occupied cells hold at least
    four points on average.
    """
    low, high = bounding_box(points)
    span = max(float((high - low).max()), MIN_SPAN)
    for cells in (24, 16, 12, 8, 6):
        side = cells + 2  # an empty border, so that no neighbour wraps around
        key = _cell_keys(points, low, cells / span * (1 - 1e-9), side)
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
    number = np.zeros(side**3, dtype=np.int64)
    number[taken] = np.unique(label[taken], return_inverse=True)[1]
    indices: np.ndarray = number[key]
    return indices


def _cell_keys(points: np.ndarray, low: np.ndarray, scale: float, side: int) -> np.ndarray:
    """The cell (N,) int32 of each of points (N, 3) in a grid of `side` cells along each axis, the first empty."""
    keys = np.empty(len(points), np.int32)
    for start in range(0, len(points), CHUNK_POINTS):
        place = ((points[start : start + CHUNK_POINTS] - low) * scale).astype(np.int32)
        keys[start : start + CHUNK_POINTS] = ((place[:, 0] + 1) * side + place[:, 1] + 1) * side + place[:, 2] + 1
    return keys
