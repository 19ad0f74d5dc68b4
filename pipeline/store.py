"""Store: artifacts as zarr v3 groups, published whole or not at all. The only module that imports zarr.

Layout: `<stage>/<ab>/<rest of the address>/`, one zarr group an artifact. The group's `zarr.json`, its head, holds the
JSON fields, a sha256 per array, the provenance and the arrays' metadata (see `pipeline/storage/head.py`). On a local
disk the folder is written aside, read back, and renamed; in an object store the head is written last. Either way its
presence means: complete. Deleting is the same backwards: renamed aside, then removed; in an object store, the head
first.

zarr reads a missing chunk as zeros, silently; every read here checks the array's digest instead.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from b23d.pipeline.errors import (
    ArtifactNotFoundError,
    CorruptArtifactError,
    NotAStoreError,
    StoreError,
    UnwritableStoreError,
)
from b23d.pipeline.storage.encoding import array_digest, encode_artifact
from b23d.pipeline.storage.filesystem import open_filesystem
from b23d.pipeline.storage.head import UNREADABLE, ArrayHead, Head, parse_head
from b23d.pipeline.storage.marker import FAN, REST, check_format, mark, stages_in, store_format
from b23d.pipeline.storage.zarr_format import chunk_key, decode
from b23d.schemas.artifact import Artifact

A = TypeVar("A", bound=Artifact)

HEAD = "zarr.json"
WRITING = ".writing"
"""Artifacts on their way in or out; what is old there was left by a killed process."""
GONE = "gone-"
"""In WRITING: on its way out, of no use to anybody."""
_ABSENT = (FileNotFoundError, NotADirectoryError)
_NOT_AN_ARRAY = (ValueError, RuntimeError, TypeError, MemoryError, OverflowError, *_ABSENT, IsADirectoryError)
_RIVAL = {errno.EEXIST, errno.ENOTEMPTY, errno.ENOTDIR, errno.EISDIR}


class Store:
    """Artifacts by (stage, address), on any file system fsspec knows; `root` is a path or a URL.

    Every method raises StoreError where the store itself fails (no space, read-only, gone).
    """

    def __init__(self, root: str | Path) -> None:
        """Nothing is read or written yet. Raises MissingPackageError or ValueError where fsspec cannot open the URL."""
        self.url = str(root)
        self.fs, self.root, self.local = open_filesystem(self.url)

    def check_format(self) -> None:
        """Raises NotAStoreError where a newer program has written this store."""
        check_format(self.fs, self.root, self.url)

    def check_is_store(self) -> None:
        """Raises NotAStoreError where there is no store."""
        self.check_format()
        if store_format(self.fs, self.root) is None and not self.stages():
            raise NotAStoreError(f"store: expected a store at {self.url}, got none; give one with --store")

    def check_writable(self) -> None:
        """Make the store ready for writing, its marker included. Raises UnwritableStoreError, with what to do, where
        that cannot be."""
        self.check_format()
        probe = f"{self.root}/{WRITING}/{uuid.uuid4().hex}"
        try:
            self.fs.makedirs(f"{self.root}/{WRITING}", exist_ok=True)
            mark(self.fs, self.root)
            self.fs.pipe_file(probe, b"b23d")
            self.fs.rm_file(probe)
        except Exception as error:  # object stores raise what they like
            raise UnwritableStoreError(
                f"store: expected a folder or URL that can be written, got {self.url} ({_text(error)}); "
                "give another with --store"
            ) from error

    def path(self, stage: str, address: str) -> str:
        return f"{self.root}/{stage}/{address[:2]}/{address[2:]}"

    def addresses(self, stage: str) -> set[str]:
        """Addresses of all complete artifacts of a stage: those with a head."""
        if self.local:
            return set(_scan(f"{self.root}/{stage}"))
        try:
            found = [path.split("/")[-3:] for path in self.fs.find(f"{self.root}/{stage}") if path.endswith(HEAD)]
        except _ABSENT:
            return set()
        except Exception as error:  # object stores raise what they like
            raise self._failed(f"to list {stage}", error) from error
        return {fan + rest for fan, rest, _ in found if FAN.fullmatch(fan) and REST.fullmatch(rest)}

    def stages(self) -> list[str]:
        """Stages that have artifacts."""
        return list(stages_in(self.fs, self.root, HEAD))

    def has(self, stage: str, address: str) -> bool:
        return bool(self.fs.exists(f"{self.path(stage, address)}/{HEAD}"))

    def write(
        self, stage: str, address: str, artifact: Artifact, provenance: dict[str, Any], key: str | None = None
    ) -> tuple[int, str]:
        """Publish an artifact, atomically; returns its stored bytes and its content's digest. Writing what is there
        already changes nothing. `key`: see `pipeline/address.py`.

        Raises StoreError where it cannot be written, or does not read back.
        """
        files, head, content = encode_artifact(stage, address, key, artifact, provenance, HEAD)
        final = self.path(stage, address)
        try:
            if self.local:
                self._publish_local(stage, address, files, head)
            else:
                for name, data in {**files, HEAD: head}.items():
                    self.fs.pipe_file(f"{final}/{name}", data)
        except Exception as error:
            raise self._failed("room to write", error) from error
        return sum(map(len, files.values())) + len(head), content

    def head(self, stage: str, address: str) -> Head:
        """Raises ArtifactNotFoundError where there is none, CorruptArtifactError where it is not what was written, or
        another artifact's."""
        data = self._get(stage, address, HEAD)
        try:
            return parse_head(data, stage, address)
        except UNREADABLE as error:
            raise _corrupt(stage, address, HEAD, error) from error

    def read(self, stage: str, address: str, schema: type[A]) -> A:
        """The artifact, each array read and checked against its digest when first touched."""
        head = self.head(stage, address)
        if head.schema != schema.__name__:
            raise TypeError(
                f"{stage} {address[:12]}: expected {schema.__name__}, got {head.schema}; check the run's feeds"
            )
        return schema.lazy(
            head.values, set(head.arrays), lambda name: self._array(stage, address, name, head.arrays[name])
        )

    def array(self, stage: str, address: str, name: str) -> np.ndarray:
        """One array. Raises CorruptArtifactError where it is not what was written."""
        return self._array(stage, address, name, self.head(stage, address).arrays[name])

    def damage(self, stage: str, address: str) -> list[str]:
        """What is wrong with an artifact, a line each; zarr itself reads it, and digests are compared.

        Raises StoreError where the store cannot be read just now: that says nothing about the artifact.
        """
        try:
            head = self.head(stage, address)
        except (ArtifactNotFoundError, CorruptArtifactError) as error:
            return [str(error)]
        found = [line for name, array in head.arrays.items() for line in self._array_damage(stage, address, name, head)]
        return found

    def delete(self, stage: str, address: str) -> None:
        """Remove an artifact, so that it is never half there. What is not there is removed already."""
        path = self.path(stage, address)
        try:
            if self.local:
                self._set_aside(Path(path))
            else:
                with contextlib.suppress(*_ABSENT):
                    self.fs.rm_file(f"{path}/{HEAD}")
                    self.fs.rm(path, recursive=True)
        except Exception as error:
            raise self._failed("to remove an artifact", error) from error

    def drop_leftovers(self, older_than: float = 3600.0) -> None:
        """Remove what killed processes left: half written, when older than some seconds; half removed, at once."""
        if not self.local:
            return
        for path in Path(self.root, WRITING).glob("*"):
            with contextlib.suppress(OSError):
                if path.name.startswith(GONE) or time.time() - path.stat().st_mtime > older_than:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()

    def _publish_local(self, stage: str, address: str, files: dict[str, bytes], head: bytes) -> None:
        final, aside = Path(self.path(stage, address)), Path(self.root, WRITING, uuid.uuid4().hex)
        try:
            for name, data in {**files, HEAD: head}.items():
                path = aside / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(data)
                if path.read_bytes() != data:
                    raise OSError(errno.EIO, f"{name} did not read back as written; check the disk", str(final))
            final.parent.mkdir(parents=True, exist_ok=True)
            for _ in range(3):
                try:
                    aside.rename(final)
                    return
                except OSError as error:
                    if error.errno not in _RIVAL:
                        raise
                with contextlib.suppress(ArtifactNotFoundError, CorruptArtifactError):
                    self.head(stage, address)
                    return  # a rival was faster
                self._set_aside(final)  # something broken: replace it
            raise OSError(errno.EEXIST, "something that is no artifact comes back again and again", str(final))
        finally:
            shutil.rmtree(aside, ignore_errors=True)

    def _set_aside(self, path: Path) -> None:
        """Out of the way in one step, then removed."""
        aside = Path(self.root, WRITING, GONE + uuid.uuid4().hex)
        aside.parent.mkdir(parents=True, exist_ok=True)
        try:
            path.rename(aside)
        except _ABSENT:
            return
        if aside.is_dir():
            shutil.rmtree(aside, ignore_errors=True)
        else:
            aside.unlink(missing_ok=True)

    def _get(self, stage: str, address: str, name: str) -> bytes:
        try:
            return bytes(self.fs.cat_file(f"{self.path(stage, address)}/{name}"))
        except _ABSENT as error:
            found = ArtifactNotFoundError(
                f"{stage}: expected an artifact at {address[:12]}, got nothing there in store {self.url}; run it first"
            )
            found.artifact = (stage, address)
            raise found from error
        except IsADirectoryError as error:
            raise _corrupt(stage, address, name, error) from error
        except Exception as error:
            raise self._failed(f"to read {stage} {address[:12]}/{name}", error) from error

    def _array(self, stage: str, address: str, name: str, head: ArrayHead) -> np.ndarray:
        try:
            data = self._get(stage, address, f"{name}/{chunk_key(head.shape)}")
            value = decode(data, head.shape, head.dtype, head.sharded)
        except _NOT_AN_ARRAY as error:
            raise _corrupt(stage, address, name, error) from error
        if array_digest(value) != head.sha256:
            raise _corrupt(stage, address, name, "the sha256 differs")
        return value

    def _array_damage(self, stage: str, address: str, name: str, head: Head) -> Iterator[str]:
        import json

        import zarr

        array, path = head.arrays[name], self.path(stage, address)
        try:
            if self._get(stage, address, f"{name}/{HEAD}") != json.dumps((head.metadata or {})[name]).encode():
                yield f"{name}/{HEAD}: expected what the head says, got other bytes"
            self._get(stage, address, f"{name}/{chunk_key(array.shape)}")  # zarr would read zeros where it is missing
            group: Any = zarr.open_group(path if self.local else self.fs.unstrip_protocol(path), mode="r")
            if array_digest(np.asarray(group[name][...])) != array.sha256:
                yield f"{name}: expected sha256 {array.sha256[:12]}, got other bytes"
        except StoreError:
            raise
        except ArtifactNotFoundError:
            yield f"{name}: expected its chunk and its {HEAD}, got none"
        except Exception as error:  # zarr and its codecs raise their own kinds for damaged bytes
            yield f"{name}: {type(error).__name__}: {error}"

    def _failed(self, wanted: str, error: Exception) -> StoreError:
        if isinstance(error, StoreError):
            return error
        return StoreError(
            f"store {self.url}: expected {wanted}, got {_text(error)}; mend that, or give another with --store"
        )


def _scan(stage: str) -> Iterator[str]:
    with contextlib.suppress(*_ABSENT), os.scandir(stage) as fans:
        for fan in fans:
            if FAN.fullmatch(fan.name):
                with contextlib.suppress(*_ABSENT), os.scandir(fan.path) as entries:
                    for entry in entries:
                        if REST.fullmatch(entry.name) and os.path.exists(f"{entry.path}/{HEAD}"):  # noqa: PTH110, speed
                            yield fan.name + entry.name


def _corrupt(stage: str, address: str, name: str, reason: object) -> CorruptArtifactError:
    error = CorruptArtifactError(
        f"{stage} {address[:12]}/{name}: expected the bytes that were written, got damaged ones ({reason}); "
        "run `b23d verify`"
    )
    error.artifact = (stage, address)
    return error


def _text(error: Exception) -> str:
    return str(error) or type(error).__name__
