"""Command lines of ``slamcli simulate``."""

from __future__ import annotations

from row import Case

ROWS = (
    Case("simulate camera-ring -o scene.bal --truth truth.bal --poses 5", 0, out=("5 cameras", "reprojection, pixels")),
    Case("simulate camera-flight --json --seed 3", 0, out=('"dropped"', '"reprojection": {')),
    Case("simulate camera-ring -o -", 0, out="20 500 ", err="written"),
    Case("simulate camera-ring --log log.csv", 2, err="--log has no meaning for a scene of cameras"),
    Case("simulate camera-ring --set cameras=1", 2, err="no point is seen by two cameras"),
    Case("simulate camera-ring -o scene.g2o", 3, err="knows no distortion"),
    Case("simulate square --poses 9 -o {out}", 0, out=("world", "9 poses, 8 m", "drift", "{out}")),
    Case("simulate square --poses 9 -o -", 0, out="VERTEX_SE2 8", err="9 poses"),
    Case("simulate square --poses 9 -q -o -", 0, out="EDGE_SE2 7 8"),
    Case("simulate square --poses 9", 0, out="nothing (-o FILE keeps the graph)"),
    Case("simulate square --poses 9 --json", 0, out=('"command": "simulate"', '"world": "square"', '"drift"')),
    Case("simulate square --poses 9 --truth {out}", 0, out="truth"),
    Case("simulate square --poses 9 --log -", 0, out="time_s,kind,pose,other,z1,z2,z3,i11", err="drift"),
    Case("simulate square --poses 9 --labels -", 0, out="edge,tag,from,to,label", err="drift"),
    Case("simulate square --poses 9 --seed 7", 0, out="seed 7"),
    Case("simulate {config}", 0, out="11 poses", config="world: circle\nposes: 11\n"),
    Case("simulate {config} --set poses=12", 0, out="12 poses", config="world: circle\nposes: 11\n"),
    Case("simulate square --poses 9 --sweep robot.noise=0,0.1 --runs 2", 0, out=("gap mean", "0.1")),
    Case("simulate square --poses 9 --sweep robot.noise=0,1 --runs 2 --json", 0, out=('"sweep": "robot.noise"',)),
    Case("simulate square --sweep robot.slip", 2, err="--sweep needs key=value"),
    Case("simulate square --sweep poses=3 -o {out}", 2, err="writes no file"),
    Case("simulate square -o x.tum", 2, err=("x.tum", "as g2o or TORO")),
    Case("simulate {config}", 2, err="the key poses stands twice", config="poses: 3\nposes: 4\n"),
    Case("simulate square --runs 0", 2, err="0"),
    Case("simulate squar", 2, err=("no world and no file 'squar'", "did you mean square?")),
    Case("simulate nowhere.yaml", 2, err="nowhere.yaml: cannot be read"),
    Case("simulate {config}", 2, err="{config}: unknown key 'pose'", config="world: circle\npose: 11\n"),
    Case("simulate {config}", 2, err="is not valid YAML", config="world: ["),
    Case("simulate square --set robot.slp=1", 2, err=("unknown key 'robot.slp'", "did you mean slip?")),
    Case("simulate square --set poses", 2, err="--set needs key=value"),
    Case("simulate square -o {out} --truth {out}", 2, err="name the same file"),
    Case("simulate square -o - --json", 2, err="both want standard output"),
    Case("simulate {config} --log {config}", 2, err="--log {config} is an input", config="world: square\n"),
    Case("simulate square --poses 9 -o nowhere/x.g2o", 3, err="nowhere/x.g2o: cannot be written"),
    Case("simulate", 2, err="SOURCE"),
    Case("simulate --help", 0, out=("Usage: slamcli simulate", "Worlds:", "Exit codes")),
)
