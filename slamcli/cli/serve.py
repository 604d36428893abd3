"""``python -m slamcli.cli.serve``: the other side of ``slamcli.batch.interpreter``.

Reads one JSON document in each line of standard input: the ``words`` of a command and the ``folder`` to run it in.
Answers each with a line: its exit ``code`` and what it printed (``out``). Its messages go to standard error, a file,
which holds those of the last command only.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import traceback
from typing import IO, Any


def serve() -> None:
    """Run commands until standard input ends."""
    from slamcli.batch.interpreter import scratch
    from slamcli.cli.main import main

    questions, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    # what a command, or a library below Python, reads and prints has nothing to do with the two above
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    home = tempfile.gettempdir()
    with scratch() as printed:
        for line in questions:
            question = json.loads(line)
            os.dup2(printed.fileno(), 1)
            for stream in (1, 2):
                os.lseek(stream, 0, os.SEEK_SET)
                os.ftruncate(stream, 0)
            code = _run(main, question["words"], question["folder"])
            os.chdir(home)  # so that the folder can be removed
            answers.write(json.dumps({"code": code, "out": _content(printed)}).encode() + b"\n")
            answers.flush()


def _run(main: Any, words: list[str], folder: str) -> int:
    """Exit code of a command; that of Python itself where an exception leaves it."""
    try:
        os.chdir(folder)
        return int(main(words))
    except BaseException:
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()


def _content(printed: IO[bytes]) -> str:
    return os.pread(printed.fileno(), os.fstat(printed.fileno()).st_size, 0).decode(errors="replace")


if __name__ == "__main__":
    serve()
