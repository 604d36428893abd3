"""Sensor logs, one file for each format: what a robot's instruments said, read as ``graph.sensor_log.SensorLog``.

``graphs`` (g2o and TORO landmark graphs), ``simulated`` (the CSV of ``slamcli simulate --log``), ``mrclam`` (UTIAS
MRCLAM folders), ``victoria_park`` (its raw odometry and tree detections), ``plaza`` (odometry and radio ranges),
``pyfg`` (PyFactorGraph text) and ``course`` (ODOMETRY and SENSOR records). ``docs/logs.md`` describes them.
"""

from slamcli.formats.logs.read import read_log

__all__ = ["read_log"]
