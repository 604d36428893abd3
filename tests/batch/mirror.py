"""A web server with files, in a thread, that can be told to misbehave."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass
class Mirror:
    """What the server holds and how it answers.

    Attributes
    ----------
    files
        Content by path.
    answers
        For each request in turn a status to answer with, or the number of bytes after which to hang up as a negative
        number; when they are used up, or are None, the file is sent.
    ranges
        Whether it knows ranges.
    requests
        Path and Range header of every request that came.
    redirect
        Where every request is sent instead.
    kind
        Content-Type of the files.
    sleep
        Seconds to wait in the middle of a file.
    url
        Its address.
    """

    files: dict[str, bytes]
    answers: list[int | None] = field(default_factory=list)
    ranges: bool = True
    length: bool = True
    wrong_range: bool = False
    requests: list[tuple[str, str | None]] = field(default_factory=list)
    redirect: str = ""
    kind: str = ""
    sleep: float = 0.0
    url: str = ""


@contextmanager
def serving(mirror: Mirror) -> Iterator[Mirror]:
    """Run the server while the block runs."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            mirror.requests.append((self.path, wanted))
            answer = mirror.answers.pop(0) if mirror.answers else None
            if mirror.redirect:
                self.send_response(302)
                self.send_header("Location", mirror.redirect)
                self.end_headers()
                return
            content = mirror.files.get(self.path.lstrip("/"))
            if content is None or (answer or 0) > 0:
                self.send_error(answer or 404)
                return
            first = 0
            match = re.fullmatch(r"bytes=(\d+)-", wanted or "")
            if match and mirror.ranges:
                first = int(match[1])
                if first >= len(content):
                    self.send_error(416)
                    return
                self.send_response(206)
                said = first + 1 if mirror.wrong_range else first
                self.send_header("Content-Range", f"bytes {said}-{len(content) - 1}/{len(content)}")
            else:
                self.send_response(200)
            if mirror.kind:
                self.send_header("Content-Type", mirror.kind)
            if mirror.length:
                self.send_header("Content-Length", str(len(content) - first))
            self.end_headers()
            if mirror.sleep:
                self.wfile.write(content[first : first + 100])
                time.sleep(mirror.sleep)
                return
            self.wfile.write(content[first : len(content) if answer is None else first - answer])

        def log_message(self, *words: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
    thread.start()
    mirror.url = f"http://127.0.0.1:{server.server_address[1]}"
    try:
        yield mirror
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
