"""A zip file from anywhere, read as data: nothing is unpacked or run, names and sizes are checked."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from vibroswarm.errors import InputError

MOST_ENTRIES: Final = 20_000
MOST_BYTES: Final = 512 * 2**20
"""Of all entries, unpacked."""
_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*(/[A-Za-z0-9][A-Za-z0-9_.-]*)?(\.[a-z]+)?")


class Zipped:
    """An open zip file whose entries have plain names and bounded sizes.

    Raises:
        InputError: no zip file, an odd name, too many or too large entries.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.is_file():
            raise InputError("is no file", field=str(path))
        try:
            self._file = zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile, NotImplementedError, ValueError) as error:
            raise InputError(f"is no zip file ({error})", field=str(path)) from None
        try:
            self.names = self._checked()
        except InputError:
            self._file.close()
            raise

    def _checked(self) -> list[str]:
        entries = self._file.infolist()
        names = [entry.filename for entry in entries]
        if len(entries) > MOST_ENTRIES or sum(entry.file_size for entry in entries) > MOST_BYTES:
            raise InputError(f"holds too much: at most {MOST_ENTRIES} files of 512 MiB", field=str(self.path))
        if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in entries):
            # Others may ask for gigabytes before they give a byte.
            raise InputError("is packed in an odd way; deflate is right", field=str(self.path))
        odd = [name for name in names if not _NAME.fullmatch(name)]
        if odd or len(set(names)) != len(names):
            raise InputError(f"holds a file of an odd name, {(odd or names)[0]!r}", field=str(self.path))
        return names

    def read(self, name: str) -> bytes:
        """The bytes of an entry.

        Raises:
            InputError: it is not there, damaged, encrypted, or longer than it says.
        """
        try:
            entry = self._file.getinfo(name)
            with self._file.open(entry) as stream:
                data = stream.read(entry.file_size + 1)
        except KeyError:
            raise InputError(f"holds no '{name}'", field=str(self.path)) from None
        except (
            OSError,
            zipfile.BadZipFile,
            RuntimeError,
            NotImplementedError,
            ValueError,
            EOFError,
        ) as error:
            raise InputError(f"'{name}' is damaged ({error})", field=str(self.path)) from None
        except Exception as error:  # zlib's own
            raise InputError(f"'{name}' is damaged ({type(error).__name__})", field=str(self.path)) from None
        if len(data) > entry.file_size:
            raise InputError(f"'{name}' is longer than it says", field=str(self.path))
        return data

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
