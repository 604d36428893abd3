"""``slamcli predict``: one reading, worked out."""

from __future__ import annotations

from typing import Any

import click

from slamcli.cli.options import json_option
from slamcli.cli.quantities import Numbers

_EXAMPLES = """\b
Examples:
  slamcli predict --pose 2,1,30deg --landmark 5,5 --reading 5.2,21deg
  slamcli predict --pose 2,1,30deg --landmark 5,5 --sensor bearing --frame local
  slamcli predict --pose 2,1,30deg --landmark 5,5 --reading 5.2,21deg \\
    --noise 0.1,2deg --pose-noise 5cm,5cm,1deg --json

\b
Exit codes: 0 success, 2 usage (also where the landmark is at the pose itself).
"""

#: Names and units of what each sensor reads; the sensors themselves are in ``slamcli.filtering``.
SENSORS = ("range-bearing", "bearing", "range", "xy")


@click.command(name="predict", epilog=_EXAMPLES)
@click.option(
    "--pose", type=Numbers("m", "m", "rad"), metavar="X,Y,THETA", required=True, help="Pose of the robot in the world."
)
@click.option("--landmark", type=Numbers("m", "m"), metavar="X,Y", required=True, help="Landmark in the world.")
@click.option("--reading", metavar="Z", help="What the sensor read: range,bearing, or bearing, or range, or x,y.")
@click.option(
    "--sensor", type=click.Choice(SENSORS), default="range-bearing", show_default=True, help="What the sensor reads."
)
@click.option("--noise", metavar="SD", help="Standard deviations of the reading, as many as it has numbers.")
@click.option(
    "--pose-noise",
    type=Numbers("m", "m", "rad", minimum=0.0),
    metavar="SX,SY,STHETA",
    help="Standard deviations of the pose, along the axes of --frame.",
)
@click.option(
    "--landmark-noise",
    type=Numbers("m", "m", minimum=0.0),
    metavar="SX,SY",
    help="Standard deviations of the landmark.",
)
@click.option(
    "--frame",
    type=click.Choice(["world", "local"]),
    default="world",
    show_default=True,
    help="Axes of a pose step: those of the world, as textbooks have it, or the pose's own, as the optimizer does.",
)
@json_option
@click.pass_context
def command(context: click.Context, /, **given: Any) -> int:
    """Print what a sensor should read of a landmark, the innovation of a reading, and the Jacobians.

    Numbers are metres and radians, or have a unit: m, cm, mm, rad, deg. The innovation is z - h, the reading minus
    its prediction. With any noise its covariance is printed, and how probable so large an innovation is.
    """
    import numpy as np

    from slamcli.filtering.innovation import SENSORS, predict
    from slamcli.reporting import documents
    from slamcli.reporting.prediction import prediction_document, prediction_summary

    sensor = SENSORS[given["sensor"]]
    given["reading"] = _measured(context, "reading", Numbers(*sensor.units), given["reading"])
    given["noise"] = _measured(context, "noise", Numbers(*sensor.units, minimum=0.0), given["noise"])
    optional = ("reading", "noise", "pose_noise", "landmark_noise")
    reading, noise, pose_noise, landmark_noise = (
        None if given[name] is None else np.array(given[name]) for name in optional
    )
    prediction = predict(
        sensor,
        np.array(given["pose"]),
        np.array(given["landmark"]),
        reading,
        frame=given["frame"],
        reading_deviations=noise,
        pose_deviations=pose_noise,
        landmark_deviations=landmark_noise,
    )
    if given["json"]:
        print(documents.dumps(prediction_document(prediction)))
    else:
        print(*prediction_summary(prediction), sep="\n")
    return 0


def _measured(context: click.Context, name: str, numbers: Numbers, text: str | None) -> tuple[float, ...] | None:
    """Numbers in the units of the sensor, which is known only now."""
    option = next(option for option in context.command.params if option.name == name)
    return None if text is None else numbers.convert(text, option, context)
