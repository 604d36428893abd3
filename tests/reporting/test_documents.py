"""JSON documents: their keys are a promise, their numbers are those of the result, and they hold no NaN."""

import json
import math
from typing import Any

import pytest
from support import BUNDLED

import slamcli
from slamcli.graph import analyze
from slamcli.graph.describe import describe, worst_edges
from slamcli.reporting import documents
from slamcli.reporting.optimization_documents import optimize_document, trace_events
from slamcli.solver.certificate import CertifiedRun
from slamcli.solver.result import Result

#: What readers of the documents may rely on in schema 1; more keys may come.
HEAD = {"schema_version", "command", "version"}
INPUT = {"path", "sha256", "format", "poses", "landmarks", "edges", "by_tag", "loop_closures", "components", "skipped"}
OPTIMIZE = HEAD | {
    "input",
    "options",
    "gauge",
    "status",
    "reason",
    "iterations",
    "initial_chi2",
    "final_chi2",
    "dof",
    "trace",
    "sparsity",
    "time",
    "peak_memory_mb",
}
RECORD = {
    "iteration",
    "chi2",
    "chi2_change",
    "gradient_norm",
    "step_norm",
    "damping",
    "trials",
    "accepted",
    "time",
}
SPARSITY = {"dimension", "nnz_hessian", "nnz_factor", "fill_in", "factor_flops", "ordering"}
PATH = str(BUNDLED / "landmarks_small.g2o")


@pytest.fixture(scope="module")
def result() -> Result:
    return slamcli.optimize(slamcli.read(PATH), method="lm", fix=[3])


def document_of(result: Result) -> dict[str, Any]:
    """The document as a reader gets it: through its text."""
    graph = slamcli.read(PATH)
    time = {"load": 0.1, "setup": 0.2, "iterate": 0.3, "write": 0.0, "total": 0.6}
    run = CertifiedRun("g2o", result, result.graph)
    made = optimize_document(graph, analyze(graph), run, worst_edges(result.graph, 2), time, 12.5)
    out: dict[str, Any] = json.loads(documents.dumps(made))
    return out


def test_keys_of_an_optimization(result: Result) -> None:
    document = document_of(result)
    assert set(document) >= OPTIMIZE
    assert set(document["input"]) >= INPUT
    assert set(document["gauge"]) >= {"held", "reason"}
    assert set(document["sparsity"]) >= SPARSITY
    assert set(document["time"]) == {"load", "setup", "iterate", "write", "total"}
    assert document["trace"] and all(set(record) >= RECORD for record in document["trace"])
    assert set(document["options"]) >= {"method", "init", "max_iterations", "tolerance", "ordering", "linear_solver"}


def test_numbers_of_an_optimization(result: Result) -> None:
    document = document_of(result)
    assert (document["schema_version"], document["command"]) == (1, "optimize")
    assert document["version"] == slamcli.__version__
    assert document["options"]["method"] == "lm"
    assert document["options"]["fix"] == [3]
    assert document["gauge"]["held"] == [3]
    assert document["status"] == "converged"
    assert document["final_chi2"] == result.final_chi2  # every digit survives
    assert document["iterations"] == len(document["trace"]) == result.iterations
    assert [record["chi2"] for record in document["trace"]] == [record.chi2 for record in result.trace]
    assert document["dof"] == result.dof == 99 * 3 + 212 * 2 + 96 - 99 * 3 - 35 * 2
    assert document["peak_memory_mb"] == 12.5
    counts = {key: document["input"][key] for key in ("poses", "landmarks", "edges", "loop_closures", "components")}
    assert counts == {"poses": 100, "landmarks": 35, "edges": 407, "loop_closures": 0, "components": 1}
    by_tag = {"VERTEX_SE2": 100, "VERTEX_XY": 35, "EDGE_SE2": 99, "EDGE_SE2_XY": 212, "EDGE_BEARING_SE2_XY": 96}
    assert document["input"]["by_tag"] == by_tag
    assert [edge["chi2"] for edge in document["worst"]] == sorted((e["chi2"] for e in document["worst"]), reverse=True)


def test_keys_of_a_description() -> None:
    graph = slamcli.read(PATH)
    document = json.loads(documents.dumps(documents.info_document(graph, describe(graph), worst_edges(graph, 1))))
    assert set(document) >= HEAD | {"input", "variables", "factors", "component_sizes", "degree_mean", "chi2", "worst"}
    assert set(document["input"]) >= INPUT
    assert document["command"] == "info"
    assert document["chi2"] == graph.chi2()
    assert document["component_sizes"] == [135]
    assert sum(factors["count"] for factors in document["factors"]) == document["input"]["edges"] == 407
    assert sum(factors["chi2"] for factors in document["factors"]) == pytest.approx(document["chi2"])
    assert len(document["worst"]) == 1
    assert document["worst"][0]["line"] > 0


def test_trace_has_a_start_every_iteration_and_an_end(result: Result) -> None:
    graph = slamcli.read(PATH)
    lines = [documents.dumps(event, indent=None) for event in trace_events(graph, result.options, result)]
    assert all("\n" not in line for line in lines)
    first, *between, last = [json.loads(line) for line in lines]
    tried = [event for event in between if event["event"] == "tried"]
    iterations = between[len(tried) :]
    assert [event["name"] for event in tried] == [start.name for start in result.starts]
    assert (first["event"], last["event"]) == ("start", "end")
    assert first["chi2"] == result.initial_chi2
    assert first["schema_version"] == 1
    assert first["options"]["method"] == "lm"
    assert all(set(record) >= RECORD | {"event"} for record in iterations)
    assert [record["iteration"] for record in iterations] == list(range(1, result.iterations + 1))
    assert (last["status"], last["final_chi2"]) == ("converged", result.final_chi2)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_become_null(value: float) -> None:
    text = documents.dumps({"a": value, "b": [1.0, (value, 2)], "c": {"d": value}})
    assert json.loads(text) == {"a": None, "b": [1.0, [None, 2]], "c": {"d": None}}


def test_numpy_numbers_are_numbers() -> None:
    import numpy as np

    text = documents.dumps({"a": np.int64(2), "b": np.float64(0.1), "c": np.bool_(True), "d": np.float64("nan")})
    assert json.loads(text) == {"a": 2, "b": 0.1, "c": True, "d": None}


def test_a_graph_made_in_memory_has_no_file() -> None:
    graph = slamcli.read(PATH)
    graph.report = graph.document = None
    result = slamcli.optimize(graph)
    made = optimize_document(graph, analyze(graph), CertifiedRun("g2o", result, result.graph), [], {"total": 0.0}, 0.0)
    assert made["input"]["path"] is made["input"]["sha256"] is made["input"]["format"] is None
    assert json.loads(documents.dumps(made))["input"]["by_tag"] == {}
