"""Small valid scans in text, of every flavour that people have: suffix -> functions of `rng` that give files."""

from __future__ import annotations

import numpy as np
from reader_files import ptx

Files = dict[str, bytes]
"""Name -> content; the first is the scan, the others lie beside it."""


def points(rng: np.random.Generator, count: int | None = None) -> np.ndarray:
    """A lumpy surface (N, 3) somewhere, of some size."""
    count = int(rng.choice([3, 5, 12, 40, 120])) if count is None else count
    ball = rng.normal(size=(count, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True) + 1e-9
    offset = rng.choice([0.0, 0.0, 10.0, 5e5]) * np.array([1.0, 9.0, 0.001])
    return ball * [1.0, 0.7, 1.3] * rng.choice([0.01, 1.0, 300.0]) + offset


def rows(table: np.ndarray, between: str = " ", end: str = "") -> str:
    return "".join(between.join(f"{number:.9g}" for number in row) + end + "\n" for row in table)


def colors(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(0, 256, (count, 3)).astype(float)


def wide(rng: np.random.Generator, more: int) -> np.ndarray:
    """Rows of x, y, z and so many whole numbers."""
    cloud = points(rng)
    return np.hstack([cloud, rng.integers(0, 256, (len(cloud), more)).astype(float)])


def _normals(rng: np.random.Generator) -> np.ndarray:
    return np.hstack([(cloud := points(rng)), cloud / (np.linalg.norm(cloud, axis=1, keepdims=True) + 1e-9)])


def _named(rng: np.random.Generator, line: str, between: str, more: int) -> bytes:
    return (line + "\n" + rows(wide(rng, more), between)).encode()


def _molecule(rng: np.random.Generator) -> bytes:
    cloud = points(rng, 12)
    atoms = "".join(f"C {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in cloud)
    return f"{len(cloud)}\nwater and more\n{atoms}".encode()


def _pts(rng: np.random.Generator) -> bytes:
    parts = [wide(rng, int(rng.choice([0, 1, 4]))) for _ in range(int(rng.integers(1, 4)))]
    parts = [part[:, : parts[0].shape[1]] for part in parts]
    return "".join(f"{len(part)}\n{rows(part)}" for part in parts).encode()


def _grid(rng: np.random.Generator) -> bytes:
    heights = rng.normal(size=(4, 5))
    return ("ncols 5\nnrows 4\nxllcorner 0\nyllcorner 0\ncellsize 1\nNODATA_value -9999\n" + rows(heights)).encode()


def _veloview(rng: np.random.Generator) -> bytes:
    line = '"Points_m_XYZ:0","Points_m_XYZ:1","Points_m_XYZ:2","X","Y","Z","intensity","laser_id","azimuth","timestamp"'
    cloud = points(rng)
    return (line + "\n" + rows(np.hstack([cloud, cloud, rng.integers(0, 99, (len(cloud), 4))]), ",")).encode()


def _colmap(rng: np.random.Generator) -> Files:
    lines = ["# 3D point list with one line of data per point:",
             "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)"]  # fmt: skip
    for index, (x, y, z) in enumerate(points(rng)):
        track = " ".join(f"{rng.integers(9)} {rng.integers(99)}" for _ in range(rng.integers(4)))
        lines.append(f"{index + 1} {x:.6g} {y:.6g} {z:.6g} 10 20 30 0.5 {track}".rstrip())
    images = b"# Image list\n1 1 0 0 0 0.1 0.2 3 1 a.jpg\n12.5 3 -1\n2 0.9 0.1 0.3 0 0.1 0.2 3 1 b.jpg\n\n"
    cameras = b"# Camera list\n1 PINHOLE 640 480 500 500 320 240\n"
    return {"points3D.txt": "\n".join(lines).encode() + b"\n", "images.txt": images, "cameras.txt": cameras}


def _stl(rng: np.random.Generator) -> bytes:
    solids = []
    for index in range(int(rng.integers(1, 3))):
        facets = ""
        for corners in points(rng, 12).reshape(4, 3, 3):
            lines = "".join(f"vertex {x:.6g} {y:.6g} {z:.6g}\n" for x, y, z in corners)
            facets += f"facet normal 0 0 1\nouter loop\n{lines}endloop\nendfacet\n"
        solids.append(f"solid part{index}\n{facets}endsolid part{index}\n")
    return "".join(solids).encode()


def _obj(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    lines = [f"v {x:.6g} {y:.6g} {z:.6g}{' 1 0 0' if rng.random() < 0.2 else ''}" for x, y, z in cloud]
    return (
        "# made\nmtllib a.mtl\no thing\n" + "\n".join(lines) + "\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1\nl 1 2 \\\n3\n"
    ).encode()


def _off(rng: np.random.Generator) -> bytes:
    cloud, kind = points(rng), str(rng.choice(["OFF", "OFF\n# note", "COFF", "NOFF", "STOFF", "4OFF", "", "CNOFF"]))
    width = {"COFF": 4, "NOFF": 3, "STOFF": 2, "4OFF": 1, "CNOFF": 7}.get(kind, 0)
    table = np.hstack([cloud, np.ones((len(cloud), width))])
    between = " " if rng.random() < 0.2 else "\n"
    return f"{kind}{between}{len(cloud)} 1 0\n{rows(table)}3 0 1 2\n".encode()


def _vtk(rng: np.random.Generator) -> bytes:
    cloud, kind = points(rng), str(rng.choice(["POLYDATA", "UNSTRUCTURED_GRID", "STRUCTURED_GRID"]))
    count = len(cloud)
    size = f"DIMENSIONS {count} 1 1\n" if kind == "STRUCTURED_GRID" else ""
    head = f"# vtk DataFile Version 3.0\nmade\n{{}}\nDATASET {kind}\n{size}POINTS {count} "
    cells = {"POLYDATA": f"VERTICES 1 {count + 1}\n{count} {' '.join(map(str, range(count)))}\n"}.get(kind, "")
    data = f"POINT_DATA {count}\nSCALARS height float 1\nLOOKUP_TABLE default\n{rows(cloud[:, 2:])}"
    if rng.random() < 0.5:
        return (head.format("ASCII") + f"float\n{rows(cloud)}{cells}{data}").encode()
    return (head.format("BINARY") + "double\n").encode() + cloud.astype(">f8").tobytes() + b"\n" + cells.encode()[:20]


def _xml(rng: np.random.Generator, kind: str) -> bytes:
    """A ParaView file, with its numbers written out."""
    cloud = points(rng)
    count = f'NumberOfPoints="{len(cloud)}" NumberOfCells="0" NumberOfVerts="0" NumberOfLines="0" NumberOfPolys="0"'
    return (f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian">\n<{kind}>\n'
            f'<Piece {count}>\n<Points>\n<DataArray type="Float64" NumberOfComponents="3" format="ascii">\n'
            f"{rows(cloud)}</DataArray>\n</Points>\n"
            f"<PointData>\n</PointData>\n</Piece>\n</{kind}>\n</VTKFile>\n").encode()  # fmt: skip


TEXTS = {
    ".xyz": (lambda rng: rows(points(rng)).encode(), lambda rng: rows(wide(rng, 3)).encode(), _molecule,
             lambda rng: rows(wide(rng, 4), ",").encode(), lambda rng: rows(points(rng), " \t").encode()),
    ".xyzn": (lambda rng: rows(_normals(rng)).encode(),),
    ".xyzrgb": (lambda rng: rows(wide(rng, 3)).encode(),),
    ".pts": (_pts, lambda rng: rows(wide(rng, 4)).encode()),
    ".txt": (lambda rng: rows(wide(rng, 4)).encode(), lambda rng: _named(rng, "//X Y Z R G B", " ", 3), _colmap,
             lambda rng: (f"{(cloud := wide(rng, 1)).shape[0]}\n" + rows(cloud)).encode(),
             lambda rng: rows(np.hstack([np.argwhere(np.ones((5, 8))), points(rng, 40)])).encode()),
    ".asc": (lambda rng: rows(points(rng), " ").encode(), _grid, lambda rng: _named(rng, "# x y z intensity", " ", 1)),
    ".tsv": (lambda rng: _named(rng, "x\ty\tz\tlabel", "\t", 1), lambda rng: _named(rng, "id\tx\ty\tz", "\t", 1)),
    ".csv": (lambda rng: _named(rng, "x,y,z,i", ",", 1), lambda rng: _named(rng, "id;x;y;z", ";", 1), _veloview,
             lambda rng: rows(points(rng), ";").replace(".", ",").encode(),
             lambda rng: ("x,y,z,label\n" + rows(points(rng), ",", ',"a, b"')).encode(),
             lambda rng: _named(rng, "Longitude,Latitude,Depth", ",", 0),
             lambda rng: rows(points(rng), ",").encode("utf-16")),
    ".ptx": (lambda rng: ptx(points(rng, 6), points(rng, 12)).encode(),
             lambda rng: ptx(points(rng, 9), matrix=rng.normal(size=(4, 4))).encode()),
    ".obj": (_obj,),
    ".off": (_off,),
    ".stl": (_stl,),
    ".vtk": (_vtk,),
    ".vtp": (lambda rng: _xml(rng, "PolyData"),),
    ".vtu": (lambda rng: _xml(rng, "UnstructuredGrid"),),
}  # fmt: skip
