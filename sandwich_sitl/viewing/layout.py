"""The blueprint of a run: scene, motion space beside planning space, time series, mission states, log."""

from typing import Any

SERIES = {
    "Tracking error [m]": "/series/error_m",
    "Clearance [m]": "/series/clearance_m",
    "Snap [m/s^4]": "/series/snap",
    "Solve and loop time [ms]": "/series/wall_ms",
}


def layout() -> Any:
    """The views, with every view's contents named; no map view, since that would fetch tiles."""
    import rerun.blueprint as rrb

    spaces = rrb.Horizontal(
        rrb.Spatial2DView(origin="/motion", contents="/motion/**", name="Motion space"),
        rrb.Spatial2DView(origin="/planning", contents="/planning/**", name="Planning space"),
    )
    series = [rrb.TimeSeriesView(origin=entity, contents=f"{entity}/**", name=name) for name, entity in SERIES.items()]
    states = rrb.StateTimelineView(origin="/mission", contents="/mission/**", name="Mission")
    text = rrb.TextLogView(origin="/", contents="/log", name="Log")
    scene = rrb.Spatial3DView(origin="/world", contents="/world/**", name="Scene")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene, spaces, row_shares=[3, 2]),
            rrb.Vertical(*series, states, text, row_shares=[4, 4, 4, 4, 6, 4]),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline="time"),
        collapse_panels=True,
        auto_views=False,
    )
