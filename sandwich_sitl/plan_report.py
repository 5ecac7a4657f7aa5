"""The lines that `plan` prints: the map's figures and a table like the paper's Table I, with the exact optimum beside it."""

from math import isnan

import shapely

from sandwich_sitl.planning.baselines import path_length
from sandwich_sitl.planning.decomposition import areas_m2
from sandwich_sitl.planning.flight_plan import FlightPlan, FloorPlan
from sandwich_sitl.planning.outlines import Outlines


def plan_report(plan: FlightPlan) -> str:
    """Lengths in metres; the reduction is against the existing A*, as the paper's table gives it (its text says 6.21 %)."""
    channel_map, quality = plan.channel_map, plan.channel_map.quality
    sandwich = path_length(plan.sandwich_m)
    lines = [
        f"map       {channel_map.channels} channels along {channel_map.flow}, {len(channel_map.bays)} bays, "
        f"{channel_map.nodes} nodes, {quality.cells} cells ({quality.folded_cells} folded, {quality.repaired_cells} repaired)",
        f"          least corner sine {quality.min_jacobian_ratio:.3f}, mean angle error "
        f"{quality.mean_angle_error_deg:.1f} deg, edges {quality.median_edge_m:.2f} m, coverage {quality.coverage:.5f}",
        "",
        "          existing A*   Sandwich A*   tight route   exact shortest path",
    ]
    regular = path_length(plan.grid_astar_m) if len(plan.grid_astar_m) else None
    tight = path_length(plan.tight_m) if len(plan.tight_m) else None
    exact = path_length(plan.exact_m) if len(plan.exact_m) else None
    lines.append(
        f"length    {_metres(regular):>11}   {_metres(sandwich):>11}   {_metres(tight):>11}   {_metres(exact):>19}"
    )
    if exact:
        over = [
            f"{100 * (length / exact - 1):+.2f} %" if length else "-" for length in (regular, sandwich, tight, exact)
        ]
        lines.append(f"over it   {over[0]:>11}   {over[1]:>11}   {over[2]:>11}   {over[3]:>19}")
    if regular:
        lines.append(
            f"reduction {100 * (1 - sandwich / regular):.2f} % of the existing A*'s length, "
            f"{100 * (regular / sandwich - 1):.2f} % of the Sandwich A*'s"
        )
    proof = ", proven: no path among the grown obstacles is shorter" if plan.route_proven else ""
    lines.append(f"flown     {plan.route_kind} route{proof}")
    if plan.floors is not None:
        lines += _floor_lines(plan.floors)
    lines += ["", f"flight    {plan.reference.t_s[-1]:.1f} s, {len(plan.corridor.polygons_m)} regions"]
    if plan.flight is not None:
        flight = plan.flight
        lines.append(
            f"          along the route {flight.duration_s:.2f} s, {flight.duration_s / flight.least_duration_s:.3f} times "
            f"the time-optimal law's; curve {flight.curve_m:.2f} m, {flight.curve_m / flight.route_m:.4f} times the route"
        )
    lines += _corridor_lines(plan)
    lines.append("seconds   " + ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in plan.seconds.items()))
    return "\n".join(lines)


def _corridor_lines(plan: FlightPlan) -> list[str]:
    """Area per step beside the paper's quadrangle and a free-space decomposition, and what was proven."""
    outlines = Outlines(
        [shapely.Polygon(ring) for ring in plan.obstacles_m], plan.vehicle_radius_m,
        plan.blocking_heights_m + plan.vehicle_radius_m,
    )  # fmt: skip
    own, paper, free = areas_m2(plan.reference, plan.corridor, outlines)
    lines = [
        f"corridor  {own:.1f} m2 a step; the paper's quadrangle {paper:.1f}, a free-space decomposition {free:.1f}"
    ]
    if plan.proof is not None:
        proof = plan.proof
        verdict = "proven free" if proof.proven else f"NOT proven: {proof.problem}"
        lines.append(
            f"          {verdict} for {proof.steps} steps; least margin {proof.least_margin_m:.3f} m, "
            f"{proof.between_samples_m:.3f} m kept for between samples"
        )
        if proof.least_headroom_m is not None:
            lines.append(f"          over obstacles {proof.least_headroom_m:.3f} m and more, besides what is kept")
    return lines


def _floor_lines(floors: FloorPlan) -> list[str]:
    """Every floor's lengths over ground, what rising to it and leaving it is worth, and the way that came of it."""
    lines = ["", "floor     existing A*   Sandwich A*     its route         exact   + climb = cost   channels  nodes"]
    for number, floor in enumerate(floors.figures):
        mark = "*" if number == floors.flown else " "
        if floor.refused:
            lines.append(f"{floor.altitude_m:6.1f} m{mark}  {floor.refused}")
            continue
        lengths = (floor.grid_astar_m, floor.sandwich_m, floor.route_m, floor.exact_m)
        lines.append(
            f"{floor.altitude_m:6.1f} m{mark} "
            + "   ".join(f"{_metres(None if isnan(length) else length):>11}" for length in lengths)
            + f"   {floor.climb_cost_m:7.2f} {floor.route_m + floor.climb_cost_m:8.2f}   {floor.channels:8d}  {floor.nodes}"
        )
    lines.append(
        f"way       {floors.length_m:.2f} m in space, {floors.climbed_m:.1f} m up and {floors.descended_m:.1f} m down between "
        f"the floors of start and goal, {floors.changes} changes (* flown)"
    )
    return lines


def _metres(length: float | None) -> str:
    return "-" if length is None else f"{length:.2f} m"
