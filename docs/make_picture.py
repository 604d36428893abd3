"""Write docs/images/optimize.svg from a real run in a terminal: ``python docs/make_picture.py``."""

from __future__ import annotations

import io
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / "docs" / "images" / "optimize.svg"
COMMAND = "slamcli optimize datasets/manhattan_small.g2o"
#: The picture asks no server for a font: the reader's own fixed-width one will do.
_FONT = "ui-monospace, SFMono-Regular, Menlo, Consolas, 'DejaVu Sans Mono', monospace"


def run_in_terminal(words: list[str]) -> str:
    """What a command shows on a terminal, standard output and standard error together."""
    keyboard, screen = pty.openpty()
    environment = {name: value for name, value in os.environ.items() if name != "NO_COLOR"}
    environment["TERM"] = "xterm-256color"
    with subprocess.Popen(words, cwd=ROOT, env=environment, stdin=screen, stdout=screen, stderr=screen) as process:
        os.close(screen)
        shown = b"".join(iter(lambda: _read(keyboard), b""))
        os.close(keyboard)
    if process.returncode:
        sys.exit(f"{' '.join(words)} ended with exit code {process.returncode}")
    return shown.decode().replace("\r\n", "\n")


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 65536)
    except OSError:  # how Linux says that nobody writes any more
        return b""


def picture() -> str:
    """The SVG."""
    text = Text.assemble(("$ ", "green"), (COMMAND, "bold"), "\n")
    text.append_text(Text.from_ansi(run_in_terminal([sys.executable, "-m", *COMMAND.split()])))
    width = max(len(line) for line in text.plain.splitlines()) + 1
    console = Console(record=True, width=width, file=io.StringIO(), color_system="truecolor", legacy_windows=False)
    console.print(text, no_wrap=True)
    svg = console.export_svg(title="slamcli", unique_id="slamcli")
    svg = re.sub(r"\s*@font-face \{.*?\}", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font-family: Fira Code, monospace", f"font-family: {_FONT}", svg)
    return svg.replace("<svg ", '<svg role="img" aria-label="slamcli optimizes a pose graph" ', 1)


if __name__ == "__main__":
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    PICTURE.write_text(picture(), encoding="utf-8")
