"""The part of ``slamcli simulate`` that makes scenes of bundle adjustment."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from typing import Any

from slamcli.errors import UsageError

#: Options of ``simulate`` that scenes have no use for.
_FOREIGN = ("log", "labels", "sweep")


def simulate_scene(source: str, content: dict[str, Any], given: dict[str, Any]) -> int:
    """Simulate a scene of cameras, write it, say what was made."""
    started = time.perf_counter()
    for name in _FOREIGN:
        if given[name]:
            raise UsageError(f"--{name} has no meaning for a scene of cameras", ("  -o and --truth write scenes",))
    from slamcli.cli.options import warn
    from slamcli.evaluation.reprojection import reprojection
    from slamcli.formats import write
    from slamcli.formats.recognize import of_ending
    from slamcli.reporting import documents
    from slamcli.reporting import reprojection as pixels
    from slamcli.simulation.camera_scenes import simulate_cameras
    from slamcli.simulation.settings import camera_scene_of

    if "poses" in content:
        content["cameras"] = content.pop("poses")
    made = simulate_cameras(camera_scene_of(content, source))
    files = {name: given[name] for name in ("output", "truth") if given[name]}
    for name, graph in (("output", made.graph), ("truth", made.truth)):
        if given[name]:
            warn(write(graph, given[name], dialect=of_ending(given[name]) or "bal"))
    seconds = time.perf_counter() - started
    before, after = reprojection(made.graph), reprojection(made.truth)
    counts = {"cameras": made.graph.poses, "points": made.graph.landmarks, "observations": made.graph.edges}
    if given["json"]:
        document = documents.head("simulate") | counts | {"dropped": made.dropped, "scenario": asdict(made.scene)}
        document |= {"files": files, "reprojection": pixels.reprojection_section(before, after), "time": seconds}
        print(documents.dumps(document))
    elif not given["quiet"]:
        out = sys.stderr if "-" in (given["output"], given["truth"]) else sys.stdout
        said = ", ".join(f"{number} {name}" for name, number in counts.items())
        print(f"scene    {made.scene.world}, seed {made.scene.seed}: {said}", file=out)
        if made.dropped:
            print(f"dropped  {made.dropped} points that fewer than two cameras see", file=out)
        print(f"written  {', '.join(files.values()) or 'nothing (-o FILE keeps the scene)'}", file=out)
        print(*pixels.reprojection_lines(before, after, ("start", "truth")), sep="\n", file=out)
    return 0
