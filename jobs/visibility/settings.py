"""How an engine may be set: the ways to find what is hidden, and how hard it tries. Light to import, for help."""

from __future__ import annotations

from dataclasses import dataclass

#: The first is the one to use. The second is the vLOD paper's, to compare with: safe too, but slower and less tight.
METHODS = ("flooded-occluders", "shrunk-occluders")


@dataclass(frozen=True)
class EngineSettings:
    """How hard the engine tries; all settings but `sampled` and `seal` are safe: they only trade time for tightness."""

    method: str = METHODS[0]  # one of METHODS
    resolution: int = 80  # pixels along the edge of a cube face
    layers: int = 2  # pairs of depths that a pixel keeps
    largest_flooded_set: int = 2048  # triangles in one flooded occluder set
    smallest_window: int = 16  # pixels that a core's image must span to be worth flooding from
    cluster_size: int = 32  # triangles in a cluster: the cores of the floods, the units of the finer tests
    proof_resolution: int = 64  # pixels along the edge of an item buffer's cube face; 0: prove nothing
    proof_points: int = 1  # corners of the cell from which item buffers are drawn, 8 at most
    aimed_rays: int = 4096  # at drawables that item buffers do not prove visible, all together
    most_aimed_rays: int = 512  # at one of them
    shafts: int = 20_000  # looked at to decide what is neither proven visible nor hidden, all together
    least_worth: float = 0.3  # triangles that a shaft must be expected to save
    sampled: bool = False  # report what rays meet, nothing else: may miss what can be seen
    seal: float = 0.0  # gaps no wider than this, in model units, count as closed: may miss what is seen through them
    sampling_rays: int = 20_000  # in all directions, of a sampled cell
    sampling_aimed_rays: int = 65_536  # at drawables that these do not meet, all together
    hold_out_rays: int = 10_000  # that measure what an approximate cell misses

    @property
    def approximate(self) -> bool:
        """Whether cells may miss what can be seen; how much is measured then."""
        return self.sampled or self.seal > 0

    @property
    def image_bytes(self) -> int:
        """Memory of an engine's images, in bytes."""
        from jobs.visibility.images.raster import LANES

        pairs = 6 * self.resolution**2 * self.layers * 8
        return pairs + 16 * self.resolution * (self.resolution + LANES) + 6 * self.proof_resolution**2 * 12


#: Named settings: how much time a cell may take to close its gap. "normal" is the default. See docs/visibility.md.
QUALITIES: dict[str, EngineSettings] = {
    "draft": EngineSettings(resolution=48, aimed_rays=1024, most_aimed_rays=128, shafts=2000, least_worth=2.0),
    "normal": EngineSettings(),
    "high": EngineSettings(
        resolution=256,
        layers=4,
        proof_points=4,
        aimed_rays=16_384,
        most_aimed_rays=1024,
        shafts=200_000,
        least_worth=0.01,
    ),
}
