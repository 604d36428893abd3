"""Reads suite files, strictly: a message for every key that means nothing, with file and line."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from slamcli.batch.metrics import DIRECTIONS, EXIT_CODE, METRICS, metric
from slamcli.batch.pipeline import ESTIMATORS, FALSE, Case
from slamcli.batch.regression.inputs import FILE
from slamcli.batch.regression.suite import OPTIMUM_TOLERANCE, Gauge, Suite, SuiteCase
from slamcli.formats.configuration import suggestion
from slamcli.formats.yaml_nodes import Node, load

#: Commands that a case can be about: those that read a file and print a document.
COMMANDS = ("optimize", "ekf", "info", "sparsity", "covariance", "marginalize", "compare", "evaluate")
#: Keys of a suite, of a case, of its defaults, of a figure.
SUITE_KEYS = ("name", "defaults", "cases")
CASE_KEYS = (
    "name",
    "data",
    "simulate",
    "simulation",
    "inject",
    "command",
    "options",
    "truth",
    "labels",
    "evaluate",
    "metrics",
    "expect",
    "optimum",
    "optional",
    "repeats",
    "time_limit",
)
DEFAULT_KEYS = ("simulation", "command", "options", "evaluate", "metrics", "optional", "repeats", "time_limit")
EXPECT_KEYS = ("exit_code",)
METRIC_KEYS = ("better", "relative", "absolute", "gate", "at_most", "at_least", "equals")
#: Of what a case runs: a change of one of these makes another case of it.
_DEFINING = ("data", "simulate", "simulation", "inject", "command", "options", "truth", "labels", "evaluate")
#: Options of the steps that the batch sets itself.
_OWN = {
    "simulate": ("output", "o", "truth", "json"),
    "inject": ("output", "o", "labels", "json"),
    "command": ("output", "o", "json", "labels_out"),
    "evaluate": ("truth", "labels", "estimated_labels", "json"),
}


def read(path: str | Path) -> Suite:
    """The suite of a file.

    Raises
    ------
    UsageError
        If it cannot be read or breaks a rule.
    """
    where = Path(path)
    root = load(where)
    fields = root.fields("a suite", SUITE_KEYS)
    if "cases" not in fields:
        raise root.error("a suite needs cases", "  cases:", "    - {name: ..., data: ...}")
    defaults = fields["defaults"].fields("the defaults", DEFAULT_KEYS) if "defaults" in fields else {}
    cases = [_case(node, defaults) for node in fields["cases"].items("cases")]
    if not cases:
        raise fields["cases"].error("a suite needs at least one case")
    lines: dict[str, int] = {}
    for case in cases:
        if case.name in lines:
            raise Node(str(where), case.line, None).error(
                f"the name {case.name!r} stands twice", f"  first in line {lines[case.name]}"
            )
        lines[case.name] = case.line
    name = fields["name"].text("name") if "name" in fields else where.stem
    return Suite(name, where, hashlib.sha256(where.read_bytes()).hexdigest(), tuple(cases))


def _case(node: Node, defaults: dict[str, Node]) -> SuiteCase:
    fields = node.fields("a case", CASE_KEYS)
    if "name" not in fields:
        raise node.error("a case needs a name")
    name = fields["name"].text("name")
    if not name.isprintable():
        raise fields["name"].error(f"name: {name!r} has characters that cannot be printed")
    if ("data" in fields) == ("simulate" in fields):
        raise node.error(f"the case {name!r} needs data or simulate, one of them")
    if "simulation" in fields and "simulate" not in fields:
        raise fields["simulation"].error("simulation goes with simulate, not with data")
    merged = {**defaults, **fields}
    command = _command(merged)
    if command != _command(defaults):  # options of another command mean nothing here
        defaults = {key: value for key, value in defaults.items() if key != "options"}
    case = Case(
        name=name,
        command=command,
        options=_options(fields, defaults, "options", _OWN["command"]),
        data=_text(fields, "data"),
        simulate=_text(fields, "simulate"),
        simulation=_options(fields, defaults, "simulation", _OWN["simulate"]) if "simulate" in fields else {},
        inject=_options(fields, defaults, "inject", _OWN["inject"]),
        truth=_text(fields, "truth"),
        labels=_text(fields, "labels"),
        evaluate=_options(fields, defaults, "evaluate", _OWN["evaluate"]),
        time_limit=_time_limit(merged["time_limit"]) if "time_limit" in merged else None,
    )
    _check_comparison(case, fields)
    optimum = _optimum(fields["optimum"]) if "optimum" in fields else None
    if optimum is not None and (case.data is None or case.inject):
        raise fields["optimum"].error("the registry knows the optimum of data sets only, as they are")
    return SuiteCase(
        case=case,
        gauges=_gauges(fields, defaults, optimum is not None),
        repeats=merged["repeats"].count("repeats", 1) if "repeats" in merged else 1,
        optional=merged["optional"].flag("optional") if "optional" in merged else False,
        optimum=optimum,
        line=node.line,
        definition=definition(case),
    )


def _check_comparison(case: Case, fields: dict[str, Node]) -> None:
    """Nothing that is said about the truth goes unheard."""
    if case.truth is not None and case.simulate is not None:
        raise fields["truth"].error("a simulation has its own truth")
    if case.labels is not None and any(name in FALSE for name in case.inject):
        raise fields["labels"].error("inject says itself which edges are false")
    for key in ("truth", "labels", "evaluate"):
        if key in fields and case.command not in ESTIMATORS:
            hint = f"  options: {{truth: '{FILE}...'}} gives it a file" if case.command == "evaluate" else ""
            raise fields[key].error(
                f"{key} goes with {' and '.join(ESTIMATORS)}, not with {case.command}", *[hint][: bool(hint)]
            )
    known = case.simulate or case.truth or case.labels or any(name in FALSE for name in case.inject)
    if "evaluate" in fields and not known:
        raise fields["evaluate"].error(
            "there is nothing to compare with", "  truth: FILE, or labels: FILE, says what is right"
        )


def _time_limit(node: Node) -> float:
    seconds = node.number("time_limit", 0.0)
    if not seconds:
        raise node.error("time_limit: expected a positive number of seconds, found 0")
    return seconds


def definition(case: Case) -> str:
    """Hash of what a case runs."""
    text = json.dumps({key: getattr(case, key) for key in _DEFINING}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _command(fields: dict[str, Node]) -> str:
    return fields["command"].choice("command", COMMANDS) if "command" in fields else "optimize"


def _text(fields: dict[str, Node], key: str) -> str | None:
    return fields[key].text(key) if key in fields else None


def _options(fields: dict[str, Node], defaults: dict[str, Node], key: str, own: tuple[str, ...]) -> dict[str, Any]:
    """Options of a command line; those of the case beat the defaults."""
    found: dict[str, Any] = {}
    for source in (defaults, fields):
        if key not in source:
            continue
        for name, node in source[key].mapping(key).items():
            word = name.replace("-", "_")
            if word in own:
                raise node.error(f"{key}: the option {name!r} is set by regress itself")
            values = [item.value for item in node.value] if isinstance(node.value, list) else [node.value]
            if any(isinstance(value, dict | list) for value in values):
                raise node.error(f"{key}: {name}: expected a value or a list of values")
            if node.value is None and word not in found:
                raise node.error(f"{key}: {name} has no value", "  true is for options that have none")
            if None in values and node.value is not None:
                raise node.error(f"{key}: {name}: a value of the list is empty")
            found[word] = node.plain()
    return {word: value for word, value in found.items() if value is not None}


def _optimum(node: Node) -> float | None:
    if isinstance(node.value, bool):
        return OPTIMUM_TOLERANCE if node.value else None
    return node.number("optimum: true, or a relative tolerance", 0.0)


def _gauges(fields: dict[str, Node], defaults: dict[str, Node], optimum: bool) -> tuple[Gauge, ...]:
    """Figures of the defaults, then those of the case, which say more of the same name."""
    found: dict[str, Gauge] = {}
    for source in (defaults, fields):
        if "metrics" not in source:
            continue
        node = source["metrics"]
        entries = (
            [(item.text("a metric"), replace(item, value=None)) for item in node.value]
            if isinstance(node.value, list)
            else list(node.mapping("metrics").items())
        )
        names = [name for name, _ in entries]
        for name, entry in entries:
            if names.count(name) > 1:
                raise entry.error(f"the metric {name} stands twice")
            if name == EXIT_CODE and entry.value is not None:
                raise entry.error("say what the exit code should be with expect: {exit_code: N}")
            found[name] = _gauge(name, entry, found.get(name))
    if optimum and "chi2" not in found:
        found["chi2"] = Gauge(metric("chi2"))
    code = 0
    if "expect" in fields:
        expected = fields["expect"].fields("expect", EXPECT_KEYS)
        code = expected["exit_code"].count("exit_code", 0) if "exit_code" in expected else 0
        if code > 255:
            raise expected["exit_code"].error(f"exit_code: no process ends with {code}")
    given = found.pop(EXIT_CODE, Gauge(metric(EXIT_CODE)))
    return (replace(given, equals=float(code)), *found.values())


def _gauge(name: str, node: Node, base: Gauge | None) -> Gauge:
    step, colon, key = name.partition(":")
    if name not in METRICS and not (step and colon and key):
        raise node.error(f"unknown metric {name!r}", suggestion(name, METRICS), "  or step:key of a document")
    gauge = base or Gauge(metric(name))
    if node.value is None:
        return gauge
    fields = node.fields(f"the metric {name}", METRIC_KEYS)
    changes: dict[str, Any] = {}
    if "better" in fields:
        changes["better"] = fields["better"].choice("better", DIRECTIONS)
    for word in ("relative", "absolute"):
        if word in fields:
            changes[word] = fields[word].number(word, 0.0)
    if "gate" in fields:
        changes["gate"] = fields["gate"].flag("gate")
    limits = {word: fields[word].number(word) for word in ("at_most", "at_least", "equals") if word in fields}
    return replace(gauge, metric=replace(gauge.metric, **changes), **limits)
