"""Small valid scans in binary formats, and all of them together: suffix -> functions of `rng` that give files."""

from __future__ import annotations

import base64
import io
import json
import struct
import tempfile
import zipfile
from collections.abc import Callable
from datetime import date
from functools import partial
from pathlib import Path

import laspy
import numpy as np
from made_texts import TEXTS, Files, colors, points, rows, wide
from reader_files import e57, las, ply

Maker = Callable[[np.random.Generator], "bytes | Files"]

SPLAT = [*"xyz", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", *(f"scale_{i}" for i in range(3)),
         *(f"rot_{i}" for i in range(4))]  # fmt: skip


def written(write: Callable[[Path], object], suffix: str) -> bytes:
    """The bytes of a file that a function writes to the path it is given."""
    with tempfile.TemporaryDirectory(prefix="z2p-fuzz-") as folder:
        write(path := Path(folder) / f"scan{suffix}")
        return path.read_bytes()


def _ply(rng: np.random.Generator) -> bytes:
    encoding = str(rng.choice(["ascii", "binary_little_endian", "binary_big_endian"]))
    kind = "double" if rng.random() < 0.5 else "float"
    faces = "element face 0\nproperty list uchar int vertex_indices\n" if rng.random() < 0.5 else ""
    return ply(points(rng), encoding, kind, extra=faces)


def _ply_with_colors(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    table = np.zeros(len(cloud), [("xyz", "<f4", 3), ("rgb", "u1", 3), ("n", "<i2")])
    table["xyz"], table["rgb"] = cloud, colors(rng, len(cloud))
    axes = "XYZ" if rng.random() < 0.2 else "xyz"
    names = "".join(f"property float {axis}\n" for axis in axes) + "".join(
        f"property uchar {c}\n" for c in ("red", "green", "blue")
    )
    head = f"ply\nformat binary_little_endian 1.0\nobj_info made\nelement vertex {len(cloud)}\n{names}"
    return f"{head}property short n\nend_header\n".encode() + table.tobytes()


def _ply_with_lists(rng: np.random.Generator) -> bytes:
    """Lists before the vertices, or among them."""
    cloud, ascii_ = points(rng), rng.random() < 0.3
    before = rng.random() < 0.5
    head = "ply\nformat " + ("ascii" if ascii_ else "binary_little_endian") + " 1.0\n"
    faces = "element face 2\nproperty list uchar int vertex_indices\n"
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    vertex = f"element vertex {len(cloud)}\n{axes}" + ("" if before else "property list uchar uchar tags\n")
    blob = (head + (faces + vertex if before else vertex + faces) + "end_header\n").encode()
    if ascii_:
        tags = ["" if before else " 2 7 8"] * len(cloud)
        body = "".join(f"{x:.6g} {y:.6g} {z:.6g}{tag}\n" for (x, y, z), tag in zip(cloud, tags, strict=True))
        polygons = "3 0 1 2\n4 0 1 2 1\n"
        return blob + (polygons + body if before else body + polygons).encode()
    counts = rng.integers(0, 4, len(cloud))
    tags_ = [b"" if before else bytes([count]) + bytes(count) for count in counts]
    packed = b"".join(row.astype("<f4").tobytes() + tag for row, tag in zip(cloud, tags_, strict=True))
    polygons_ = struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 1)
    return blob + (polygons_ + packed if before else packed + polygons_)


def _ply_splats(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    table = rng.normal(size=(len(cloud), len(SPLAT)))
    table[:, :3] = cloud
    names = "".join(f"property float {name}\n" for name in SPLAT)
    return (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(cloud)}\n{names}end_header\n".encode()
        + table.astype("<f4").tobytes()
    )


def _ply_packed_splats(rng: np.random.Generator) -> bytes:
    """As SuperSplat packs them: boxes of up to 256 splats, and four words a splat."""
    count = int(rng.choice([5, 40, 300]))
    bounds = [f"{end}_{axis}" for end in ("min", "max") for axis in "xyz"]
    bounds += [f"{end}_scale_{axis}" for end in ("min", "max") for axis in "xyz"]
    chunks = -(-count // 256)
    box = np.tile(np.repeat([-1.0, 1.0, -6.0, -2.0], 3), (chunks, 1)).astype("<f4")
    words = rng.integers(0, 2**32, (count, 4), dtype=np.uint64).astype("<u4")
    head = f"ply\nformat binary_little_endian 1.0\nelement chunk {chunks}\n" + "".join(
        f"property float {name}\n" for name in bounds
    )
    head += f"element vertex {count}\n" + "".join(
        f"property uint packed_{name}\n" for name in ("position", "rotation", "scale", "color")
    )
    return f"{head}end_header\n".encode() + box.tobytes() + words.tobytes()


def _pcd(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    data = str(rng.choice(["ascii", "binary", "binary_compressed"]))
    names, kinds = "x y z intensity", [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4")]
    names = names.upper() if rng.random() < 0.2 else names
    table = np.zeros(len(cloud), kinds)
    for axis, column in zip("xyz", cloud.T, strict=True):
        table[axis] = column
    height = 2 if len(cloud) % 2 == 0 and rng.random() < 0.3 else 1
    count = "" if rng.random() < 0.2 else "COUNT 1 1 1 1\n"
    head = (f"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS {names}\nSIZE 4 4 4 4\nTYPE F F F F\n"
            f"{count}WIDTH {len(cloud) // height}\nHEIGHT {height}\nVIEWPOINT 0 0 {rng.choice([0, 3])} 1 0 0 0\n"
            f"POINTS {len(cloud)}\nDATA {data}\n").encode()  # fmt: skip
    if data == "ascii":
        return head + rows(np.column_stack([table[name] for name in table.dtype.names])).encode()
    if data == "binary":
        return head + table.tobytes()
    import lzf

    columns = b"".join(table[name].tobytes() for name in table.dtype.names)
    packed = lzf.compress(columns) or b""
    return head + struct.pack("<II", len(packed), len(columns)) + packed


def _pcd_with_empty_field(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    head = (f"VERSION 0.7\nFIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U U\nCOUNT 1 1 1 0 1\nWIDTH {len(cloud)}\n"
            f"HEIGHT 1\nPOINTS {len(cloud)}\nDATA binary\n").encode()  # fmt: skip
    return head + b"".join(row.astype("<f4").tobytes() + b"\1\2\3\0" for row in cloud)


def _las(rng: np.random.Generator, suffix: str) -> bytes:
    def write(path: Path) -> None:
        if rng.random() < 0.3:
            return las(path, cloud := points(rng), tuple(np.floor(cloud.mean(0))))
        modern = rng.random() < 0.5
        header = laspy.LasHeader(
            point_format=int(rng.choice([6, 7, 8] if modern else [0, 1, 2, 3])), version="1.4" if modern else "1.2"
        )
        header.creation_date = date(2020, 2, 2)
        cloud = points(rng)
        header.scales, header.offsets = np.full(3, 0.001), np.floor(cloud.mean(0))
        if rng.random() < 0.3:
            header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "made", b"GEOGCS[]\0"))
            header.add_extra_dim(laspy.ExtraBytesParams("height", "f4"))
        content = laspy.LasData(header)
        content.x, content.y, content.z = cloud.T
        content.classification = rng.choice([1, 2, 7, 18] if modern else [1, 2, 7], len(cloud))
        content.write(path)

    return written(write, suffix)


def _npy(array: np.ndarray) -> bytes:
    np.save(file := io.BytesIO(), array, allow_pickle=True)
    return file.getvalue()


def _array(rng: np.random.Generator) -> np.ndarray:
    cloud = points(rng)
    match int(rng.integers(9)):
        case 0:
            return cloud
        case 1:
            return np.asfortranarray(cloud.astype("<f4"))
        case 2:
            return (cloud * 100).astype(rng.choice(["<i4", ">i2", "<f2", ">f8", "|i1", "<u2"]))
        case 3:
            return rng.normal(size=(int(rng.integers(1, 4)), 20, 3)).astype("<f4")
        case 4:
            return np.hstack([cloud, colors(rng, len(cloud))])
        case 5:
            return rng.normal(size=(8, 12, 3)) * [1, 1, 0.1] + [0, 0, 2]
        case 6:
            table = np.zeros(len(cloud), [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("i", "u1")])
            for axis, column in zip("xyz", cloud.T, strict=True):
                table[axis] = column
            return table
        case 7:
            return rng.normal(size=(6, 7))
        case _:
            return np.array([{"x": 1}, None], dtype=object)


def npz(rng: np.random.Generator, odd: Callable[[bytes], bytes] = bytes) -> bytes:
    """An archive with right checksums, whatever `odd` makes of the arrays in it."""
    cloud = points(rng)
    named = [{"points": cloud}, {"xyz": cloud.astype("<f4"), "color": colors(rng, len(cloud))},
             dict(zip("xyz", cloud.T, strict=True)), {"a": cloud, "b": np.eye(4)},
             {"vertices": cloud, "faces": np.arange(6).reshape(2, 3)}, {"points": _array(rng)},
             {"depth": rng.normal(size=(5, 6))}][rng.integers(7)]  # fmt: skip
    packing = zipfile.ZIP_STORED if rng.random() < 0.5 else zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(file := io.BytesIO(), "w") as archive:
        for name, array in named.items():
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), odd(_npy(array)), packing)
    return file.getvalue()


def _stl(rng: np.random.Generator) -> bytes:
    corners = points(rng, 12).reshape(4, 3, 3)
    facets = b"".join(bytes(12) + corner.astype("<f4").tobytes() + bytes(2) for corner in corners)
    return b"made".ljust(80, b"\0") + struct.pack("<I", len(corners)) + facets


def _off(rng: np.random.Generator) -> bytes:
    cloud = points(rng)
    return (
        b"OFF BINARY\n"
        + struct.pack(">3i", len(cloud), 1, 0)
        + cloud.astype(">f4").tobytes()
        + struct.pack(">5i", 3, 0, 1, 2, 0)
    )


def gltf_tree(rng: np.random.Generator) -> tuple[dict[str, object], bytes]:
    """The JSON and the binary part of a small scene."""
    cloud, whole = points(rng, 12), rng.random() < 0.3
    values = (rng.integers(-32767, 32768, (12, 3)).astype("<i2") if whole else cloud.astype("<f4")).tobytes()
    accessor = {"bufferView": 0, "componentType": 5122 if whole else 5126, "count": 12, "type": "VEC3",
                "normalized": whole, "min": [-1, -1, -1], "max": [1, 1, 1]}  # fmt: skip
    indices = np.arange(12, dtype="<u2").tobytes()
    primitive = {"attributes": {"POSITION": 0}, "mode": int(rng.choice([0, 1, 4, 5, 6]))}
    if rng.random() < 0.5:
        primitive["indices"] = 1
    tree: dict[str, object] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "children": [1], "translation": [1, 0, 0]},
                  {"mesh": 0, "rotation": [0, 0, 0, 1], "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": [accessor, {"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(values)},
                        {"buffer": 0, "byteOffset": len(values), "byteLength": len(indices)}],
        "buffers": [{"byteLength": len(values) + len(indices)}],
    }  # fmt: skip
    return tree, values + indices


def glb(text: str, binary: bytes) -> bytes:
    """A GLB file of a JSON text and a binary chunk."""
    chunks = b""
    for part, kind, fill in ((text.encode(errors="surrogatepass"), b"JSON", b" "), (binary, b"BIN\0", b"\0")):
        part += fill * (-len(part) % 4)
        chunks += struct.pack("<I4s", len(part), kind) + part
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def gltf(tree: dict[str, object], text: str, binary: bytes, rng: np.random.Generator) -> Files:
    """A glTF file, whose numbers are in itself or in a file beside it."""
    uri = (
        "scan.bin"
        if rng.random() < 0.5
        else "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
    )
    text = text.replace('"buffers": [{', f'"buffers": [{{"uri": "{uri}", ', 1)
    return {"scan.gltf": text.encode(errors="surrogatepass"), "scan.bin": binary}


def _glb(rng: np.random.Generator) -> bytes:
    tree, binary = gltf_tree(rng)
    return glb(json.dumps(tree), binary)


def _gltf(rng: np.random.Generator) -> Files:
    tree, binary = gltf_tree(rng)
    return gltf(tree, json.dumps(tree), binary, rng)


def _e57(rng: np.random.Generator) -> bytes:
    return written(lambda path: e57(path, *(points(rng) for _ in range(int(rng.integers(1, 3))))), ".e57")


def _h5(rng: np.random.Generator) -> bytes:
    """As ModelNet40, ScanObjectNN and PCN keep their clouds, and others theirs."""
    import h5py

    batch = rng.normal(size=(2, 30, 3)).astype("<f4")
    trees = [{"data": batch, "label": np.zeros((2, 1), "u1")}, {"data": batch[0]},
             {"points": batch[0], "color": batch[0]}, {"incomplete_pcds": batch, "complete_pcds": batch},
             {"a/b/xyz": batch[0], "a/n": np.arange(3)},
             dict(zip("xyz", batch[0].T, strict=True)), {"data": batch, "mask": np.zeros((2, 30))}]  # fmt: skip

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for name, array in trees[rng.integers(len(trees))].items():
                packed = {"compression": "gzip"} if array.ndim and rng.random() < 0.4 else {}
                file.create_dataset(name, data=array, **packed)

    return written(write, ".h5")


def _h5_odd(rng: np.random.Generator) -> bytes:
    """A sound HDF5 file that holds something else than a cloud under the usual names."""
    import h5py

    odd = [np.array([b"a", b"b"]), np.zeros((0, 3)), np.full((5, 3), np.nan), np.zeros((4, 3), "<c8"),
           np.zeros((2, 2, 2, 3)), np.zeros(9, [("x", "<f4"), ("y", "<f4"), ("z", "S3")]), np.arange(12),
           np.float64(3), np.zeros((3, 4), "?"),
           np.zeros((10, 3), ">f8"), np.zeros((10, 3), "<f2")]  # fmt: skip
    name = str(rng.choice(["data", "points", "xyz", "pcd", "complete_pcds", "x"]))

    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            match int(rng.integers(6)):
                case 0:
                    file[name] = h5py.SoftLink(f"/{name}")
                case 1:
                    file[name] = h5py.ExternalLink("nowhere.h5", "/data")
                case 2:
                    file.create_dataset(name, (2**40, 3), "<f4", chunks=(1000, 3))
                case 3:
                    file.create_dataset(name, (10, 3), "<f4", external=[("elsewhere.raw", 0, 120)])
                case 4:
                    file.create_group(name)["data"] = odd[rng.integers(len(odd))]
                case _:
                    file[name] = odd[rng.integers(len(odd))]

    return written(write, ".h5")


def _vtp(rng: np.random.Generator, kind: str) -> bytes:
    """A ParaView file with its numbers in base64 or behind an underscore."""
    cloud = points(rng).astype("<f4")
    raw = struct.pack("<I", cloud.nbytes) + cloud.tobytes()
    inline = rng.random() < 0.5
    array = (
        f'format="binary">{base64.b64encode(raw).decode()}</DataArray>' if inline else 'format="appended" offset="0"/>'
    )
    end = b"" if inline else b'<AppendedData encoding="raw">\n_' + raw + b"\n</AppendedData>\n"
    return (f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="0.1" byte_order="LittleEndian" '
            f'header_type="UInt32">\n<{kind}>\n<Piece NumberOfPoints="{len(cloud)}" NumberOfCells="0">\n<Points>\n'
            f'<DataArray type="Float32" NumberOfComponents="3" '
            f"{array}\n</Points>\n</Piece>\n</{kind}>\n").encode() + end + b"</VTKFile>\n"  # fmt: skip


def _colmap(rng: np.random.Generator) -> Files:
    cloud = points(rng)
    blob = struct.pack("<Q", len(cloud))
    for index, place in enumerate(cloud):
        track = int(rng.integers(4))
        blob += struct.pack("<Q3d3BdQ", index, *place, 1, 2, 3, 0.5, track) + bytes(8 * track)
    image = struct.pack("<I7dI", 1, 1, 0, 0, 0, 0.1, 0.2, 3, 1) + b"a.jpg\0" + struct.pack("<Q2dQ", 1, 1, 2, 2**64 - 1)
    camera = struct.pack("<QIiQQ4d", 1, 1, 1, 640, 480, 500, 500, 320, 240)
    return {"points3D.bin": blob, "images.bin": struct.pack("<Q", 1) + image, "cameras.bin": camera}


def _sweep(rng: np.random.Generator, width: int) -> Files:
    return {"scan.pcd.bin" if width == 5 else "scan.bin": wide(rng, width - 3).astype("<f4").tobytes()}


def _unread(magic: bytes) -> Maker:
    """What begins like a format that nobody reads here."""
    return lambda rng: magic + rng.bytes(300)


def _copc(rng: np.random.Generator) -> Files:
    """A LAZ file under the name of a cloud-optimised one."""
    return {"scan.copc.laz": _las(rng, ".laz")}


MADE: dict[str, tuple[Maker, ...]] = {
    **{suffix: tuple(makers) for suffix, makers in TEXTS.items()},
    ".ply": (_ply, _ply_with_colors, _ply_with_lists, _ply_splats, _ply_packed_splats),
    ".pcd": (_pcd, _pcd, _pcd_with_empty_field),
    ".las": (partial(_las, suffix=".las"),),
    ".laz": (partial(_las, suffix=".laz"), _copc),
    ".npy": (lambda rng: _npy(_array(rng)),),
    ".npz": (npz,),
    ".stl": (*TEXTS[".stl"], _stl),
    ".off": (*TEXTS[".off"], _off),
    ".glb": (_glb,),
    ".gltf": (_gltf,),
    ".e57": (_e57,),
    ".h5": (_h5, _h5_odd),
    ".hdf5": (_h5,),
    ".bin": (partial(_sweep, width=4), partial(_sweep, width=5), partial(_sweep, width=6), _colmap, _unread(b"CCB2")),
    ".vtp": (*TEXTS[".vtp"], partial(_vtp, kind="PolyData")),
    ".vtu": (*TEXTS[".vtu"], partial(_vtp, kind="UnstructuredGrid")),
    ".splat": (lambda rng: rng.bytes(32 * 9),),
    ".spz": (_unread(b"\x1f\x8b"),),
    ".drc": (_unread(b"DRACO"),),
    ".bag": (_unread(b"#ROSBAG V2.0\n"),),
}  # fmt: skip
"""Suffix, lower-case with its dot -> what makes files of it, those of formats that nobody reads here among them."""


def made(suffix: str, rng: np.random.Generator) -> Files:
    """A valid file of that suffix, and what lies beside it."""
    given = MADE[suffix][rng.integers(len(MADE[suffix]))](rng)
    return {f"scan{suffix}": given} if isinstance(given, bytes) else given
