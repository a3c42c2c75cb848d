"""A recording's file: MCAP, in chunks that are complete on the disk soon after their messages arrived."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from mcap.writer import CompressionType, Writer

from surveilnav import __version__
from surveilnav.services.recorder.core.mcap_message import McapMessage, Schema

try:
    import fcntl
except ImportError:  # not a POSIX system: there nothing shows that a file is being written
    fcntl = None  # type: ignore[assignment]

_CHUNK_BYTES = 1 << 20


class RecordingFile:
    """A file that is being written, by one thread.

    Every method raises OSError when the disk does; ``abandon`` the file then.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._raw = _UnbufferedFile(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644))
        if fcntl is not None:
            fcntl.flock(self._raw.fd, fcntl.LOCK_EX)  # the system releases it with the process, however that ends
        self._writer = Writer(self._raw, chunk_size=_CHUNK_BYTES, compression=CompressionType.ZSTD)  # type: ignore[arg-type]
        self._schemas: dict[Schema, int] = {}
        self._channels: dict[str, int] = {}
        self._complete_bytes = 0
        self._writer.start(library=f"surveilnav {__version__}")  # type: ignore[no-untyped-call]

    @property
    def n_bytes(self) -> int:
        return self._raw.tell()

    def add_metadata(self, name: str, facts: Mapping[str, str]) -> None:
        self._writer.add_metadata(name, dict(facts))  # type: ignore[no-untyped-call]
        self.flush()

    def add_attachment(self, name: str, media_type: str, data: bytes, log_ns: int) -> None:
        """Writes a named attachment, such as a snapshot of the maps."""
        self.flush()
        self._writer.add_attachment(log_ns, log_ns, name, media_type, data)  # type: ignore[no-untyped-call]
        self.flush()

    def write(self, message: McapMessage) -> None:
        """Writes a message; it is on the disk after ``flush`` at the latest."""
        channel = self._channels.get(message.topic)
        if channel is None:
            channel = self._channels[message.topic] = self._writer.register_channel(
                message.topic, message.encoding, self._schema(message.schema)
            )
        self._writer.add_message(channel, message.log_ns, message.data, message.publish_ns)  # type: ignore[no-untyped-call]

    def _schema(self, schema: Schema) -> int:
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(schema.name, schema.encoding, schema.data)  # type: ignore[no-untyped-call]
        return self._schemas[schema]

    def flush(self) -> None:
        """Completes the chunk, so that whoever reads the file now, or after a crash, finds everything written so far."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._complete_bytes = self._raw.tell()

    def finish(self) -> None:
        """Writes the index and closes the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._raw.close()

    def abandon(self) -> None:
        """Closes a file that can't be written any more, after its last complete chunk."""
        try:
            os.ftruncate(self._raw.fd, self._complete_bytes)
        except OSError:
            pass  # the file then ends with half a chunk, which readers skip
        finally:
            self._raw.close()


class _UnbufferedFile:
    """A file without a buffer, so that errors of the disk are raised by ``write`` itself, and ``close`` writes nothing."""

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
