"""`ImportedWorld`: a world and the account of how it came out of its file. Areas m^2, lengths m."""

from dataclasses import dataclass

from sandwich_sitl.world.world import World


@dataclass(frozen=True)
class Note:
    """One shape or place of the file and what was done with it, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class GridFacts:
    """An occupancy grid: its size, and the free ground that obstacles cut off and that was filled."""

    columns: int
    rows: int
    cell_m: float
    occupied_cells: int
    unknown_cells: int
    enclosed_cells: int


@dataclass(frozen=True)
class ImportReport:
    """`read` shapes were in the file; `filtered` did not match the filter, `outside` lie outside window or bounds.

    `outside_names` are those of shapes wholly outside the bounds, the first hundred of them.
    """

    source: str
    file_format: str
    read: int
    filtered: int = 0
    outside: int = 0
    outside_names: tuple[str, ...] = ()
    vertices: int = 0
    repaired: tuple[Note, ...] = ()
    dropped: tuple[Note, ...] = ()
    courtyards: tuple[Note, ...] = ()
    remarks: tuple[Note, ...] = ()
    grid: GridFacts | None = None


@dataclass(frozen=True)
class ImportedWorld:
    """The world and the report on its import."""

    world: World
    report: ImportReport
