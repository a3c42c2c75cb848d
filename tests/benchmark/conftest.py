"""A server of a language model that answers as a test says."""

from __future__ import annotations

import json
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest


class Server:
    """Answers chat completions with ``body`` (or what it makes of the question), and keeps what it was asked."""

    def __init__(self):
        self.asked, self.headers, self.paths = [], [], []
        self.status, self.body, self.wait_s, self.trickle_s = 200, "", 0.0, 0.0
        self.stopped = threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                outer.paths.append(self.path)
                outer.headers.append(dict(self.headers))
                outer.asked.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
                body = outer.body(outer.asked[-1]) if callable(outer.body) else outer.body
                outer.stopped.wait(outer.wait_s)
                try:
                    self.send_response(outer.status)
                    self.end_headers()
                    if outer.trickle_s:
                        for _ in range(60):  # not for ever, so that a client that would wait for ever fails its test
                            outer.stopped.wait(outer.trickle_s)
                            self.wfile.write(b" ")
                            self.wfile.flush()
                    self.wfile.write(body.encode())
                except OSError:
                    pass  # who asked has given up

            def log_message(self, *args):
                pass

        self._http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._thread = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()
        self.url = f"http://127.0.0.1:{self._http.server_port}/v1"

    def stop(self):
        self.stopped.set()
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()


@pytest.fixture
def server():
    running = Server()
    yield running
    running.stop()
