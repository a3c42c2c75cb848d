"""One file: MCAP in chunks that are complete on the disk soon after they happened."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from surveilnav import __version__
from surveilnav.services.recorder.core.line import Line, Schema

try:
    import fcntl
except ImportError:  # not a POSIX system: nothing there says that a file is being written
    fcntl = None  # type: ignore[assignment]

_CHUNK_BYTES = 1 << 20


class RecordingFile:
    """Written by one thread. Every method raises OSError as the disk does; then ``abandon`` it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._raw = _Raw(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644))
        if fcntl is not None:
            fcntl.flock(self._raw.fd, fcntl.LOCK_EX)  # held while this process writes it, whatever becomes of it
        self._writer = Writer(self._raw, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._schemas: dict[Schema, int] = {}
        self._channels: dict[str, int] = {}
        self._whole_bytes = 0
        self._writer.start(library=f"surveilnav {__version__}")  # type: ignore[no-untyped-call]

    @property
    def n_bytes(self) -> int:
        """Written so far."""
        return self._raw.tell()

    def note(self, name: str, facts: Mapping[str, str]) -> None:
        """Writes facts about the recording."""
        self._writer.add_metadata(name, dict(facts))  # type: ignore[no-untyped-call]
        self.flush()

    def attach(self, name: str, media_type: str, data: bytes, log_ns: int) -> None:
        """Writes what belongs to the recording as a whole."""
        self.flush()
        self._writer.add_attachment(log_ns, log_ns, name, media_type, data)  # type: ignore[no-untyped-call]
        self.flush()

    def write(self, line: Line) -> None:
        """Takes a line in; it is on the disk after ``flush`` at the latest."""
        channel = self._channels.get(line.topic)
        if channel is None:
            channel = self._channels[line.topic] = self._writer.register_channel(
                line.topic, line.encoding, self._schema(line.schema)
            )
        self._writer.add_message(channel, line.log_ns, line.data, line.publish_ns)  # type: ignore[no-untyped-call]

    def _schema(self, schema: Schema) -> int:
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema.name, schema.encoding, schema.data)  # type: ignore[no-untyped-call]
        return self._schemas[schema]

    def flush(self) -> None:
        """Ends the chunk: who reads the file now, or after a crash, has all that was written before."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._whole_bytes = self._raw.tell()

    def finish(self) -> None:
        """Writes the index and closes."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._raw.close()

    def abandon(self) -> None:
        """Closes a file that can't be written any more, with what is whole of it."""
        try:
            os.ftruncate(self._raw.fd, self._whole_bytes)
        except OSError:
            pass  # who reads it finds half a chunk at its end
        finally:
            self._raw.close()


class _Raw:
    """A file without a buffer of its own: what the disk refuses is known at once, and nothing is tried again in ``close``."""

    def __init__(self, fd: int) -> None:
        self.fd, self._position = fd, 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            n = os.write(self.fd, view)
            view = view[n:]
            self._position += n
        return len(data)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        pass

    def close(self) -> None:
        if self.fd >= 0:
            os.close(self.fd)
            self.fd = -1
