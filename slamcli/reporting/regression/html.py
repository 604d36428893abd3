"""A report as one HTML file that needs nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from slamcli.batch.regression.result import CaseResult, MetricResult, RegressionReport, Verdict
from slamcli.reporting.regression import words
from slamcli.reporting.text import seconds

# Colours of Okabe and Ito, dark enough for text; a sign stands before each word, so that colour is not all there is.
_STYLE = """
:root { color-scheme: light dark; --line: #8884; --soft: #8882; --good: #00734f; --bad: #b3400a; --mind: #0067a3; }
@media (prefers-color-scheme: dark) { :root { --good: #3ecf9f; --bad: #ff9a5c; --mind: #6cc0f5; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem; }
h1 { font-size: 1.4rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 1.8rem 0 .4rem; }
table { border-collapse: collapse; width: 100%; }
th, td { padding: .25rem .6rem; text-align: left; vertical-align: top; border-bottom: 1px solid var(--line); }
th { font-weight: 600; } td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr.case > * { border-top: 2px solid var(--line); background: var(--soft); font-weight: 600; }
.good { color: var(--good); } .bad { color: var(--bad); font-weight: 600; } .mind { color: var(--mind); }
.message { color: var(--bad); } code, pre { font: 13px/1.4 ui-monospace, monospace; }
pre { background: var(--soft); padding: .5rem .7rem; overflow-x: auto; margin: .3rem 0; white-space: pre-wrap; }
details { margin: .1rem 0; } dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; margin: 0; }
dt { opacity: .7; } dd { margin: 0; overflow-wrap: anywhere; }
"""
_SIGNS = {"good": "✓", "bad": "✗", "mind": "•"}


def render(report: RegressionReport) -> str:
    """The page."""
    kind = "bad" if report.exit_code else "good"
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>{escape(report.suite)}: {words.outcome(report)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head><body>",
        f'<h1>{escape(report.suite)}: <span class="{kind}">{_SIGNS[kind]} {words.outcome(report)}</span></h1>',
        f"<p>{escape(words.headline(report))}</p>",
        *(f"<p>{escape(note)}</p>" for note in report.notes),
        *_update(report),
        "<table><thead><tr><th>figure</th><th class=n>value</th><th class=n>baseline</th><th class=n>change</th>"
        "<th class=n>allowed</th><th>limit</th><th>verdict</th></tr></thead><tbody>",
        *(line for case in report.cases for line in _case(case)),
        "</tbody></table>",
        *_provenance(report),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


def _case(case: CaseResult) -> list[str]:
    time = f"<td class=n>{seconds(case.seconds) if case.repeats else ''}</td>"
    lines = [f"<tr class=case><td colspan=5>{escape(case.name)}</td>{time}<td>{_verdict(case.verdict)}</td></tr>"]
    if case.message:
        style = "message" if case.verdict.fails else "mind"
        lines.append(f'<tr><td colspan=7 class="{style}">{escape(case.message)}</td></tr>')
    lines += [line for figure in words.shown(case) for line in _figure(figure)]
    if case.commands:
        text = "\n".join([*(f"$ {command}" for command in case.commands), *([case.messages] if case.messages else [])])
        opened = " open" if case.verdict.fails else ""
        folded = f"<details{opened}><summary>commands</summary><pre>{escape(text)}</pre></details>"
        lines.append(f"<tr><td colspan=7>{folded}</td></tr>")
    return lines


def _figure(figure: MetricResult) -> list[str]:
    allowed = "" if figure.allowed is None else f"{figure.allowed:.3g}"
    cells = [words.spread(figure), words.number(figure.baseline), words.change(figure), allowed]
    numbers = "".join(f"<td class=n>{escape(cell)}</td>" for cell in cells)
    lines = [
        f'<tr><td title="{escape(figure.meaning)}">{escape(figure.name)}</td>{numbers}'
        f"<td>{escape(words.limits(figure))}</td><td>{_verdict(figure.verdict)}</td></tr>"
    ]
    if figure.message:
        style = "message" if figure.verdict.fails else "mind"
        lines.append(f'<tr><td></td><td colspan=6 class="{style}">{escape(figure.message)}</td></tr>')
    return lines


def _verdict(verdict: Verdict) -> str:
    kind = "bad" if verdict.fails else "good" if verdict in (Verdict.PASS, Verdict.IMPROVED) else "mind"
    return f'<span class="{kind}">{_SIGNS[kind]} {verdict.value}</span>'


def _update(report: RegressionReport) -> list[str]:
    if report.update is None:
        return []
    first, *others = words.update_lines(report.update)
    return [f"<p>{escape(first)}</p>", *([f"<pre>{escape(chr(10).join(others))}</pre>"] if others else [])]


def _provenance(report: RegressionReport) -> list[str]:
    def listing(entry: Mapping[str, object]) -> str:
        items = "".join(f"<dt>{escape(key)}</dt><dd>{escape(str(value))}</dd>" for key, value in entry.items())
        return f"<dl>{items}</dl>"

    here = {"suite": report.path, "suite sha256": report.sha256, "baseline": report.baseline}
    lines = ["<h2>This run</h2>", listing({**here, **words.facts(report.provenance)})]
    for entry in report.baseline_provenance:
        lines += ["<h2>Baseline</h2>", listing(words.facts(entry))]
    return lines
