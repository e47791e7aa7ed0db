"""Reader of COLLADA files (.dae).

A part is a geometry placed by a node; a geometry that is placed several times with the same materials is one mesh with
several placements. The primitives of a geometry are concatenated in the file's order, their polygons split into
triangles: face numbers count those triangles. Skins and morphs are read in the pose that the file is saved in;
animations are left aside.

Opacity is what <transparent> and <transparency> make of it in the mode of `opaque`, by colours or by a texture; an
opacity of exactly 0 is read as 1, since exporters that mean opaque by it are common, and nobody exports what cannot be
seen. The alpha of <diffuse> says nothing, but that of its texture counts where <transparent> names no other.

Read here and not by trimesh or pycollada, which hold positions and matrices in float32, replace NaN by 0, refuse a
whole geometry for one index out of range, and copy instances.

Based on: COLLADA, Digital Asset Schema Release 1.4.1; Release 1.5.0 for the modes A_ZERO and RGB_ONE.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from jobs.importing.formats.dae_controllers import Pose, Poses
from jobs.importing.formats.dae_transforms import local_matrix, placed
from jobs.importing.formats.format import Format
from jobs.importing.reading.blended import Alphas
from jobs.importing.reading.content import Content, whole
from jobs.importing.reading.defects import Defect, Tally
from jobs.importing.reading.faces.corners import strips, unify
from jobs.importing.reading.faces.polygons import triangulate
from jobs.importing.reading.needs import TEXT, image_needs
from jobs.importing.reading.resources import Resources
from jobs.importing.reading.source_scene import SourceMesh, SourceNode, SourceScene
from jobs.importing.reading.text.numbers import floats_of
from jobs.importing.reading.vertex_colours import DEFAULT_COLOUR, Texture, tint, to_colours
from storage.base.errors import ModelError
from storage.meshes.placement import IDENTITY

Element = ElementTree.Element

#: Nodes in all, each counted as often as it is instanced: files that multiply themselves stop here.
_MOST_NODES = 5_000_000

_POLYGONS = ("triangles", "polylist", "polygons", "tristrips", "trifans")
_NOT_TRIANGLES = ("lines", "linestrips", "points")
_SHADERS = ("lambert", "phong", "blinn", "constant")


_IMAGE = re.compile(rb"<init_from>\s*(?:<ref>)?\s*([^<]+?)\s*<")


def read(file: Path, content: Content, resources: Resources) -> SourceScene:
    """Read a COLLADA file. Raises ModelError, or what the XML parser raises on damaged content."""
    data = whole(content).strip(b"\0 \t\r\n")
    if any("<!ENTITY".encode(encoding) in data for encoding in ("utf-8", "utf-16-le", "utf-16-be")):
        raise ModelError(f"{file}: declares XML entities, which no COLLADA file needs; export the model again")
    document = _Document(file, _parse(file, data), resources)
    meshes, nodes = document.placements()
    unit, up = document.frame()
    return SourceScene(file, meshes, nodes, unit, up, "y", document.tally)


def _sniff(content: Content) -> bool:
    head = content.part(0, 4096)
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        head = head.decode("utf-16", "ignore").encode()
    head = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    return head.startswith(b"<") and b"<COLLADA" in head


def _named_files(_file: Path, content: Content, _resources: Resources) -> Iterable[str]:
    return [unescape(name.decode("utf-8", "replace")) for name in _IMAGE.findall(whole(content))]


def _memory(file: Path, content: Content, resources: Resources) -> int:
    return TEXT * content.size + image_needs(_named_files(file, content, resources), resources)


def _parse(file: Path, content: bytes) -> Element:
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise ModelError(
            f"{file}: not whole as XML ({error}); the file is damaged or cut short, export it again"
        ) from None
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ModelError(f"{file}: XML, but not COLLADA (its root is {root.tag[:40]!r}); check its extension")
    return root


@dataclass(frozen=True, eq=False)
class _Surface:
    """A material."""

    colour: np.ndarray  # (4,) uint8
    texture: Texture | None
    opacity: Texture | None  # by its alpha
    missing: int  # textures that are named but not there


@dataclass(frozen=True, eq=False)
class _Input:
    """Where a primitive's numbers point."""

    semantic: str
    offset: int
    set: int
    values: np.ndarray  # (n, width)


@dataclass(frozen=True, eq=False)
class _Shown:
    """A geometry in the scene."""

    instance: Element  # with the materials that are bound
    geometry: Element | None  # None: it names none
    name: str  # of the node that bears it
    matrix: np.ndarray | None  # (3, 4) of the mesh, or of its pose; None: it cannot be read
    pose: Pose | None


@dataclass(eq=False)
class _Document:
    file: Path
    root: Element
    resources: Resources
    tally: Tally = field(default_factory=Tally)

    def __post_init__(self) -> None:
        self._ids = {element.get("id", ""): element for element in self.root.iter() if element.get("id")}
        self._sources: dict[str, np.ndarray] = {}
        self._surfaces: dict[str, _Surface | None] = {}
        self._textures: dict[str, Texture | None] = {}
        self._opacities: dict[tuple[str, str], Texture] = {}
        self._poses = Poses(self.root, self._named, self._source)

    def frame(self) -> tuple[float, str]:
        """Metres per unit and up axis; COLLADA's own defaults are metres and y."""
        unit, up = 1.0, "y"
        asset = self.root.find("asset")
        if asset is not None:
            element = asset.find("unit")
            value = floats_of(element.get("meter", "1")) if element is not None else np.ones(1)
            if len(value) == 1 and np.isfinite(value[0]) and value[0] > 0:
                unit = float(value[0])
            up = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}.get((asset.findtext("up_axis") or "").strip(), "y")
        return unit, up

    def placements(self) -> tuple[list[SourceMesh], list[SourceNode]]:
        """All meshes, and their placements in the scene, depth first."""
        meshes: list[SourceMesh] = []
        known: dict[tuple[str, str, tuple[tuple[str, str], ...]], int | None] = {}
        nodes = []
        for shown in self._instances():
            if shown.geometry is None:
                self.tally.add(Defect.BROKEN, shown.name)
                continue
            label = shown.geometry.get("name") or shown.geometry.get("id") or "geometry"
            name = f"{shown.name}/{label}" if shown.name else label
            if shown.matrix is None:
                self.tally.add(Defect.TRANSFORM, name)
                continue
            bound = {m.get("symbol", ""): m.get("target", "") for m in shown.instance.iter("instance_material")}
            posed = "" if shown.pose is None else shown.pose.key
            key = (shown.geometry.get("id", ""), posed, tuple(sorted(bound.items())))
            if key not in known:
                mesh = self._mesh(shown.geometry, label, bound, shown.pose)
                known[key] = None if mesh is None else len(meshes)
                if mesh is not None:
                    meshes.append(mesh)
            number = known[key]
            if number is not None:
                nodes.append(SourceNode(number, name, shown.matrix))
        return meshes, nodes

    def _named(self, url: str | None, *tags: str) -> Element | None:
        """The element of one of `tags` that a local URL names."""
        element = self._ids.get((url or "").removeprefix("#"))
        return element if element is not None and element.tag in tags else None

    def _instances(self) -> Iterator[_Shown]:
        """Everything in the scene, depth first."""
        instance = self.root.find("scene/instance_visual_scene")
        scene = self._named(instance.get("url"), "visual_scene") if instance is not None else None
        if scene is None:
            scene = self.root.find("library_visual_scenes/visual_scene")
        if scene is None:
            return
        locals_: dict[Element, np.ndarray | None] = {}
        entered: set[Element] = set()  # the nodes above
        stack: list[tuple[Element, np.ndarray | None, bool]] = [
            (node, IDENTITY, False) for node in reversed(scene.findall("node"))
        ]
        seen = 0
        while stack:
            node, parent, left = stack.pop()
            if left:
                entered.remove(node)
                continue
            name = node.get("name") or node.get("id") or ""
            seen += 1
            if seen > _MOST_NODES:
                raise ModelError(
                    f"{self.file}: more than {_MOST_NODES} nodes, as often as they are instanced; export it in parts"
                )
            if node in entered:
                raise ModelError(f"{self.file}: node {name!r} cannot contain itself; export the model again")
            if node not in locals_:
                locals_[node] = local_matrix(node)
            own = locals_[node]
            matrix = None if parent is None or own is None else placed(parent, own)
            for child in node.findall("instance_geometry"):
                yield _Shown(child, self._named(child.get("url"), "geometry"), name, matrix, None)
            for child in node.findall("instance_controller"):
                yield self._controlled(child, name, matrix)
            children = node.findall("node")
            for child in node.findall("instance_node"):
                target = self._named(child.get("url"), "node")
                if target is None:
                    self.tally.add(Defect.BROKEN, name)
                else:
                    children.append(target)
            if children:
                entered.add(node)
                stack.append((node, None, True))
                stack.extend((child, matrix, False) for child in reversed(children))

    def _controlled(self, instance: Element, name: str, matrix: np.ndarray | None) -> _Shown:
        """A geometry in the pose of its skin and morph; at rest where that cannot be made out."""
        geometry, pose = self._poses.geometry(instance), self._poses.pose(instance)
        if geometry is not None and pose is None:
            self.tally.add(Defect.UNSUPPORTED, name)
            matrix = None if matrix is None else placed(matrix, self._poses.bind_shape(instance))
        elif pose is not None and pose.matrices is not None:
            matrix = IDENTITY
        return _Shown(instance, geometry, name, matrix, pose)

    def _source(self, url: str | None) -> np.ndarray | None:
        """A source's values (count, width) float64."""
        element = self._named(url, "source")
        if element is None or url is None:
            return None
        if url not in self._sources:
            array = element.find("float_array")
            values = floats_of(array.text or "") if array is not None else np.empty(0)
            accessor = element.find("technique_common/accessor")
            stride, offset = 3, 0
            if accessor is not None:
                stride, offset = int(accessor.get("stride", "1")), int(accessor.get("offset", "0"))
            if not (1 <= stride <= 64 and offset >= 0):
                raise ModelError(f"{self.file}: source {url[:60]!r} has a stride of {stride}; export the model again")
            values = values[offset:]
            self._sources[url] = values[: len(values) // stride * stride].reshape(-1, stride)
        return self._sources[url]

    def _inputs(self, primitive: Element) -> list[_Input]:
        """A primitive's inputs, those of its vertices included."""
        found = []
        for element in primitive.findall("input"):
            offset, number = int(element.get("offset", "0")), int(element.get("set", "0"))
            vertices = self._named(element.get("source"), "vertices")
            inner = vertices.findall("input") if vertices is not None else [element]
            for entry in inner:
                values = self._source(entry.get("source"))
                if values is not None:
                    found.append(_Input(entry.get("semantic", ""), offset, number, values))
        return found

    def _mesh(self, geometry: Element, name: str, bound: dict[str, str], pose: Pose | None) -> SourceMesh | None:
        """A geometry with its materials, None if it has no triangles."""
        mesh = geometry.find("mesh")
        if mesh is None:
            self.tally.add(Defect.UNSUPPORTED, name)
            return None
        defects: dict[Defect, int] = {}
        pieces = []
        for primitive in mesh:
            if primitive.tag in _NOT_TRIANGLES:
                defects[Defect.NOT_TRIANGLES] = defects.get(Defect.NOT_TRIANGLES, 0) + 1
            elif primitive.tag in _POLYGONS:
                piece = self._piece(primitive, name, bound, pose, defects)
                if piece is not None:
                    pieces.append(piece)
        if not pieces:
            for defect, count in defects.items():
                self.tally.add(defect, name, count)
            return None
        starts = np.cumsum([0, *(len(piece.positions) for piece in pieces[:-1])]).tolist()
        return SourceMesh(
            name,
            np.concatenate([piece.positions for piece in pieces]),
            np.concatenate(
                [
                    np.where(piece.triangles >= 0, piece.triangles + start, -1)
                    for piece, start in zip(pieces, starts, strict=True)
                ]
            ),
            np.concatenate([np.zeros_like(p.positions) if p.normals is None else p.normals for p in pieces]),
            np.concatenate([p.colours for p in pieces if p.colours is not None]),
            defects,
        )

    def _piece(
        self, primitive: Element, name: str, bound: dict[str, str], pose: Pose | None, defects: dict[Defect, int]
    ) -> SourceMesh | None:
        """One primitive, with every colour set."""
        inputs = self._inputs(primitive)
        width = max((int(e.get("offset", "0")) for e in primitive.findall("input")), default=0) + 1
        position = next((i for i in inputs if i.semantic == "POSITION" and i.values.shape[1] >= 3), None)
        if position is None or width > 64:
            defects[Defect.BROKEN] = defects.get(Defect.BROKEN, 0) + 1
            return None
        numbers, triangles = _corners(primitive, width, position, defects)
        if not len(triangles):
            return None
        corners = numbers[triangles.reshape(-1)]

        def index(entry: _Input | None) -> np.ndarray:
            if entry is None:
                return np.full(len(corners), -1, np.int64)
            values = corners[:, entry.offset]
            return np.where((values >= 0) & (values < len(entry.values)), values, -1)

        sets = sorted((i for i in inputs if i.semantic == "TEXCOORD" and i.values.shape[1] >= 2), key=lambda i: i.set)
        normal = next((i for i in inputs if i.semantic == "NORMAL" and i.values.shape[1] == 3), None)
        paint = next((i for i in inputs if i.semantic == "COLOR" and i.values.shape[1] in (3, 4)), None)
        surface = self._surface(bound.get(primitive.get("material", ""), ""))
        if primitive.get("material") and surface is None:
            defects[Defect.NO_MATERIAL] = defects.get(Defect.NO_MATERIAL, 0) + 1
        if surface is not None and surface.missing:
            defects[Defect.NO_TEXTURE] = defects.get(Defect.NO_TEXTURE, 0) + surface.missing
        image, opacity = (surface.texture, surface.opacity) if surface is not None else (None, None)
        place = sets[0] if sets and (image is not None or opacity is not None) else None
        columns = [index(entry) for entry in (position, normal, paint, place)]
        kept, vertex = unify(np.stack(columns, axis=1))
        at, facing, painted, lying = (column[kept] for column in columns)
        faces = np.where(columns[0] >= 0, vertex, -1).reshape(-1, 3)
        piece = SourceMesh(name, _taken(position.values[:, :3], at), faces)
        if normal is not None:
            piece.normals = _taken(normal.values, facing)
        if pose is not None:
            pose.move(piece.positions, piece.normals, at)
            if pose.mirrors:
                piece.triangles = faces = faces[:, ::-1]
        colours = np.empty((len(kept), 4), np.uint8)
        colours[:] = DEFAULT_COLOUR if surface is None else surface.colour
        if paint is not None:
            values = _taken(paint.values, painted)
            bad = ~np.isfinite(values).all(axis=1)
            defects[Defect.COLOUR] = defects.get(Defect.COLOUR, 0) + int(bad.sum())
            good = ~bad & (painted >= 0)
            if values.shape[1] == 4 and not (values[good, 3] > 0).any():
                values = values[:, :3]  # an alpha of 0 everywhere says nothing
            thin = colours[:, 3].copy()
            colours[good] = to_colours(values[good])
            colours[:, 3] = tint(colours[:, 3], thin)
        alphas = Alphas()
        if place is not None:
            places = _taken(place.values[:, :2], lying)
            places[:, 1] = 1 - places[:, 1]
            inside, has = (faces >= 0).all(axis=1), lying >= 0
            if image is not None:
                sampled = image.sample(places, faces[inside])
                colours[has, :3] = tint(sampled[has, :3], colours[has, :3])
            if opacity is not None:
                alphas.take(inside & has[faces].all(axis=1), opacity.alpha, places, faces)
        piece.colours = colours
        alphas.blend(piece)
        for defect in [defect for defect, count in defects.items() if not count]:
            del defects[defect]
        return piece

    def _surface(self, target: str) -> _Surface | None:
        if target not in self._surfaces:
            material = self._named(target, "material")
            instance = material.find("instance_effect") if material is not None else None
            effect = self._named(instance.get("url"), "effect") if instance is not None else None
            self._surfaces[target] = None if effect is None else self._shade(effect)
        return self._surfaces[target]

    def _shade(self, effect: Element) -> _Surface:
        """An effect's diffuse colour or texture, and its opacity."""
        shader = next((e for e in effect.iter() if e.tag in _SHADERS), None)
        parameters = {e.get("sid", ""): e for e in effect.iter("newparam")}
        colour, image, missing = np.array([0.8, 0.8, 0.8, 1.0]), None, 0
        if shader is None:
            return _Surface(to_colours(colour[None])[0], None, None, 0)
        diffuse = shader.find("diffuse" if shader.tag != "constant" else "emission")
        if diffuse is not None:
            values = floats_of(diffuse.findtext("color") or "")
            sampler = diffuse.find("texture")
            if len(values) >= 3 and np.isfinite(values[:3]).all():
                colour[:3] = values[:3]
            if sampler is not None:
                colour[:] = 1
                image = self._image(sampler.get("texture", ""), parameters)[1]
                missing += image is None
        opacity = image
        colour[3] = _opacity(shader)
        sampler = shader.find("transparent/texture")
        if sampler is not None:
            path, cover = self._image(sampler.get("texture", ""), parameters)
            missing += cover is None
            opacity = image if cover is None else self._cover(path, cover, _mode(shader), _amount(shader))
        return _Surface(to_colours(colour[None])[0], image, opacity, missing)

    def _cover(self, path: str, image: Texture, mode: str, amount: float) -> Texture:
        """An image with the opacity as alpha that a <transparent> texture stands for."""
        key = (path, f"{mode} {amount!r}")
        if key not in self._opacities:
            pixels = image.pixels.copy()
            share = pixels[..., 3] / np.float64(255)
            if mode.startswith("RGB"):
                share = _luminance(*(pixels[..., k] / np.float64(255) for k in range(3)))
            alpha = 1 - share * amount if mode.endswith("ZERO") else share * amount
            pixels[..., 3] = np.rint(np.clip(alpha, 0, 1) * 255).astype(np.uint8)
            self._opacities[key] = Texture(pixels)
        return self._opacities[key]

    def _image(self, sid: str, parameters: dict[str, Element]) -> tuple[str, Texture | None]:
        """The image that a sampler leads to: its path, and itself."""
        for _ in range(3):  # sampler, surface, image
            parameter = parameters.get(sid)
            if parameter is None:
                break
            instance = parameter.find(".//instance_image")
            step = parameter.findtext(".//source") or parameter.findtext(".//init_from")
            sid = (instance.get("url", "") if instance is not None else step or "").strip().removeprefix("#")
        image = self._named(sid, "image")
        if image is None:
            return "", None
        path = (image.findtext("init_from") or image.findtext("init_from/ref") or "").strip()
        path = path or (image.findtext("init_from/ref") or "").strip()
        if path not in self._textures:
            self._textures[path] = Texture.decode(self.resources.read(path.removeprefix("file://")))
        return path, self._textures[path]


def _corners(
    primitive: Element, width: int, position: _Input, defects: dict[Defect, int]
) -> tuple[np.ndarray, np.ndarray]:
    """All corners' numbers (c, width), and the triangles (m, 3) between those corners."""
    lists, holes = _lists(primitive)
    if any(len(values) % width for values in lists):
        defects[Defect.BROKEN] = defects.get(Defect.BROKEN, 0) + 1
    lists = [values[: len(values) // width * width] for values in lists]
    numbers = np.concatenate([np.empty(0, np.int64), *lists]).reshape(-1, width)
    sizes = np.array([len(values) // width for values in lists], np.int64)
    if primitive.tag == "triangles":
        return numbers, np.arange(len(numbers) // 3 * 3).reshape(-1, 3)
    if primitive.tag == "tristrips":
        return numbers, strips(np.cumsum(sizes) - sizes, sizes)
    if primitive.tag == "polylist":
        sizes = np.maximum(_whole(primitive.findtext("vcount") or ""), 0)
        whole = int(np.searchsorted(np.cumsum(sizes), len(numbers), side="right"))
        if whole < len(sizes):
            defects[Defect.BROKEN] = defects.get(Defect.BROKEN, 0) + 1
        sizes = sizes[:whole]
    short = int(np.count_nonzero(sizes < 3))
    if short:
        defects[Defect.POLYGON] = defects.get(Defect.POLYGON, 0) + short
    cut = triangulate(
        np.ascontiguousarray(position.values[:, :3]),
        numbers[: int(sizes.sum()), position.offset],
        sizes,
        holes if primitive.tag == "polygons" else {},
        fans=primitive.tag == "trifans",
    )
    if cut.crossing:
        defects[Defect.CROSSING] = defects.get(Defect.CROSSING, 0) + cut.crossing
    return numbers, cut.corners


def _lists(primitive: Element) -> tuple[list[np.ndarray], dict[int, int]]:
    """A primitive's lists of numbers in their order; and how many that follow are holes in one, by its number."""
    lists: list[np.ndarray] = []
    holes: dict[int, int] = {}
    for child in primitive:
        if child.tag == "p":
            lists.append(_whole(child.text or ""))
        elif child.tag == "ph":
            rings = [_whole(ring.text or "") for ring in child if ring.tag == "h"]
            holes[len(lists)] = len(rings)
            lists += [_whole(child.findtext("p") or ""), *rings]
    return lists, holes


def _whole(text: str) -> np.ndarray:
    """Whole numbers as int64; words that are none become -1."""
    values = floats_of(text)
    return np.where(np.isfinite(values) & (np.abs(values) < 2**53), values, -1).astype(np.int64)


def _taken(values: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Rows of `values`; zeros where the index is -1."""
    taken = np.zeros((len(index), values.shape[1]))
    taken[index >= 0] = values[index[index >= 0]]
    return taken


def _mode(shader: Element) -> str:
    """What <transparent> means: A_ONE, A_ZERO, RGB_ONE or RGB_ZERO."""
    transparent = shader.find("transparent")
    mode = transparent.get("opaque", "A_ONE") if transparent is not None else "A_ONE"
    return mode if mode in ("A_ONE", "A_ZERO", "RGB_ONE", "RGB_ZERO") else "A_ONE"


def _amount(shader: Element) -> float:
    """The factor of <transparency>."""
    factor = floats_of(shader.findtext("transparency/float") or "1")
    return float(factor[0]) if len(factor) and np.isfinite(factor[0]) else 1.0


def _luminance(red: np.ndarray, green: np.ndarray, blue: np.ndarray) -> np.ndarray:
    return (red * 0.212671 + green * 0.715160) + blue * 0.072169


def _opacity(shader: Element) -> float:
    """Opacity from 0 to 1 by <transparent> as a colour, and <transparency>."""
    transparent, amount, mode = shader.find("transparent"), _amount(shader), _mode(shader)
    colour = floats_of(transparent.findtext("color") or "") if transparent is not None else np.empty(0)
    if len(colour) < 3 or not np.isfinite(colour).all():
        return amount if transparent is None and 0 < amount <= 1 else 1.0
    share = float(colour[3]) if mode.startswith("A_") and len(colour) > 3 else 1.0
    if mode.startswith("RGB"):
        share = float(_luminance(*colour[:3]))
    opacity = 1 - share * amount if mode.endswith("ZERO") else share * amount
    return opacity if 0 < opacity <= 1 else 1.0


FORMAT = Format((".dae",), read, _sniff, _named_files, _memory)
