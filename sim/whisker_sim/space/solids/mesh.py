"""Convex mesh from a file in the format STL (binary or ASCII) or OBJ."""

import functools
import math
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from whisker_sim.space.solids.base import Nearest, Oriented, Solid
from whisker_sim.space.solids.polyhedron import MOST_TRIANGLES, Polyhedron, checked_polyhedron
from whisker_sim.whisker import Array, Positive

_MOST_BYTES = 64 << 20
_STL_HEADER, _STL_TRIANGLE = 84, 50


class Mesh(Oriented, frozen=True, forbid_unknown_fields=True, tag="mesh", kw_only=True):
    """Convex mesh from an STL or OBJ file, relative to the scene's folder, whose unit is `unit_m` (1e-3 for millimetres)."""

    file: str
    unit_m: Positive = 1.0

    example: ClassVar[dict[str, Any]] = {"file": "octahedron.obj", "unit_m": 1e-3}

    def placed(self, folder: Path) -> Solid:
        """The polyhedron that the file contains; raises `ValueError` if it is not a closed convex mesh of a plausible size."""
        try:
            vertices_m, triangles = read_mesh(folder / self.file, self.unit_m)
        except OSError as error:
            raise ValueError(f"solid.file: expected a mesh, found {error.strerror}: '{self.file}'") from None
        except ValueError as error:
            raise ValueError(f"solid.file: '{self.file}': {error}") from None
        return Polyhedron(center_m=self.center_m, orientation=self.orientation, vertices_m=vertices_m, triangles=triangles)

    def local_closest(self, points_m: Array) -> Nearest:
        """Not defined without the content of the file (`placed`)."""
        raise NotImplementedError


Vertices = tuple[tuple[float, float, float], ...]
Triangles = tuple[tuple[int, int, int], ...]


def read_mesh(path: Path, unit_m: float) -> tuple[Vertices, Triangles]:
    """Vertices (m) and triangles of the closed convex mesh in an STL or OBJ file; raises `ValueError` or `OSError`."""
    status = path.stat()
    return _read(path, unit_m, status.st_size, status.st_mtime_ns)


@functools.lru_cache(maxsize=8)
def _read(path: Path, unit_m: float, size: int, _: int) -> tuple[Vertices, Triangles]:
    if size > _MOST_BYTES:
        raise ValueError(f"expected at most {_MOST_BYTES >> 20} MiB, found {size >> 20} MiB")
    content = path.read_bytes()
    readers = {".stl": _read_stl, ".obj": _read_obj}
    if path.suffix.lower() not in readers:
        raise ValueError(f"expected a name that ends in .stl or .obj, found '{path.suffix}'")
    vertices, triangles = readers[path.suffix.lower()](content)
    vertices_m, triangles = checked_polyhedron(unit_m * vertices, triangles)
    return tuple(map(tuple, vertices_m.tolist())), tuple(map(tuple, triangles.tolist()))


def _read_stl(content: bytes) -> tuple[Array, NDArray[np.intp]]:
    """Vertices (3 m, 3) and triangles (m, 3) of an STL file."""
    count = int.from_bytes(content[80:84], "little") if len(content) >= _STL_HEADER else -1
    if len(content) == _STL_HEADER + _STL_TRIANGLE * count:
        rows = np.frombuffer(
            content, dtype=np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")]), offset=84
        )
        vertices = rows["corners"].reshape(-1, 3).astype(float)
    elif content.lstrip().startswith(b"solid"):
        vertices = np.array(_ascii_vertices(content)).reshape(-1, 3)
    else:
        raise ValueError(f"expected an STL file, found {len(content)} bytes for {count} triangles")
    if len(vertices) % 3:
        raise ValueError(f"expected three vertices a triangle, found {len(vertices)} vertices")
    wrong = np.flatnonzero(~np.all(np.isfinite(vertices), axis=1))
    if len(wrong):
        raise ValueError(f"triangle {wrong[0] // 3 + 1}: expected finite coordinates, found {vertices[wrong[0]].tolist()}")
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _ascii_vertices(content: bytes) -> list[list[float]]:
    vertices = []
    for number, line in enumerate(content.splitlines(), 1):
        words = line.split()
        if words and words[0] == b"vertex":
            if len(words) != 4:
                raise ValueError(f"line {number}: expected three coordinates, found {len(words) - 1}")
            vertices.append([_number(word, number) for word in words[1:]])
            if len(vertices) > 3 * MOST_TRIANGLES:
                raise ValueError(f"expected at most {MOST_TRIANGLES} triangles, found more")
    return vertices


def _read_obj(content: bytes) -> tuple[Array, NDArray[np.intp]]:
    """Vertices (n, 3) and triangles (m, 3) of an OBJ file; polygons are divided into triangles."""
    vertices: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for number, line in enumerate(content.splitlines(), 1):
        words = line.split()
        if words and words[0] == b"v":
            if len(words) < 4:
                raise ValueError(f"line {number}: expected three coordinates, found {len(words) - 1}")
            vertices.append([_number(word, number) for word in words[1:4]])
        elif words and words[0] == b"f":
            corners = [_corner(word, len(vertices), number) for word in words[1:]]
            triangles += [(corners[0], a, b) for a, b in pairwise(corners[1:])]
            if len(triangles) > MOST_TRIANGLES:
                raise ValueError(f"expected at most {MOST_TRIANGLES} triangles, found more")
    if not vertices or not triangles:
        raise ValueError("expected vertices and faces, found none")
    return np.array(vertices), np.array(triangles)


def _corner(word: bytes, count: int, number: int) -> int:
    """Index from 0 of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative ones count from the last vertex."""
    try:
        index = int(word.split(b"/")[0])
    except ValueError:
        raise ValueError(f"line {number}: expected the number of a vertex, found '{word.decode(errors='replace')}'") from None
    index = index - 1 if index > 0 else count + index
    if not 0 <= index < count:
        raise ValueError(f"line {number}: expected one of {count} vertices, found '{word.decode(errors='replace')}'")
    return index


def _number(text: bytes, line: int) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"line {line}: expected a finite number, found '{text.decode(errors='replace')}'")
    return value
