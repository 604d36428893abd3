"""The bundled data sets are what the command line makes of configs/datasets, byte for byte, on any machine."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fingerprints import fingerprints, scenarios, vector_units
from support import BUNDLED

import slamcli
from slamcli.cli.main import main
from slamcli.simulation.scenario import MOTIONS, PLANAR_SENSORS
from slamcli.simulation.worlds import WORLDS

ROOT = Path(__file__).parents[2]
CONFIGS = ROOT / "configs" / "datasets"
FILES = sorted(path for path in BUNDLED.iterdir() if path.suffix in (".g2o", ".graph"))
_OLD_GLIBC = "glibc.cpu.hwcaps=-AVX2,-FMA"  # other C libraries do not look at it
each_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)


@each_file
def test_bytes(path: Path, tmp_path: Path) -> None:
    """Run `make datasets` after a change of the simulator or of a configuration that is meant."""
    made, truth = tmp_path / path.name, tmp_path / "truth.g2o"
    words = ["simulate", str(CONFIGS / f"{path.stem}.yaml"), "--quiet", "-o", str(made), "--truth", str(truth)]
    assert main(words) == 0
    assert made.read_bytes() == path.read_bytes()
    assert truth.read_bytes() == (BUNDLED / "truth" / f"{path.stem}.g2o").read_bytes()


@each_file
def test_the_truth_explains_the_measurements(path: Path) -> None:
    """chi2 of the file's edges at the file of the truth is a chi-square variable of as many degrees as residuals."""
    graph, truth = slamcli.read(str(path)), slamcli.read(str(BUNDLED / "truth" / f"{path.stem}.g2o"))
    assert truth.edges == 0
    assert {name: column.ids.tolist() for name, column in truth.variables.items()} == {
        name: column.ids.tolist() for name, column in graph.variables.items()
    }
    residuals = sum(len(factors) * factors.kind.dimension for factors in graph.factors)
    chi2 = graph.with_values(truth.values).chi2()
    assert abs(chi2 - residuals) < 5.0 * np.sqrt(2.0 * residuals)
    assert graph.chi2() > 2.0 * chi2  # the vertices are not the truth


def test_makefile_and_folders_agree() -> None:
    """One configuration and one truth for each file, and `make datasets` writes all of them."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (listed,) = re.findall(r"for file in ([^;$]*); do", makefile)
    stems = sorted(path.stem for path in FILES)
    assert len(stems) >= 4
    assert sorted(listed.split()) == [path.name for path in FILES]
    assert sorted(path.name for path in CONFIGS.iterdir()) == [f"{stem}.yaml" for stem in stems]
    assert sorted(path.name for path in (BUNDLED / "truth").iterdir()) == [f"{stem}.g2o" for stem in stems]
    others = {"truth", "registry", "README.md"}
    assert {path.name for path in BUNDLED.iterdir()} == {path.name for path in FILES} | others
    table = (BUNDLED / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(.*?)`", table, re.MULTILINE) == listed.split()


def test_same_bytes_with_other_instructions() -> None:
    """A process in which numpy, OpenBLAS and the C library do without newer instructions draws the same worlds."""
    units = ",".join(vector_units())
    settings = {"NPY_DISABLE_CPU_FEATURES": units, "OPENBLAS_CORETYPE": "Prescott", "GLIBC_TUNABLES": _OLD_GLIBC}
    program = Path(__file__).with_name("fingerprints.py")
    done = subprocess.run(
        [sys.executable, str(program)], env={**os.environ, **settings}, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    other = json.loads(done.stdout)
    assert other["vector_units"] == []
    here = fingerprints()
    assert set(here) >= {*WORLDS, *MOTIONS}
    assert {sensor["kind"] for content in scenarios().values() for sensor in content["sensors"]} >= set(PLANAR_SENSORS)
    assert len(set(here.values())) == len(here)
    assert other["fingerprints"] == here
