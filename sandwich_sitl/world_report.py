"""The lines that `world` prints: what was read from a map file, what was mended or left out, and what the world holds."""

import shapely
from shapely import box

from sandwich_sitl.world.importers.result import ImportedWorld, Note
from sandwich_sitl.world.world import World

_SHOWN = 10  # notes of a kind; the rest is counted


def world_report(imported: ImportedWorld) -> str:
    """Extents and counts, lengths in metres; cover is the share of the bounds that obstacles take."""
    world, report = imported.world, imported.report
    x_min, y_min, x_max, y_max = world.bounds_m
    heights = [o.height_m for o in world.obstacles if o.height_m is not None]
    lines = [
        f"map       {report.source} ({report.file_format})",
        f"bounds    {x_max - x_min:.2f} x {y_max - y_min:.2f} m: "
        f"x {x_min:.2f} to {x_max:.2f}, y {y_min:.2f} to {y_max:.2f}",
    ]
    if world.origin:
        lines.append(f"origin    {world.origin.latitude_deg:.7f} deg north, {world.origin.longitude_deg:.7f} deg east")
    if grid := report.grid:
        lines.append(
            f"grid      {grid.columns} x {grid.rows} cells of {grid.cell_m:g} m: {grid.occupied_cells} occupied, "
            f"{grid.unknown_cells} unknown, {grid.enclosed_cells} free but enclosed"
        )
    lines.append(
        f"obstacles {len(world.obstacles)} with {report.vertices} corners, cover {100 * cover(world):.1f} %; "
        f"of {report.read} read: {report.filtered} filtered out, {report.outside} outside, {len(report.dropped)} dropped"
    )
    if heights:
        lines.append(f"heights   {len(heights)} known, {min(heights):.1f} to {max(heights):.1f} m")
    for title, notes in (
        ("outside", tuple(Note(name, "lies wholly outside the bounds") for name in report.outside_names)),
        ("repaired", report.repaired),
        ("dropped", report.dropped),
        ("courtyard", report.courtyards),
        ("remark", report.remarks),
    ):
        lines += _listed(title, notes)
    return "\n".join(lines)


def notices(imported: ImportedWorld) -> list[str]:
    """What a person who flies in this world must know: a line for each way in which it is not the map as given."""
    report = imported.report
    kinds = (
        (report.outside, report.outside_names, "wholly outside the bounds, left out"),
        (len(report.repaired), tuple(note.name for note in report.repaired), "repaired"),
        (len(report.dropped), tuple(note.name for note in report.dropped), "not usable, left out"),
    )
    return [
        f"world: {count} {'shape' if count == 1 else 'shapes'} {what}"
        f" ({', '.join([*names[:3], *(['...'] if count > 3 else [])])})"
        for count, names, what in kinds
        if names
    ]


def cover(world: World) -> float:
    """Area of the obstacles inside the bounds, overlaps once, over the area of the bounds."""
    frame = box(*world.bounds_m)
    return float(shapely.union_all([o.polygon for o in world.obstacles]).intersection(frame).area / frame.area)


def _listed(title: str, notes: tuple[Note, ...]) -> list[str]:
    lines = [f"{title:<9} {note.name}: {note.reason}" for note in notes[:_SHOWN]]
    if len(notes) > _SHOWN:
        lines.append(f"{title:<9} and {len(notes) - _SHOWN} more")
    return lines
