"""Recognizes files that no reader takes, by suffix or first bytes, with advice on how to convert them."""

from __future__ import annotations

import re
import zlib
from pathlib import Path

from z2p_renderer.storage.files.printable_names import is_file, without_gz

_HEAD_BYTES = 4096
"""Bytes at the beginning of a file that are examined."""
_SPLATS_ADVICE = "convert them to PLY with SuperSplat, or with: splat-transform {name} {stem}.ply"
_SCANNER_ADVICE = "export the scans as E57 or LAS with {program}"
_MESH_ADVICE = "open it in {program}, and export it as PLY, OBJ or GLB"
_ARCHIVE_ADVICE = "unpack it first, and give z2p what is in it"
_PACKETS_ADVICE = "open it in VeloView or the maker's viewer, and save the frames as PCD, LAS or CSV"

UNREAD_CLOUDS: dict[str, tuple[str, str]] = {
    ".splat": ("holds packed Gaussian splats", _SPLATS_ADVICE),
    ".ksplat": ("holds packed Gaussian splats", _SPLATS_ADVICE),
    ".spz": ("holds packed Gaussian splats (SPZ)", _SPLATS_ADVICE),
    ".sog": ("holds packed Gaussian splats", _SPLATS_ADVICE),
    ".drc": ("holds points or a mesh packed by Draco", "unpack it with: draco_decoder -i {name} -o {stem}.ply"),
    ".bag": ("is a ROS bag", "write its clouds as PCD files with: rosrun pcl_ros bag_to_pcd {name} /the/topic folder"),
    ".mcap": ("is a ROS 2 recording", "play it, and write its clouds as PCD files with: ros2 run pcl_ros "
              "pointcloud_to_pcd --ros-args -r input:=/the/topic"),
    ".db3": ("is a ROS 2 recording", "play its folder with ros2 bag play, and write its clouds as PCD files with: ros2 "
             "run pcl_ros pointcloud_to_pcd --ros-args -r input:=/the/topic"),
    ".fls": ("is a FARO scan", _SCANNER_ADVICE.format(program="FARO SCENE")),
    ".fws": ("is a FARO workspace", _SCANNER_ADVICE.format(program="FARO SCENE")),
    ".rcp": ("is an Autodesk ReCap project", _SCANNER_ADVICE.format(program="ReCap Pro")),
    ".rcs": ("is an Autodesk ReCap scan", _SCANNER_ADVICE.format(program="ReCap Pro")),
    ".zfs": ("is a Zoller + Froehlich scan", _SCANNER_ADVICE.format(program="Z+F LaserControl")),
    ".lgs": ("is a Leica project", _SCANNER_ADVICE.format(program="Cyclone 3DR or Cyclone REGISTER 360")),
    ".lgsx": ("is a Leica project", _SCANNER_ADVICE.format(program="Cyclone 3DR or Cyclone REGISTER 360")),
    ".ptg": ("is a Leica scan", _SCANNER_ADVICE.format(program="Cyclone")),
    ".rdbx": ("is a RIEGL scan", _SCANNER_ADVICE.format(program="RiSCAN PRO")),
    ".rxp": ("is a RIEGL scan", _SCANNER_ADVICE.format(program="RiSCAN PRO")),
    ".cl3": ("is a Topcon scan", _SCANNER_ADVICE.format(program="Magnet Collage")),
    ".clr": ("is a Topcon scan", _SCANNER_ADVICE.format(program="Magnet Collage")),
    ".tzf": ("is a Trimble scan", _SCANNER_ADVICE.format(program="Trimble RealWorks")),
    ".pod": ("is a Pointools cloud", _SCANNER_ADVICE.format(program="Bentley Pointools")),
    ".pcap": ("is a lidar's recorded packets", _PACKETS_ADVICE),
    ".pcapng": ("is a lidar's recorded packets", _PACKETS_ADVICE),
    ".lvx": ("is a Livox recording", "open it in Livox Viewer, and save the frames as CSV or LAS"),
    ".lvx2": ("is a Livox recording", "open it in Livox Viewer 2, and save the frames as CSV or LAS"),
}  # fmt: skip
"""Suffix of an unsupported format of points -> its description, and advice on conversion."""
UNREAD_OTHERS: dict[str, tuple[str, str]] = {
    ".skp": ("is a SketchUp model", _MESH_ADVICE.format(program="SketchUp")),
    ".blend": ("is a Blender file", _MESH_ADVICE.format(program="Blender")),
    ".max": ("is a 3ds Max scene", _MESH_ADVICE.format(program="3ds Max")),
    ".c4d": ("is a Cinema 4D scene", _MESH_ADVICE.format(program="Cinema 4D")),
    ".ma": ("is a Maya scene", _MESH_ADVICE.format(program="Maya")),
    ".mb": ("is a Maya scene", _MESH_ADVICE.format(program="Maya")),
    **{suffix: ("is a USD scene", _MESH_ADVICE.format(program="Blender"))
       for suffix in (".usd", ".usda", ".usdc", ".usdz")},
    **{suffix: (f"is a mesh in the format {suffix[1:].upper()}", _MESH_ADVICE.format(program="Blender"))
       for suffix in (".fbx", ".dae", ".abc", ".3ds", ".x3d", ".wrl", ".3mf", ".lwo")},
    **{suffix: (f"is a solid in the format {suffix[1:].upper()}", _MESH_ADVICE.format(program="FreeCAD"))
       for suffix in (".step", ".stp", ".iges", ".igs", ".brep", ".fcstd", ".dwg", ".dxf", ".ifc", ".3dm")},
    **{suffix: ("is an archive", _ARCHIVE_ADVICE)
       for suffix in (".zip", ".7z", ".rar", ".tar", ".tgz", ".bz2", ".xz", ".zst")},
    **{suffix: ("holds heights in a grid, or a picture", "turn heights into points first, as in: gdal_translate "
                "-of XYZ {name} {stem}.xyz") for suffix in (".tif", ".tiff", ".dem", ".hgt", ".vrt")},
    **{suffix: ("is a spreadsheet", "save the sheet with the points as CSV") for suffix in (".xls", ".xlsx", ".ods")},
    ".mat": ("is a MATLAB file", "save the points as text with writematrix, or as .npy with scipy.io.loadmat and "
             "numpy.save"),
    ".parquet": ("is a table in the format Parquet", "save its columns x, y and z as CSV, with pandas for one"),
    ".feather": ("is a table in the format Feather", "save its columns x, y and z as CSV, with pandas for one"),
    **{suffix: ("is an index of other VTK files, or a grid", "open it in ParaView, and save its points as VTP or CSV")
       for suffix in (".pvtu", ".pvtp", ".pvd", ".vtm", ".vti", ".vts", ".vtr", ".vtkhdf")},
}  # fmt: skip
"""The same for formats that folders may hold beside scans: the advice is given only if such a file is named."""

_GIT_LFS_HEAD = b"version https://git-lfs.github.com/spec"
_ARCHIVE_HEADS = (
    (b"PK\x03\x04", "a ZIP archive"), (b"BZh", "packed by bzip2"), (b"\xfd7zXZ\0", "packed by xz"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd"), (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"), (b"Rar!", "a RAR archive"),
)  # fmt: skip
_ZIP_BASED_SUFFIXES = {".npz", ".usdz", ".xlsx", ".ods", ".3mf", ".sog", ".zip", ".fcstd"}
"""Suffixes of formats that are ZIP archives themselves."""
_READ_HEADS: tuple[tuple[bytes, str, tuple[str, ...]], ...] = (
    (rb"ply[ \t]*[\r\n]", "a PLY file", (".ply",)),
    (rb"# ?\.PCD|(#[^\n]*\n)*VERSION [^\n]*\r?\n(FIELDS|COLUMNS) ", "a PCD file", (".pcd",)),
    (rb"LASF", "a LAS file", (".las", ".laz")), (rb"ASTM-E57", "an E57 file", (".e57",)),
    (rb"glTF[\x01-\x02]\0\0\0", "a GLB file", (".glb",)), (rb"\x93NUMPY", "a numpy array", (".npy",)),
    (rb"\x89HDF\r\n\x1a\n", "an HDF5 file", (".h5", ".hdf5", ".hdf", ".he5", ".nc", ".nc4", ".mat", ".vtkhdf")),
    (rb"# vtk DataFile", "a VTK file", (".vtk",)),
    (rb"(<\?xml[^>]*>\s*)?<VTKFile[^>]*PolyData", "a VTP file", (".vtp",)),
    (rb"(<\?xml[^>]*>\s*)?<VTKFile[^>]*UnstructuredGrid", "a VTU file", (".vtu",)),
    (rb"(ST)?C?N?4?OFF[ \t]*\r?\n", "an OFF file", (".off",)),
)  # fmt: skip
"""Pattern of the first bytes -> description and suffixes of a supported format, the usual suffix first."""
_UNREAD_HEADS: tuple[tuple[bytes, str], ...] = (
    (rb"#ROSBAG V", ".bag"), (rb"\x89MCAP0\r\n", ".mcap"), (rb"SQLite format 3\0", ".db3"), (rb"DRACO", ".drc"),
    (rb"BLENDER", ".blend"), (rb"PXR-USDC|#usda ", ".usd"), (rb"NGSP", ".spz"), (rb"\xd0\xcf\x11\xe0", ".xls"),
    (rb"Kaydara FBX|; FBX ", ".fbx"), (rb"ISO-10303-21", ".step"), (rb"(II\*\0|MM\0\*)", ".tif"),
)  # fmt: skip
"""Pattern of the first bytes -> suffix of an unsupported format."""
_CLOUDCOMPARE_HEAD = re.compile(rb"CCB[0-9\0]")


def is_unread_cloud(path: Path) -> bool:
    """Whether a file's suffix is that of an unsupported format of points."""
    return path.suffix.lower() in UNREAD_CLOUDS


def advice_by_suffix(path: Path) -> str:
    """Description of a file by its suffix, with advice on conversion; empty if the suffix is not known."""
    inner = without_gz(path)
    if inner.suffix.lower() == ".tar":
        return f"is an archive, which z2p does not read; {_ARCHIVE_ADVICE}"
    kind_and_advice = _kind_and_advice(inner.suffix.lower())
    return _format_advice(*kind_and_advice, inner) if kind_and_advice else ""


def advice_of(path: Path) -> str:
    """The same by its suffix, or else by its content; empty if neither is known."""
    return advice_by_suffix(path) or advice_by_content(path, path.suffix.lower())


def advice_by_content(path: Path, suffix: str) -> str:
    """Advice on a file whose first bytes contradict its suffix, or that no reader takes; empty for other files.

    `suffix` is lower-case, with its dot, and the file is not gzip'd, or was unpacked.
    """
    if not is_file(path):  # opening a pipe would block; the reader reports it
        return ""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return ""  # the reader reports the error
    return _advice_by_head(head, path, suffix)


def _advice_by_head(head: bytes, path: Path, suffix: str) -> str:
    if advice := _advice_by_other_head(head, path, suffix):
        return advice
    if _CLOUDCOMPARE_HEAD.match(head):
        return "is a CloudCompare project (CCB), which z2p does not read; open it there, and save it as PLY or LAS"
    for pattern, name, suffixes in _READ_HEADS:
        if re.match(pattern, head):
            under = f"under a name that ends in {suffix}" if suffix else "under a name without suffix"
            return "" if suffix in suffixes else f"holds {name} {under}; rename it to {path.stem}{suffixes[0]}"
    for pattern, unread in _UNREAD_HEADS:
        if suffix != unread and re.match(pattern, head) and (kind_and_advice := _kind_and_advice(unread)):
            return _format_advice(*kind_and_advice, path)
    return ""


def _advice_by_other_head(head: bytes, path: Path, suffix: str) -> str:
    """Advice on archives, images, and files that failed downloads leave in place of a scan."""
    start = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    if head.startswith(_GIT_LFS_HEAD):
        return "is a Git LFS pointer, which stands for a file that was not fetched; fetch it with: git lfs pull"
    if re.match(rb"(<\?xml[^>]*>\s*)?(<!--.*?-->\s*)?<(!doctype html|html|head|body)\b", start, re.DOTALL):
        return "is a web page (HTML), not a scan: the download has failed or wants a login; download it again"
    if re.match(rb"(<\?xml[^>]*>\s*)?<error>", start):
        return "is a server's error message (XML), not a scan; download it again"
    if head.startswith(b"\x1f\x8b") and path.suffix.lower() not in (".gz", ".spz", ".tgz"):
        try:
            inside = zlib.decompressobj(31).decompress(head, 4)
        except zlib.error:
            return ""
        if inside == b"NGSP":
            return _format_advice(*UNREAD_CLOUDS[".spz"], path)
        return f"is packed by gzip; rename it to {path.name}.gz"
    if head.startswith((b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"RIFF")) or head.startswith(b"%PDF-"):
        return "is a picture, a film or a PDF, not a scan; check which file is meant"
    if head.startswith(b"PK\x03\x04") and suffix == ".csv":
        return _format_advice(*UNREAD_OTHERS[".xlsx"], path)
    for magic, name in _ARCHIVE_HEADS:
        if head.startswith(magic) and not (magic.startswith(b"PK") and suffix in _ZIP_BASED_SUFFIXES):
            return f"is {name}; {_ARCHIVE_ADVICE}"
    return ""


def _kind_and_advice(suffix: str) -> tuple[str, str] | None:
    return UNREAD_CLOUDS.get(suffix) or UNREAD_OTHERS.get(suffix)


def _format_advice(kind: str, advice: str, path: Path) -> str:
    return f"{kind}, which z2p does not read; {advice.format(name=path.name, stem=path.stem)}"
